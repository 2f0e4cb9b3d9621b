"""Clients of Foxglove's WebSocket protocol: one that reads, and one that does not."""

import json
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from websockets import Subprotocol
from websockets.sync.client import connect

PROTOCOL = "foxglove.sdk.v1"
WAIT_S = 60.0
"""For a message that must come; a machine under any load is quicker."""


class Viewer:
    """A client that subscribes to what it wants.

    Attributes:
        channels: topic -> what the server advertised.
    """

    def __init__(self, port: int) -> None:
        address = f"ws://127.0.0.1:{port}"
        self._socket = connect(
            address,
            subprotocols=[Subprotocol(PROTOCOL)],
            max_size=None,
            proxy=None,
            close_timeout=0.1,
        )
        self.server = json.loads(self._socket.recv(WAIT_S))
        said = json.loads(self._socket.recv(WAIT_S))
        self.channels = {each["topic"]: each for each in said["channels"]}
        self._topics = {each["id"]: topic for topic, each in self.channels.items()}

    def subscribe(self, *topics: str) -> None:
        wanted = [self.channels[topic]["id"] for topic in topics]
        self._socket.send(subscription(wanted))

    def send(self, data: str | bytes) -> None:
        self._socket.send(data)

    def message(self) -> tuple[str, int, bytes]:
        """Topic, log time (ns) and content of the next message."""
        while True:
            data = self._socket.recv(WAIT_S)
            if isinstance(data, bytes):
                kind, number, at_ns = struct.unpack_from("<BIQ", data)
                assert kind == 1
                return self._topics[number], at_ns, data[13:]

    def close(self) -> None:
        self._socket.close()


def subscription(channels: list[int]) -> str:
    """The request for these channels; each subscription has its channel's number."""
    asked = [{"id": each, "channelId": each} for each in channels]
    return json.dumps({"op": "subscribe", "subscriptions": asked})


@contextmanager
def stalled(port: int, channels: list[int]) -> Iterator[socket.socket]:
    """A client that subscribes and then reads nothing."""
    with socket.create_connection(("127.0.0.1", port)) as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        head = (
            "GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: JRsfev/cThfwr1jKLGyK0g==\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n"
        )
        one.sendall(head.encode())
        assert b"101" in one.recv(64)
        request = subscription(channels).encode()
        assert len(request) < 126  # a short frame, with a mask of zeros
        one.sendall(bytes([0x81, 0x80 | len(request)]) + bytes(4) + request)
        yield one
