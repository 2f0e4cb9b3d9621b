"""ZED Live Link: bodies that ZED cameras see, as JSON."""
