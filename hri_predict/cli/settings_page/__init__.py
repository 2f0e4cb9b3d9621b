"""Reference of all configuration keys: a JSON schema for editors, and a page for the docs."""
