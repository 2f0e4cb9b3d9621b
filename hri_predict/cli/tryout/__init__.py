"""``try``: a camera, the node and the 3D view in one command."""
