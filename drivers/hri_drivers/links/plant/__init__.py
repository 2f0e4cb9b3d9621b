"""Links to plants: advice, distances and acknowledges in the registers of one map."""
