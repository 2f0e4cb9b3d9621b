"""Networks that find people in a picture: BlazePose, and others through a description file."""
