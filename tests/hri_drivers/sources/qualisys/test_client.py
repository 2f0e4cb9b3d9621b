"""A packet whose size is wrong does not swallow all that follow: the connection begins again."""

import socket
import struct

import pytest

from hri_drivers.sources.qualisys.source import WHOLE_S, QtmClient
from hri_predict.base.errors import SourceError

PATIENCE_S = 20.0
WHOLE = struct.pack("<II", 8, 4)


@pytest.fixture
def qtm():
    """The client with its own clock, and the far end of its connection."""
    now = [100.0]
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        client = QtmClient("127.0.0.1", port, lambda: None, monotonic_s=lambda: now[0])
        client.open()
        far, _ = server.accept()
        with far:
            yield client, far, now
        client.close()


def test_a_packet_that_does_not_end_ends_the_connection(qtm):
    client, far, now = qtm
    far.sendall(struct.pack("<II", 500_000, 3) + bytes(800))
    assert client.read(PATIENCE_S) == []
    now[0] += WHOLE_S + 0.01
    far.sendall(WHOLE)
    with pytest.raises(SourceError, match="a packet stayed incomplete; connecting again"):
        client.read(PATIENCE_S)


def test_a_packet_in_two_pieces_is_whole(qtm):
    client, far, now = qtm
    far.sendall(WHOLE[:3])
    assert client.read(PATIENCE_S) == []
    now[0] += WHOLE_S + 0.01
    far.sendall(WHOLE[3:])
    assert client.read(PATIENCE_S) == [WHOLE]


def test_a_server_that_is_silent_between_packets_stays_connected(qtm):
    client, far, now = qtm
    far.sendall(WHOLE)
    assert client.read(PATIENCE_S) == [WHOLE]
    now[0] += 10.0
    assert client.read(0.01) == []
    far.sendall(WHOLE)
    assert client.read(PATIENCE_S) == [WHOLE]
