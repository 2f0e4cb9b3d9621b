"""Running the node as a service: reports to systemd, metrics, and the log."""
