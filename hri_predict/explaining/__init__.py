"""From recordings alone: why a robot slowed, and what a shift was like."""
