"""The node's own scene stream, over UDP, serial and zenoh."""
