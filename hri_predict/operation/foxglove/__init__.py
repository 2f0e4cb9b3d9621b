"""The node as Foxglove shows it while it runs."""
