"""An OPC UA server for plants, in a process of its own: the newest advice as variables."""
