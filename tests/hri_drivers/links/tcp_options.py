"""What each TCP connection to a controller needs."""

import socket

from hri_drivers.wires.tcp import IDLE_S


def demand_options(connection: socket.socket) -> None:
    """Fail if the connection delivers bytes late, or does not notice a peer without power."""

    def option(name: str) -> int:
        return connection.getsockopt(socket.IPPROTO_TCP, getattr(socket, name))

    assert option("TCP_NODELAY")
    assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    if hasattr(socket, "TCP_KEEPIDLE"):
        assert option("TCP_KEEPIDLE") == IDLE_S
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # without it Linux sends old bytes for 15 minutes
        assert option("TCP_USER_TIMEOUT") == 500
