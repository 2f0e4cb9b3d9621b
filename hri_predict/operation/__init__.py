"""What the plant's people and systems receive: alerts, metrics, the service, evidence."""
