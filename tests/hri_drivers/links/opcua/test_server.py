"""The server's process, without a server: its files, and its end of the socket."""

import asyncio
import socket
import struct
from unittest.mock import Mock

import pytest

pytest.importorskip("asyncua", reason="asyncua is not installed: the link cannot be used")
from hri_drivers.links.opcua.server import PlantServer, _certificate, _check_pair, _private_key
from tests.hri_drivers.links.opcua.test_link import made_certificate


def test_a_node_that_ends_with_reports_unread_ends_the_server():
    """The socket is reset then, not closed in order."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with far:
        far.setblocking(False)
        server = PlantServer(far, {})
        server._variables = Mock()
        server._take()  # nothing has come
        assert not server._ended
        far.send(b"C" + struct.pack(">Q", 1))
        near.close()
        server._take()
        assert server._ended


def test_a_key_of_another_certificate_is_one_line(tmp_path):
    one, other = (made_certificate(tmp_path, name) for name in ("one", "other"))
    certificate = asyncio.run(_certificate("certificate", one[0]))
    keys = [asyncio.run(_private_key(each[1])) for each in (one, other)]
    asked = {"certificate": one[0], "private_key": other[1]}
    _check_pair(asked, certificate, keys[0])
    said = "private_key .*other.pem is not the key of certificate .*one.der; give a matching"
    with pytest.raises(ValueError, match=said):
        _check_pair(asked, certificate, keys[1])
