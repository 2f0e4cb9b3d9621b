"""Requests that arrive before the reply to the one before, as bytes of a PLC."""

import contextlib
import socket
from collections.abc import Iterator
from struct import pack, unpack
from typing import Any

import pytest

pytest.importorskip("pymodbus", reason="pymodbus is not installed: the link cannot be used")
from hri_drivers.links.modbus.connections import MOST_WAITING
from hri_drivers.links.modbus.link import ModbusLink
from hri_predict.protocol.messages import Acknowledge
from tests.hri_drivers.links.modbus.test_link import ended, link, plc, port_of, posted
from tests.waiting import eventually

__all__ = ["link", "plc"]  # the fixtures
pytestmark = pytest.mark.realtime
PAIRS = 40


def request(number: int, content: bytes) -> bytes:
    """A request with its header; ``number`` is its transaction."""
    return pack(">HHHB", number, 0, 1 + len(content), 1) + content


def read(number: int) -> bytes:
    """Reads the node's first two registers."""
    return request(number, pack(">BHH", 4, 0, 2))


def press(number: int, ack_id: int) -> bytes:
    """Writes an acknowledge."""
    return request(number, pack(">BHHBHI", 16, 1001, 3, 6, 77, ack_id))


def pairs(count: int) -> bytes:
    """A read and an acknowledge, several times, with consecutive transactions."""
    return b"".join(read(2 * k) + press(2 * k + 1, k) for k in range(1, count + 1))


class Client:
    """A connection to the server."""

    def __init__(self, server: ModbusLink) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port_of(server)), 20.0)
        self._from = self.socket.makefile("rb")
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def replies(self, count: int) -> list[tuple[int, int]]:
        """Transaction and function of the next replies."""
        found = []
        for _ in range(count):
            number, protocol, length = unpack(">HHH", self._exactly(6))
            assert protocol == 0
            found.append((number, self._exactly(length)[1]))
        return found

    def close(self) -> None:
        """Hang up."""
        self._from.close()
        self.socket.close()

    def _exactly(self, count: int) -> bytes:
        data = self._from.read(count)
        assert len(data) == count, "closed"
        return data


@pytest.fixture
def connected(link: Any) -> Iterator[tuple[ModbusLink, Client]]:
    server = link()
    client = Client(server)
    yield server, client
    client.close()


def presses(server: ModbusLink, count: int) -> list[Any]:
    """The messages that reach the node, at least ``count``."""
    heard: list[Any] = []

    def enough() -> bool:
        heard.extend(r.message for r in server.take())
        return len(heard) >= count

    eventually(enough)
    return heard


def test_a_read_and_an_acknowledge_sent_together_are_both_answered(connected):
    server, client = connected
    client.socket.sendall(read(1) + press(2, 9))
    assert client.replies(2) == [(1, 4), (2, 16)]
    assert presses(server, 1) == [Acknowledge(77, 9)]
    client.socket.sendall(read(3))
    assert client.replies(1) == [(3, 4)]
    assert server.take() == []  # it was carried out once


def test_many_requests_in_one_segment_are_answered_in_order(connected):
    server, client = connected
    client.socket.sendall(pairs(PAIRS))
    answered = [(n, (4, 16)[n % 2]) for n in range(2, 2 * PAIRS + 2)]
    assert client.replies(2 * PAIRS) == answered
    assert presses(server, PAIRS) == [Acknowledge(77, k) for k in range(1, PAIRS + 1)]


def test_requests_may_be_split_anywhere(connected):
    server, client = connected
    for byte in pairs(2):
        client.socket.sendall(bytes((byte,)))
    assert client.replies(4) == [(2, 4), (3, 16), (4, 4), (5, 16)]
    assert presses(server, 2) == [Acknowledge(77, 1), Acknowledge(77, 2)]


def test_a_request_that_cannot_be_read_is_an_exception_and_the_next_one_is_answered(connected):
    _, client = connected
    client.socket.sendall(request(1, b"\x42") + read(2) + request(3, b"\x90\x01") + read(4))
    found = client.replies(4)
    assert [number for number, _ in found] == [1, 2, 3, 4]
    assert [found[1], found[3]] == [(2, 4), (4, 4)]
    assert all(function >= 0x80 for _, function in (found[0], found[2]))


def test_a_client_that_does_not_wait_for_replies_is_ended_and_its_writes_are_counted(
    connected, plc, caplog
):
    server, client = connected
    beats = b"".join(request(n, pack(">BHH", 6, 1000, n)) for n in range(2000))
    with contextlib.suppress(ConnectionError):
        client.socket.sendall(beats)
    eventually(lambda: ended(client.socket))
    assert f"more than {MOST_WAITING} requests ahead of the replies" in caplog.text
    there = plc(server)
    assert posted(server, lambda: there.node()["WRITES_REFUSED"] > MOST_WAITING)


@pytest.mark.parametrize("other", [b"GET / HTTP/1.1\r\n\r\n", b"\0\1\0\0\xff\xff", bytes(6)])
def test_a_client_that_speaks_something_else_is_ended(connected, other):
    _, client = connected
    client.socket.sendall(other)
    eventually(lambda: ended(client.socket))
