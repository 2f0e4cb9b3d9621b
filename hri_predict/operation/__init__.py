"""Outputs for operators and plant systems: alerts, metrics, the service, evidence."""
