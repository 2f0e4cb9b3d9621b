"""Common part of sources of motion capture over UDP."""
