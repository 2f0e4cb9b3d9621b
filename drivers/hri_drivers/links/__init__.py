"""Links to robot controllers."""
