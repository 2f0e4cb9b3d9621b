"""Commands that generate files from the protocol and the configuration."""
