"""From NatNet's packets to captures, over a real socket as well, and any bytes."""

import struct
from collections.abc import Callable, Iterator
from struct import pack
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.mocap.frames import Frame, FrameError
from hri_drivers.sources.natnet import packets
from hri_drivers.sources.natnet.source import AXES, DAMAGED, NatNetReader
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders import natnet

BODY = Body(1.75)
JOINTS = BODY.joints(BODY.standing(np.array([1.0, 2.0]), 0.3))
MAP = load_joint_map("motive21").with_axes(AXES["y"])
NAMES = {3: "Ann", 5: "Bob"}
TOLERANCE_M = 1e-6  # 32 bits of metres up to 4


class Client:
    """A reader, and what it has heard."""

    def __init__(self, knows: bool = True) -> None:
        self.counters = SourceCounters()
        self.reader = NatNetReader(MAP.source_joints, self.counters)
        if knows:
            self.read(natnet.server_info(), natnet.model_definitions(NAMES))

    def read(self, *datagrams: bytes) -> list[Frame]:
        found = [self.reader.read(data) for data in datagrams]
        return [frame for frame in found if frame is not None]


def test_it_asks_for_what_it_needs_in_order() -> None:
    client = Client(knows=False)
    assert client.reader.wanted == packets.CONNECT
    assert client.read(natnet.frame(1, 1.0, {3: JOINTS})) == []
    client.read(natnet.server_info())
    assert client.reader.wanted == packets.REQUEST_MODELS
    assert client.read(natnet.frame(2, 1.0, {3: JOINTS})) == []
    assert "before the model definitions" in str(client.counters.last_error)
    client.read(natnet.model_definitions(NAMES))
    assert client.reader.wanted == packets.KEEP_ALIVE
    assert len(client.read(natnet.frame(3, 1.0, {3: JOINTS}))) == 1
    client.read(natnet.frame(4, 1.0, {3: JOINTS}, changed=True))
    assert client.reader.wanted == packets.REQUEST_MODELS
    client.reader.reset()
    assert client.reader.wanted == packets.CONNECT


@pytest.mark.parametrize("minor", [1, 2])
def test_every_joint_is_where_the_person_has_it(minor: int) -> None:
    client = Client(knows=False)
    client.read(natnet.server_info((4, minor, 0, 0)), natnet.model_definitions(NAMES, minor))
    (frame,) = client.read(natnet.frame(7, 12.5, {3: JOINTS, 5: JOINTS + 1}))
    assert (frame.number, frame.stamp_ns) == (7, 12_500_000_000)
    assert [person.id for person in frame.people] == [3, 5]
    joints, seen = MAP.map(MAP.to_metres_z_up(frame.people[0].positions), frame.people[0].observed)
    assert seen.sum() == 17
    assert np.abs(joints - JOINTS)[seen].max() < TOLERANCE_M


def test_a_bone_that_is_not_tracked_is_not_observed() -> None:
    (frame,) = Client().read(natnet.frame(1, 1.0, {3: JOINTS}, untracked=["LHand"]))
    (person,) = frame.people
    lost = np.flatnonzero(~person.observed)
    assert [MAP.source_joints[k] for k in lost] == ["LHand"]


def test_bones_in_local_coordinates_are_refused_by_name() -> None:
    with pytest.raises(FrameError, match="a relative stream: bones are in local coordinates"):
        Client().read(natnet.frame(1, 1.0, {3: JOINTS}, local=True))


@pytest.mark.parametrize("at", [0.0, np.nan, np.inf])
@pytest.mark.parametrize("tracked", [False, True])
def test_a_bone_that_is_not_measured_does_not_hide_local_coordinates(
    at: float, tracked: bool
) -> None:
    if tracked and at == 0.0:
        pytest.skip("a measured bone that is not at its offset: not local coordinates")
    lost = natnet.BONES.index("LHand") + 1
    frame = natnet.frame(
        1, 1.0, {3: JOINTS}, local=True, untracked=[] if tracked else ["LHand", "RHand"]
    )
    there, moved = (pack("<i3f", 3 << 16 | lost, *place) for place in (natnet.OFFSET, (at, at, at)))
    assert frame.count(there) == 1
    with pytest.raises(FrameError, match="a relative stream: bones are in local coordinates"):
        Client().read(frame.replace(there, moved))


def test_without_any_skeleton_the_room_is_not_seen() -> None:
    client = Client(knows=False)
    client.read(natnet.server_info(), natnet.model_definitions({}))
    (frame,) = client.read(natnet.frame(1, 1.0, {}))
    assert not frame.tracks
    assert "enable Skeletons" in str(client.counters.last_error)
    client.read(natnet.model_definitions(NAMES))
    (frame,) = client.read(natnet.frame(2, 1.01, {}))
    assert frame.tracks


def test_a_frame_without_skeletons_is_a_scene_without_people() -> None:
    (frame,) = Client().read(natnet.frame(1, 1.0, {}))
    assert frame.people == ()


def test_a_skeleton_or_bone_that_comes_twice_is_refused_and_no_person_left_out() -> None:
    frame = natnet.frame(1, 1.0, {3: JOINTS, 5: JOINTS + 1})
    skeleton = struct.pack("<ii", 5, len(natnet.BONES))
    assert frame.count(skeleton) == 1
    with pytest.raises(FrameError, match="a skeleton occurs twice"):
        Client().read(frame.replace(skeleton, struct.pack("<ii", 3, len(natnet.BONES))))
    with pytest.raises(FrameError, match="a bone occurs twice"):
        Client().read(frame.replace(struct.pack("<i", 5 << 16 | 2), struct.pack("<i", 5 << 16 | 1)))


def test_a_new_skeleton_is_asked_for() -> None:
    client = Client()
    with pytest.raises(FrameError, match="without a model definition"):
        client.read(natnet.frame(1, 1.0, {9: JOINTS}))
    assert client.reader.wanted == packets.REQUEST_MODELS


@pytest.mark.parametrize("version", [(3, 1, 0, 0), (4, 0, 0, 0), (5, 0, 0, 0)])
def test_another_version_is_refused_by_name(version: tuple[int, ...]) -> None:
    with pytest.raises(FrameError, match=r"Motive 3.1 and later send 4.1"):
        Client(knows=False).read(natnet.server_info(version))


def test_frames_that_stay_damaged_start_the_exchange_again() -> None:
    client = Client()
    damaged = natnet.packet(natnet.FRAME, b"\0" * 20)
    for _ in range(DAMAGED):
        with pytest.raises(FrameError):
            client.read(damaged)
    assert client.reader.wanted == packets.CONNECT


def test_counts_from_the_network_are_bounded() -> None:
    for count in (-1, 65, 2**31 - 1):
        head = pack("<i", 1) + pack("<ii", 0, 0) * 3
        with pytest.raises(FrameError, match="skeletons"):
            packets.frame(head + pack("<ii", count, 0) + bytes(100))


def test_an_independent_reader_reads_what_the_stand_in_sends() -> None:
    pytest.importorskip("natnet", reason="needs the package natnet, of the extra dev")
    from natnet.data_descriptions import DataDescriptions
    from natnet.data_frame import DataFrame
    from natnet.packet_buffer import PacketBuffer
    from natnet.version import Version

    version = Version(4, 1)
    data = natnet.frame(7, 12.5, {3: JOINTS}, untracked=["Head"])
    found: Any = DataFrame.read_from_buffer(PacketBuffer(data[4:]), version)
    assert (found.prefix.frame_number, found.suffix.timestamp) == (7, 12.5)
    (skeleton,) = found.skeletons
    ours = packets.frame(data[4:]).skeletons[3]
    for bone in skeleton.rigid_bodies:
        number = bone.id_num & 0xFFFF
        np.testing.assert_array_equal(ours.positions[number], bone.pos)
        assert (number in ours.tracked) == bone.tracking_valid
    models = natnet.model_definitions(NAMES)[4:]
    body = pack("<i", 2) + models[4 + 20 :]  # without the rigid body, which is cut short
    described: Any = DataDescriptions.read_from_buffer(PacketBuffer(body), version)
    bones = packets.models(models, (4, 1))[5]
    for theirs in described.skeletons[1].rigid_body_descriptions:
        assert theirs.name == f"Bob_{bones[theirs.id_num].name}"
        assert theirs.parent_id == bones[theirs.id_num].parent


@given(st.binary(max_size=80), st.integers(0, 1500), st.sampled_from([1, 5, 7, 8]))
def test_any_bytes_are_a_capture_or_refused(junk: bytes, at: int, message: int) -> None:
    client = Client()
    sound = natnet.frame(1, 1.0, {3: JOINTS})
    models = natnet.model_definitions(NAMES)
    for data in (
        junk,
        natnet.packet(message, junk),
        models[:at] + junk + models[at + len(junk) :],
        sound[:at] + junk + sound[at + len(junk) :],
    ):
        try:
            frames = client.read(data)
        except FrameError:
            continue
        for person in frames[0].people if frames else ():
            assert np.isfinite(person.positions[person.observed]).all()


@pytest.fixture
def motive() -> Iterator[natnet.Motive]:
    server = natnet.Motive(NAMES)
    yield server
    server.close()


@pytest.mark.realtime
def test_a_client_and_a_server_over_real_sockets(
    hear: Callable[..., Any], motive: natnet.Motive
) -> None:
    ear = hear("natnet", command_port=motive.port, sees_room=True, rate_hz=120)
    number = [0]

    def heard() -> bool:
        number[0] += 1
        motive.send(natnet.frame(number[0], number[0] / 120, {3: JOINTS}))
        return ear.counters.scenes >= 5

    ear.wait(heard)
    scene = ear.scenes(1)[0]
    (person,) = scene.people
    joints, seen = MAP.map(person.positions, person.observed)
    assert scene.sees_room
    assert np.abs(joints - JOINTS)[seen].max() < TOLERANCE_M


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({}, "sees_room: required"),
        ({"sees_room": True, "server": "studio"}, "IPv4 address"),
        ({"sees_room": True, "server": "10.0.0.2"}, "allow_unauthenticated"),
        (
            {"sees_room": True, "server": "10.0.0.2", "allow_unauthenticated": True},
            "does not reach the server",
        ),
        ({"sees_room": True, "multicast_group": "10.0.0.1"}, "must be an IPv4 multicast"),
        ({"sees_room": True, "multicast_group": "239.255.42.99"}, "allow_unauthenticated"),
    ],
)
def test_a_wrong_configuration_is_refused_in_one_line(change: dict[str, Any], says: str) -> None:
    cls = registry.load("sources", "natnet")
    data = {"kind": "natnet", "room_from_source": {}, "rate_hz": 120} | change
    with pytest.raises(ConfigError, match=says) as error:
        cls(validated(cls.settings_model, data, "source"))
    assert "\n" not in str(error.value)


def test_z_up_is_configured() -> None:
    cls = registry.load("sources", "natnet")
    data = {"kind": "natnet", "room_from_source": {}, "rate_hz": 120, "sees_room": True}
    source = cls(validated(cls.settings_model, data | {"up": "z"}, "source"))
    np.testing.assert_array_equal(source.joint_map.rotation, np.eye(3))
    source = cls(validated(cls.settings_model, data, "source"))
    np.testing.assert_array_equal(source.joint_map.rotation, MAP.rotation)
