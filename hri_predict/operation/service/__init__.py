"""The node as a service: its reports to systemd, monitoring, and the log."""
