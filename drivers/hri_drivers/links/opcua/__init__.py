"""An OPC UA server for plants, in a separate process: the newest advice as variables."""
