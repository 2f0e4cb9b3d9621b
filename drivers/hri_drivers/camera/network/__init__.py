"""Networks that find people in an image: BlazePose, and others through a description file."""
