"""Simulated wires."""
