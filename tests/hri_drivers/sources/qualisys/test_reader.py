"""From QTM's packets to captures, over a real connection as well, and any bytes."""

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.mocap.frames import Frame, FrameError
from hri_drivers.sources.qualisys import packets
from hri_drivers.sources.qualisys import source as qualisys_reader
from hri_drivers.sources.qualisys.source import PARAMETERS, STREAM, VERSION, QtmReader
from hri_predict.base.errors import ConfigError, SourceError
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders import qualisys

BODY = Body(1.75)
JOINTS = BODY.joints(BODY.standing(np.array([1.0, 2.0]), 0.3))
MAP = load_joint_map("qualisys24")
GREETING = (
    qualisys.packet(1, b"QTM RT Interface connected\0"),
    qualisys.packet(1, b"Version set to 1.25\0"),
    qualisys.parameters(["Ann", "Bob"]),
)
TOLERANCE_M = 1e-6  # 32 bits of millimetres up to 4096


class Client:
    """A reader, and what it has heard."""

    def __init__(self, knows: bool = True) -> None:
        self.counters = SourceCounters()
        self.reader = QtmReader(MAP.source_joints, self.counters)
        if knows:
            self.read(*GREETING)

    def read(self, *units: bytes) -> list[Frame]:
        found = [self.reader.read(data) for data in units]
        return [frame for frame in found if frame is not None]


def both(number: int = 1) -> bytes:
    return qualisys.data(number, 1_000_000 + number, {"Ann": JOINTS, "Bob": JOINTS + 1.0})


def twice() -> bytes:
    """A capture whose second segment has the first one's id."""
    first, second = (struct.pack("<I", qualisys.FIRST_ID + k) for k in range(2))
    return both().replace(second, first)


def test_it_asks_for_what_it_needs_in_order() -> None:
    client = Client(knows=False)
    wanted = [client.reader.wanted]
    for unit in (*GREETING, both()):
        client.read(unit)
        wanted.append(client.reader.wanted)
    assert wanted == [VERSION, VERSION, PARAMETERS, STREAM, None]
    client.read(qualisys.packet(4, b""))
    assert client.reader.wanted == STREAM
    assert "start the real-time preview" in str(client.counters.last_error)
    client.reader.reset()
    assert client.read(both(2)) == []
    assert client.reader.wanted == VERSION


def test_a_version_that_qtm_does_not_have_is_named() -> None:
    client = Client(knows=False)
    client.read(qualisys.packet(1, b"Version NOT supported\0"))
    assert client.reader.wanted == VERSION
    assert "Version NOT supported" in str(client.counters.last_error)


def test_every_joint_is_where_the_person_has_it() -> None:
    (frame,) = Client().read(both(7))
    assert (frame.number, frame.stamp_ns) == (7, 1_000_007_000)
    assert [person.id for person in frame.people] == [1, 2]
    joints, seen = MAP.map(MAP.to_metres_z_up(frame.people[0].positions), frame.people[0].observed)
    assert seen.sum() == 17
    assert np.abs(joints - JOINTS)[seen].max() < TOLERANCE_M


def test_a_segment_that_is_not_measured_is_not_observed() -> None:
    lost = JOINTS.copy()
    lost[:, :] = np.nan
    (frame,) = Client().read(qualisys.data(1, 1, {"Ann": lost, "Bob": JOINTS}))
    assert [bool(person.observed.any()) for person in frame.people] == [False, True]


def test_segments_in_local_coordinates_are_refused_by_name() -> None:
    with pytest.raises(FrameError, match="a relative stream"):
        Client().read(qualisys.data(1, 1, {"Ann": JOINTS, "Bob": JOINTS}, local=True))


def test_without_any_skeleton_the_room_is_not_seen() -> None:
    client = Client(knows=False)
    client.read(*GREETING[:2], qualisys.parameters([]))
    (frame,) = client.read(qualisys.data(1, 1_000_000, {}))
    assert not frame.tracks
    assert client.reader.wanted is None
    assert "define a skeleton for each person" in str(client.counters.last_error)


def test_other_skeletons_are_asked_for_again() -> None:
    client = Client()
    with pytest.raises(FrameError, match="requesting the parameters again"):
        client.read(qualisys.data(1, 1, {"Ann": JOINTS}))
    assert client.reader.wanted == PARAMETERS


def test_names_are_remembered_up_to_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qualisys_reader, "MOST_NAMES", 3)
    client = Client()

    def skeletons(*names: str) -> Frame:
        client.reader.wanted = PARAMETERS
        client.read(qualisys.parameters(list(names)))
        (frame,) = client.read(qualisys.data(1, 1_000_000, dict.fromkeys(names, JOINTS)))
        return frame

    assert [person.id for person in skeletons("Ann", "Bob").people] == [1, 2]
    assert [person.id for person in skeletons("Cid", "Ann").people] == [3, 1]
    with pytest.raises(FrameError, match="more than 3 names of skeletons"):
        skeletons("Dan", "Ann")


@pytest.mark.parametrize(
    ("unit", "says"),
    [
        (b"", "cut short"),
        (both()[:-1], "cut short"),
        (qualisys.packet(0, b"Parse error\0"), "QTM says: Parse error"),
        (qualisys.packet(3, b"\0" * 10), "cut short"),
        (qualisys.packet(3, b"\0" * 16), "solve skeletons"),
        (qualisys.data(1, 2**63 - 1, {"Ann": JOINTS, "Bob": JOINTS}), "a time that is not"),
        (qualisys.data(1, -1, {"Ann": JOINTS, "Bob": JOINTS}), "a time that is not"),
        (twice(), "a segment occurs twice"),
    ],
)
def test_what_is_not_a_capture_is_refused(unit: bytes, says: str) -> None:
    with pytest.raises(FrameError, match=says):
        Client().read(unit)


@pytest.mark.parametrize(
    "xml", [b"<a>", b"<!DOCTYPE x><a/>", b'<a><Skeleton><Segment ID="x"/></Skeleton></a>']
)
def test_parameters_that_are_not_skeletons_are_refused(xml: bytes) -> None:
    with pytest.raises(FrameError, match="parameters"):
        packets.names(xml)


def test_packets_are_found_in_a_stream_of_any_pieces() -> None:
    stream = b"".join(GREETING) + both()
    for size in (1, 7, 1000):
        splitter = packets.PacketSplitter()
        found = [
            p for at in range(0, len(stream), size) for p in splitter.feed(stream[at : at + size])
        ]
        assert found == [*GREETING, both()]
    with pytest.raises(SourceError, match="little-endian port"):
        list(packets.PacketSplitter().feed(b"\0\0\0\x24" * 4))


def test_the_makers_package_reads_what_the_stand_in_sends() -> None:
    oracle = pytest.importorskip("qtm_rt.packet", reason="needs the package qtm-rt, of extra dev")
    found: Any = oracle.QRTPacket(both(7)[8:])
    assert (found.framenumber, found.timestamp) == (7, 1_000_007)
    _, skeletons = found.get_skeletons()
    ours = packets.frame(both(7)[8:]).skeletons
    for theirs, segments in zip(skeletons, ours, strict=True):
        for number, place, _ in theirs:
            np.testing.assert_array_equal(segments[number], place)


@given(st.binary(max_size=80), st.integers(0, 2000), st.sampled_from([0, 1, 2, 3, 4]))
def test_any_bytes_are_a_capture_or_refused(junk: bytes, at: int, kind: int) -> None:
    client = Client()
    content = both()[8:]
    for unit in (
        junk,
        qualisys.packet(kind, junk),
        qualisys.packet(3, content[:at] + junk + content[at + len(junk) :]),
    ):
        try:
            frames = client.read(unit)
        except FrameError:
            continue
        for person in frames[0].people if frames else ():
            assert np.isfinite(person.positions[person.observed]).all()


@pytest.mark.realtime
def test_a_client_and_a_server_over_a_real_connection(hear: Callable[..., Any]) -> None:
    server = qualisys.Qtm(["Ann", "Bob"])
    ear = hear("qualisys", port=server.port, sees_room=True, rate_hz=100)
    number = [0]

    def heard() -> bool:
        number[0] += 1
        server.send(both(number[0]))
        return ear.counters.scenes >= 5

    ear.wait(heard)
    (person, _) = ear.scenes(1)[0].people
    joints, seen = MAP.map(person.positions, person.observed)
    assert np.abs(joints - JOINTS)[seen].max() < TOLERANCE_M
    server.close()


def test_a_wrong_configuration_is_refused_in_one_line() -> None:
    cls = registry.load("sources", "qualisys")
    for change, says in (
        ({}, "sees_room: required"),
        ({"sees_room": True, "host": "10.0.0.2"}, "allow_unauthenticated"),
    ):
        data = {"kind": "qualisys", "room_from_source": {}, "rate_hz": 100} | change
        with pytest.raises(ConfigError, match=says):
            cls(validated(cls.settings_model, data, "source"))
