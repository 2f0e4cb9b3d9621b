"""Reports for people while and after the node runs: alerts, summary, fleet."""
