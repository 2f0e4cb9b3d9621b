"""The report as one page of HTML that needs nothing else, and prints on A4."""
