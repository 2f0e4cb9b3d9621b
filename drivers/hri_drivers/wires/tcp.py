"""Options of TCP connections: old bytes are not delivered late, and a silent peer is noticed."""

import socket

LOST_S = 0.5
"""Bytes that a peer leaves unacknowledged for longer end the connection."""
IDLE_S, PROBE_S, PROBES = 5, 2, 3
"""A silent peer is probed after ``IDLE_S``, then every ``PROBE_S``; after ``PROBES`` without an
answer the connection is lost."""


def limit_delay(connection: socket.socket) -> None:
    """Send small writes immediately, and end the connection instead of delivering old bytes.

    By default TCP collects small writes until the peer acknowledges, and keeps what it could not
    deliver for minutes: after a network outage a controller would get advice of before it, as new.
    """
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        limit_ms = round(1e3 * LOST_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, limit_ms)


def keep_alive(connection: socket.socket) -> None:
    """Let the system probe an idle peer: one that lost its power or its cable sends no end, and
    would be waited for without limit.
    """
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    if hasattr(socket, "TCP_KEEPIDLE"):  # else the system's own times, which may be hours
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, IDLE_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, PROBE_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, PROBES)
