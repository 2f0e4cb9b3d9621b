"""``hri-predict bench``: what the node costs."""
