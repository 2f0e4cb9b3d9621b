"""Workers for offline work: this process, several processes, or a cluster."""
