"""Robots: files, kinematics, present motion, plans and stopping."""
