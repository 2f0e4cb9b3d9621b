"""Reports for operators during and after a run: alerts, summary, fleet."""
