"""JSON scenes over real WebSockets, against the library that everybody has."""

import contextlib
import json
import socket
import threading
from collections.abc import Callable
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Origin

from hri_drivers.sources.scene_json.codec import MAX_BYTES
from hri_drivers.sources.scene_json.websocket_source import WebSocketSettings
from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.base.settings import validated

pytestmark = pytest.mark.realtime

Hear = Callable[..., Any]


def text(sequence: int, **changes: Any) -> str:
    scene = {
        "format": "hri-scene/1",
        "sequence": sequence,
        "stamp_s": sequence / 60,
        "sees_room": True,
        "units": "m",
        "axes": ["x", "y", "z"],
        "people": [],
    }
    return json.dumps(scene | changes)


def address(ear: Any) -> str:
    return f"ws://127.0.0.1:{ear.port}"


def test_a_program_connects_and_is_heard(hear: Hear) -> None:
    ear = hear("websocket", port=0)
    with connect(address(ear)) as program:
        program.send(text(1))
        program.send(text(2).encode())
        program.send([text(3)[:10], text(3)[10:]])  # in fragments
        program.ping().wait(5)
        assert [scene.sequence for scene in ear.scenes(3)] == [1, 2, 3]
    ear.wait(lambda: ear.counters.disconnects == 1)
    with connect(address(ear)) as program:
        program.send(text(4))
        ear.scene()
    assert ear.counters.reconnects == 1


def test_web_pages_are_let_in_by_origin_alone(hear: Hear) -> None:
    ear = hear("websocket", port=0, origins=["https://cell.example"])
    elsewhere, cell = Origin("https://elsewhere.example"), Origin("https://cell.example")
    with pytest.raises(InvalidStatus, match="403"), connect(address(ear), origin=elsewhere):
        pass
    with connect(address(ear), origin=cell) as page:
        page.send(text(1))
        ear.scene()


def test_what_is_no_scene_is_counted_and_what_is_no_websocket_hung_up_on(hear: Hear) -> None:
    ear = hear("websocket", port=0)
    with connect(address(ear)) as program:
        program.send("{}")
        program.send(b"\xff\xfe")
        program.send(text(1))
        ear.scene()
        assert ear.counters.malformed == 2
        program.send("x" * (MAX_BYTES + 1))
        with pytest.raises(ConnectionClosedError, match="1009"):  # too big
            program.recv(10)
    assert ear.counters.malformed == 3
    for count, noise in enumerate((b"\0" * 10_000, b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\r\n")):
        with socket.create_connection(("127.0.0.1", ear.port)) as stranger:
            stranger.sendall(noise + b"\r\n\r\n")
            with contextlib.suppress(ConnectionResetError):
                while stranger.recv(4096):
                    pass
        assert ear.counters.malformed == 4 + count
    with connect(address(ear)) as program:
        program.send(text(2))
        ear.scene()


def test_we_connect_to_a_server_and_come_back_when_it_does(hear: Hear) -> None:
    sequences = iter((100, 0))

    def send_one(connection: ServerConnection) -> None:
        connection.send(text(next(sequences)))

    with serve(send_one, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.socket.getsockname()[1]
        ear = hear("websocket", url=f"ws://127.0.0.1:{port}/scenes")
        assert len(ear.scenes(2)) == 2
    assert ear.counters.disconnects >= 1
    assert ear.counters.restarts == 1


def test_nobody_there_says_so(hear: Hear) -> None:
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        port = nobody.getsockname()[1]
    with pytest.raises(SourceError, match="start the server"):
        hear("websocket", url=f"ws://127.0.0.1:{port}")
    with pytest.raises(ConfigError, match="must begin with ws://"):
        validated(
            WebSocketSettings,
            {"kind": "websocket", "room_from_source": {}, "rate_hz": 30, "url": "http://x"},
            "source",
        )


@pytest.mark.parametrize("url", ["ws://", "ws://[", "wss://x:99999", "ws://x:y"])
def test_an_address_that_is_none_is_refused_before_anything_starts(url: str) -> None:
    data = {"kind": "websocket", "room_from_source": {}, "rate_hz": 30, "url": url}
    with pytest.raises(ConfigError, match=r"source: url: .*give it as ws://"):
        validated(WebSocketSettings, data, "source")
