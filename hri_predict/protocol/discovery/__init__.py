"""Finding nodes, sources and controllers by DNS-SD over multicast DNS (RFC 6763, RFC 6762).

Discovery is only a hint, and nothing relies on it: announcements are unprotected, and a device
that has lost power stays known for a while. Only its data show whether a source or node is alive.
"""
