"""A connection to a sender that is lost without an end."""

import errno
import socket
from collections.abc import Iterator

import pytest

from hri_drivers.sources.tcp import StreamClient
from hri_drivers.wires.tcp import IDLE_S
from hri_predict.base.errors import SourceError


class Whole:
    """Each read is a unit."""

    def feed(self, data: bytes) -> Iterator[bytes]:
        yield data


@pytest.fixture
def client():
    with socket.create_server(("127.0.0.1", 0)) as server:
        host, port = server.getsockname()
        made = StreamClient(host, port, Whole)
        made.open()
        yield made
        made.close()


def test_a_silent_sender_is_probed(client):
    connection = client._connection
    assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    if hasattr(socket, "TCP_KEEPIDLE"):
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == IDLE_S


def test_silence_is_no_loss_but_a_sender_that_does_not_answer_is(client):
    assert client.read(0.01) == []

    class Unanswered:
        """What the system says once its probes have no answer."""

        def settimeout(self, _): ...

        def recv(self, _):
            raise TimeoutError(errno.ETIMEDOUT, "Connection timed out")

        def close(self): ...

    client.close()
    client._connection = Unanswered()
    with pytest.raises(SourceError, match="no longer answers; check its power and its cable"):
        client.read(0.01)
