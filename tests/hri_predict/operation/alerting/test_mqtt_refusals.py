"""A broker that refuses: why, in words; on a bare socket, which needs no broker."""

import contextlib
import socket
import threading

import pytest

from hri_predict.operation.alerting.alert import Trial
from hri_predict.operation.alerting.mqtt import MqttHook, MqttSender, client_id
from hri_predict.operation.alerting.sender import SendError
from tests.hri_predict.operation.alerting.servers import place

pytest.importorskip("paho.mqtt.client", reason="needs paho-mqtt (the extra mqtt)")


@contextlib.contextmanager
def broker(answer):
    """Reads CONNECT, sends what ``answer`` makes of the client id, and hangs up."""
    ids = []
    listener = socket.create_server(("127.0.0.1", 0))

    def serve():
        connection, _ = listener.accept()
        with connection:
            packet = connection.recv(4096)
            length = int.from_bytes(packet[12:14], "big")  # after the fixed and variable header
            ids.append(packet[14 : 14 + length].decode())
            with contextlib.suppress(OSError):
                connection.sendall(answer(ids[-1]))
                connection.recv(4096)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield listener.getsockname()[1], ids
    listener.close()
    thread.join(5)


def sender(folder, port, **settings):
    whole = {"kind": "mqtt", "host": "127.0.0.1", "port": port, "tls": False} | settings
    return MqttSender(MqttHook(**whole), place(folder, live=False))


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (1, "Unacceptable protocol version; use a broker that speaks MQTT 3.1.1"),
        (2, "Identifier rejected; set 'client_id'"),
        (3, "Server unavailable"),
        (4, "Bad user name or password"),
        (5, "Not authorized"),
        (77, "an unknown reason"),
    ],
)
def test_a_refusal_is_said_in_words(code, said, tmp_path):
    refuses = broker(lambda name: bytes([0x20, 2, 0, code]))
    with refuses as (port, _), pytest.raises(SendError) as error:
        sender(tmp_path, port).send(Trial(at=None), 0)
    assert str(error.value).startswith(f"the broker refuses: {said}")
    assert f"CONNACK {code}" in str(error.value)


def test_what_is_no_broker_is_said(tmp_path):
    web = broker(lambda name: b"HTTP/1.1 400 Bad Request\r\n\r\n")
    with web as (port, _), pytest.raises(SendError, match=r"not an MQTT broker; correct .port."):
        sender(tmp_path, port).send(Trial(at=None), 0)


@pytest.mark.parametrize("chosen", [None, "plant/3 cell"])
def test_a_client_id_is_given(chosen, tmp_path):
    more = {} if chosen is None else {"client_id": chosen}
    with broker(lambda name: bytes([0x20, 2, 0, 2])) as (port, ids), pytest.raises(SendError):
        sender(tmp_path, port, **more).send(Trial(at=None), 0)
    assert ids == [chosen] if chosen else ids[0].startswith("hricell7")


def test_every_broker_accepts_the_client_id_that_is_made():
    for cell in ("", "cell 7", "Größe/ü" * 20):
        made = client_id(cell)
        assert 1 <= len(made) <= 23
        assert made.isascii()
        assert made.isalnum()
    assert client_id("a") != client_id("a")
