"""Connections above the limit are ended; those that were there first, and other sockets, stay."""

import contextlib
import socket

import pytest

from hri_predict.operation.foxglove.live import Crowd


@pytest.fixture
def opened():
    """A server in this process, and what connects to it and to another."""
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))

        def connect(to=server):
            client = stack.enter_context(socket.create_connection(to.getsockname(), timeout=20))
            accepted, _ = to.accept()
            return client, stack.enter_context(accepted)

        yield server, connect


def is_open(pair):
    """Whether bytes still reach the client."""
    client, accepted = pair
    try:
        accepted.sendall(b"x")
        return client.recv(1) == b"x"
    except OSError:
        return False


def test_what_is_above_the_limit_is_ended_and_the_first_stay(opened):
    server, connect = opened
    crowd = Crowd(server.getsockname()[1], 2)
    first = [connect(), connect()]
    assert crowd.shed() == 0
    more = [connect(), connect(), connect()]
    assert crowd.shed() == 3
    assert [is_open(each) for each in first + more] == [True, True, False, False, False]
    assert crowd.ended == 3


def test_a_place_that_is_given_up_can_be_taken(opened):
    server, connect = opened
    crowd = Crowd(server.getsockname()[1], 1)
    first = connect()
    crowd.shed()
    for each in first:
        each.close()
    second = connect()
    assert crowd.shed() == 0
    assert is_open(second)


def test_without_free_descriptors_it_still_ends_them(opened, monkeypatch):
    server, connect = opened
    monkeypatch.setattr("os.listdir", lambda path: (_ for _ in ()).throw(OSError(24, "too many")))
    crowd = Crowd(server.getsockname()[1], 1)
    pairs = [connect(), connect()]
    assert crowd.shed() == 1
    assert sorted(map(is_open, pairs)) == [False, True]


def test_connections_of_other_servers_stay(opened):
    server, connect = opened
    with socket.create_server(("127.0.0.1", 0)) as other:
        pair = connect(other)
        crowd = Crowd(server.getsockname()[1], 1)
        connect()
        assert crowd.shed() == 0
        assert is_open(pair)
