"""Links to robot controllers, and sources of people."""
