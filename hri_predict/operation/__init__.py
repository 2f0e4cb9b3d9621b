"""Outputs for the plant's people and systems: alerts, metrics, the service, evidence."""
