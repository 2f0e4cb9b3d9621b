"""One tick: scenes in, messages out; and the listeners to it."""
