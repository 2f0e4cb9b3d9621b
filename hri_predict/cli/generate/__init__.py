"""Commands that write generated files: of the protocol, and of the configuration."""
