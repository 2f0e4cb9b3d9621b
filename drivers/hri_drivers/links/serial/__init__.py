"""The serial link."""
