"""Networks that find people in a picture: BlazePose, and others by a description."""
