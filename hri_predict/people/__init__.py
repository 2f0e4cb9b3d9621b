"""The people in the room, with one validated history for each person."""
