"""Robots: their files, kinematics, present motion and plans, and how they stop."""
