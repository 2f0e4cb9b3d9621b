"""The CAN link, classic and FD."""
