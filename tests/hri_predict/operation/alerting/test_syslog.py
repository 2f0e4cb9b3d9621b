"""Syslog over UDP, TCP, TLS and a socket of the machine."""

import socket
import threading

import pytest

from hri_predict.operation.alerting.sender import SendError
from hri_predict.operation.alerting.syslog import SyslogHook, SyslogSender
from tests.hri_predict.operation.alerting.servers import alert, place, server_tls
from tests.hri_predict.operation.alerting.test_text import RFC_5424
from tests.waiting import free_port


def send(folder, **settings):
    SyslogSender(SyslogHook(kind="syslog", **settings), place(folder)).send(alert(), 2)


def check(data):
    found = RFC_5424.fullmatch(data)
    assert found
    assert found["pri"] == b"132"  # local0 (16), warning (4)
    assert found["time"] == b"2026-03-01T14:03:07.123Z"
    assert b" hri-predict " in data
    assert b" STOP - " in data
    assert found["text"].decode().startswith("cell7: [14:03:07.123Z] clear -> stop: arm: a person")
    assert found["text"].endswith(b"; 2 more changes before")


def test_a_datagram_over_udp(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(10)
        send(tmp_path, host="127.0.0.1", port=receiver.getsockname()[1])
        check(receiver.recv(4096))


def test_a_datagram_to_a_socket_of_the_machine(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(tmp_path / "log"))
        receiver.settimeout(10)
        send(tmp_path, protocol="unix", path=str(tmp_path / "log"))
        check(receiver.recv(4096))


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_a_stream_counts_the_octets_of_each_message(protocol, tmp_path):
    listener = socket.create_server(("127.0.0.1", 0))
    tls = server_tls(tmp_path) if protocol == "tls" else None
    got = []

    def receive():
        connection, _ = listener.accept()
        stream = tls.wrap_socket(connection, server_side=True) if tls else connection
        with stream, stream.makefile("rb") as file:
            got.append(file.read())

    thread = threading.Thread(target=receive, daemon=True)
    thread.start()
    ca = {"ca_file": "server.pem"} if tls else {}
    port = listener.getsockname()[1]
    send(tmp_path, protocol=protocol, host="localhost", port=port, **ca)
    thread.join(10)
    listener.close()
    count, _, message = got[0].partition(b" ")
    assert int(count) == len(message)
    check(message)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"protocol": "tcp", "host": "127.0.0.1"}, "Connection refused"),
        ({"protocol": "unix", "path": "/no/such/socket"}, "No such file"),
    ],
)
def test_nobody_there_is_said(settings, words, tmp_path):
    port = {} if "path" in settings else {"port": free_port()}
    with pytest.raises(SendError, match=words):
        send(tmp_path, **settings, **port)
