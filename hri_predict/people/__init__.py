"""The people in the room: one trusted history for each person."""
