"""The zenoh link."""
