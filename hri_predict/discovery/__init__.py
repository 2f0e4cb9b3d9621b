"""Finding nodes, sources and controllers by DNS-SD over multicast DNS (RFC 6763, RFC 6762).

Discovery is a hint and nothing rests on it: who is there is told by whoever is there, unprotected,
and what has lost power is remembered for a while. Whether a source or node is alive is decided by
its data.
"""
