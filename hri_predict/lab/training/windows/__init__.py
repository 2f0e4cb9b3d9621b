"""Training windows: cut from recordings, and augmented."""
