"""JSON scenes over real TCP connections."""

import json
import socket
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hri_drivers.sources import tcp as stream_receiver
from hri_drivers.sources.scene_json.codec import LineSplitter
from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.source import SourceCounters

pytestmark = pytest.mark.realtime

Hear = Callable[..., Any]


def line(sequence: int, **changes: Any) -> bytes:
    """A scene as any program may write it."""
    scene = {
        "format": "hri-scene/1",
        "sequence": sequence,
        "stamp_s": sequence / 60 % 1e6,
        "sees_room": True,
        "units": "mm",
        "axes": ["x", "y", "z"],
        "people": [{"id": 1, "joints": {"head": [1000, 2000, 1600]}}],
    }
    return json.dumps(scene | changes).encode() + b"\n"


def connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port))


def test_a_program_connects_and_is_heard(hear: Hear) -> None:
    pose = {"xyz": [0, 0, 1], "quaternion_xyzw": [0, 0, 1, 0]}  # half a turn, a metre up
    ear = hear("json", port=0, room_from_source=pose)
    with connect(ear.port) as program:
        program.sendall(line(1) + line(2)[:20])
        program.sendall(line(2)[20:] + line(5, people=[]))
        first, second, empty = ear.scenes(3)
    (person,) = first.people
    joints, observed = ear.source.joint_map.map(person.positions, person.observed)
    np.testing.assert_allclose(joints[observed], [[-1.0, -2.0, 2.6]], atol=1e-9)
    assert (first.sequence, second.sequence, empty.sequence) == (1, 2, 5)
    assert second.stamp_ns == 33_333_333
    assert empty.sees_room
    assert not empty.people
    assert ear.counters.lost == 2


def test_we_connect_to_a_program_and_come_back_when_it_does(hear: Hear) -> None:
    with socket.create_server(("127.0.0.1", 0)) as program:
        port = program.getsockname()[1]
        ear = hear("json", role="client", port=port)
        for sequence in (100, 0):  # the second time it begins anew
            connection, _ = program.accept()
            connection.sendall(line(sequence) + b"{")
            ear.scene()
            connection.close()
            ear.wait(lambda: not ear.source.connected)
    assert ear.counters.disconnects == 2
    assert ear.counters.reconnects == 1
    assert ear.counters.restarts == 1


def test_nobody_there_says_so_or_is_waited_for(hear: Hear) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(SourceError, match="another program"):
            hear("json", port=port)
    with pytest.raises(SourceError, match="connection refused; start the sender"):
        hear("json", role="client", port=port)
    ear = hear("json", role="client", port=port, wait_for_device=True)
    with socket.create_server(("127.0.0.1", port)) as late:
        connection, _ = late.accept()
        connection.sendall(line(1))
        ear.scene()
        connection.close()


def test_a_sequence_that_jumps_begins_anew(hear: Hear) -> None:
    ear = hear("json", port=0)
    with connect(ear.port) as program:
        program.sendall(line(1) + line(2**60) + line(0))
        numbers = [scene.sequence for scene in ear.scenes(3)]
    assert numbers == [1, 2, 3]
    assert (ear.counters.lost, ear.counters.restarts) == (0, 2)


def test_nobody_takes_the_place_of_a_program_that_is_heard(hear: Hear) -> None:
    ear = hear("json", port=0)
    with connect(ear.port) as program:
        program.sendall(line(1))
        ear.scene()
        with connect(ear.port) as other:
            assert other.recv(1) == b""  # hung up
        program.sendall(line(2))
        ear.scene()
    assert ear.counters.refused == 1


def test_a_program_that_went_silent_gives_its_place(
    hear: Hear, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream_receiver, "SILENT_S", 0.0)
    ear = hear("json", port=0)
    with connect(ear.port) as silent, connect(ear.port) as other:
        other.sendall(line(1))
        ear.scene()
        assert silent.recv(1) == b""
    assert ear.counters.disconnects >= 1


def test_a_byte_now_and_then_keeps_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(stream_receiver.time, "monotonic", lambda: now[0])
    server = stream_receiver.StreamServer(
        host="127.0.0.1", port=0, splitter=LineSplitter, places=1, counters=SourceCounters()
    )
    server.open()
    with connect(server.port) as slow:
        assert server.read(5.0) == []  # let in
        for now[0] in (1.0, 2.0, 3.0):
            slow.sendall(b" ")
            assert server.read(5.0) == []
        with connect(server.port) as other:
            assert server.read(5.0) == []
            other.sendall(b"scene\n")
            assert server.read(5.0) == [b"scene"]
            assert slow.recv(1) == b""
        server.close()


def test_what_is_no_scene_is_counted_explained_and_passed_over(hear: Hear) -> None:
    ear = hear("json", port=0)
    with connect(ear.port) as program:
        program.sendall(b"GET / HTTP/1.1\r\n\n" + line(1, units="cm") + b"\xff\n")
        program.sendall(b"x" * 200_000 + b"\n" + line(2, sees_room=False))
        assert not ear.scene().sees_room
        assert ear.counters.malformed == 4
        program.sendall(line(3, units="cm"))
        ear.wait(lambda: ear.counters.malformed == 5)
        assert "units" in ear.counters.last_error


def test_a_flood_is_cut_to_the_newest_and_counted(hear: Hear) -> None:
    ear = hear("json", port=0, rate_hz=10)
    with connect(ear.port) as program:
        program.sendall(b"".join(line(i) for i in range(300)))
        ear.wait(lambda: ear.counters.scenes == 300)
    taken = ear.scenes(1)
    assert taken[-1].sequence == 299
    assert len(taken) + ear.counters.overrun == 300


@pytest.mark.parametrize("kind", ["json", "websocket"])
def test_the_network_is_heard_only_if_that_is_said(kind: str) -> None:
    cls = registry.load("sources", kind)
    data = {"kind": kind, "room_from_source": {}, "rate_hz": 30, "host": "0.0.0.0"}
    with pytest.raises(ConfigError, match="allow_unauthenticated"):
        validated(cls.settings_model, data, "source")
    validated(cls.settings_model, data | {"allow_unauthenticated": True}, "source")
