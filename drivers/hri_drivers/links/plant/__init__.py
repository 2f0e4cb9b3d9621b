"""Links to plants: advice, distances and acknowledges as the registers of one map."""
