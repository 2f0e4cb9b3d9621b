"""The node as a service: what it tells systemd, monitoring, and the log."""
