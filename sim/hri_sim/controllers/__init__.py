"""Mock robot controllers and the simulated cell that contains them."""
