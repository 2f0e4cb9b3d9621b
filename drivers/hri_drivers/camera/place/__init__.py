"""The place of the people that a camera sees, in metres."""
