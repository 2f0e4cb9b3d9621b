"""Find nodes, sources and controllers with DNS-SD over multicast DNS (RFC 6763, RFC 6762).

Discovery is only a hint, and nothing relies on it: announcements are unprotected, and a device that
lost power remains listed for a while. Only data from a source or node prove that it is alive.
"""
