"""The operator's page: the cell's state from three metres away, and the history of alerts."""
