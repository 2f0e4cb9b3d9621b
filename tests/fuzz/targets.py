"""Every decoder of bytes from outside, each with its seeds and a way to repair its checksum.

Most mutations die at a checksum; every other input has it repaired, so that what is behind is
reached as well. Decoders live as long as the run: what one input leaves behind meets the next.
"""

import contextlib
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from cobs import cobs

from hri_drivers.links.can.isotp import IsoTpReceiver
from hri_drivers.links.plant.codec import RegisterCodec
from hri_drivers.links.plant.image import Block
from hri_drivers.links.polled.reader import Sample
from hri_drivers.links.polled.reader import StateReader as PolledReader
from hri_drivers.links.polled.settings import JointAt, StateAt
from hri_drivers.links.rtde.link import RtdeCodec
from hri_drivers.links.rtde.packets import Packet as RtdePacket
from hri_drivers.links.rtde.packets import Splitter as RtdeSplitter
from hri_drivers.links.rtde.packets import framed as framed_packet
from hri_drivers.sources.live import LiveSource
from hri_drivers.sources.mvn.codec import StreamSplitter
from hri_drivers.sources.mvn.source import MvnDecoder, MvnSettings
from hri_drivers.sources.ros2.decoder import Ros2Decoder
from hri_drivers.sources.scene_json.codec import LineSplitter, SceneReader
from hri_drivers.sources.scene_json.json_source import JsonDecoder
from hri_drivers.sources.scene_stream import codec as scene_codec
from hri_drivers.sources.scene_stream.receiver import SceneStream
from hri_drivers.sources.scene_stream.serial_source import FramedStream, framed
from hri_drivers.sources.sent import SentScene
from hri_drivers.wires.ros2_heard import NO_GID, NO_SEQUENCE, TF, TF_STATIC, Heard
from hri_predict.base.arrays import Floats
from hri_predict.base.errors import LinkError
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import JointMap, load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_predict.operation.monitoring.fleet import Fleet
from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver
from hri_predict.protocol.definition import frame_table
from hri_predict.protocol.keyed import Keyed, key_of
from hri_predict.protocol.profile4 import Profile4Receiver
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.protocol.registers import STATE, packed
from hri_predict.protocol.ros.bodies import MARKER_ARRAY, POSE_ARRAY
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.messages import TF_MESSAGE
from hri_predict.protocol.ros.placing import READERS, PeopleReader
from hri_predict.protocol.ros.tracked import IDS_LIST
from hri_predict.protocol.ros.zed import OBJECTS
from hri_predict.protocol.serial import SerialReceiver
from hri_sim.senders import natnet as natnet_sender
from hri_sim.senders import qualisys as qtm_sender
from hri_sim.senders import rokoko as rokoko_sender
from hri_sim.senders import vmc as vmc_sender
from hri_sim.senders import zed_livelink as zed_sender
from tests.hri_drivers.sources.scene_streaming import KEY, UTC, joint_map, names

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "tests" / "corpus"
C_CORPUS = ROOT / "drivers" / "c" / "fuzz" / "corpus.txt"
ID_BYTES = 4
ISOTP_ID = DEFAULT_BASE_ID + 0x46


@dataclass(frozen=True)
class Target:
    """A decoder.

    Attributes:
        name: on the command line.
        seeds: inputs that it knows.
        feed: takes an input, and fails by any exception.
        repaired: the same input with a right checksum.
    """

    name: str
    seeds: Sequence[bytes]
    feed: Callable[[bytes], None]
    repaired: Callable[[bytes], bytes] | None = None


def targets() -> list[Target]:
    """All of them, each with a decoder of its own."""
    return [
        _can("classic", CanReceiver(fd=False), _repaired_classic),
        _can("fd", CanReceiver(fd=True), _repaired_fd),
        _isotp(),
        Target("serial", _seeds_of_c("serial"), _ignoring(SerialReceiver().feed)),
        _profile4(),
        _keyed(),
        _rtde(),
        _modbus(),
        _polled(),
        _scene_stream("scene_stream", 21, with_key=False),
        _scene_stream("scene_stream_long", 100, with_key=False),
        _scene_stream("scene_stream_key", 21, with_key=True),
        _serial_skeleton(),
        _json(),
        _mvn(in_stream=False),
        _mvn(in_stream=True),
        _vmc(),
        _rokoko(),
        _zed_livelink(),
        _natnet(),
        _qualisys(),
        *(_ros2(kind) for kind in READERS if find_spec("rosbags") is not None),
    ]


def _ignoring(call: Callable[[bytes], object]) -> Callable[[bytes], None]:
    def feed(data: bytes) -> None:
        call(data)

    return feed


def _checked(call: Callable[[bytes, int], Iterable[SentScene]]) -> Callable[[bytes], None]:
    """Feeds a live source's decoder, and looks at the scenes that come of it."""
    clock = iter(range(0, 1 << 62, 33_000_000))

    def feed(data: bytes) -> None:
        for scene in call(data, next(clock)):
            for person in scene.people:
                assert np.isfinite(person.positions[person.observed]).all(), "no number"
                assert 0 <= person.id <= 65535, "an id that is none"

    return feed


def _seeds_of_c(kind: str) -> list[bytes]:
    """Those of the C decoder's corpus: ``classic ID HEX``, ``fd ID HEX``, ``serial HEX``."""
    found = []
    for line in C_CORPUS.read_text(encoding="ascii").splitlines():
        words = line.split()
        if words[0] == kind:
            number = b"" if kind == "serial" else int(words[1], 16).to_bytes(ID_BYTES, "little")
            found.append(number + bytes.fromhex(words[-1]))
    return found


def _files(folder: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((CORPUS / folder).iterdir())]


def _can(name: str, receiver: CanReceiver, repaired: Callable[[bytes], bytes]) -> Target:
    fd = name == "fd"

    def feed(data: bytes) -> None:
        identifier = int.from_bytes(data[:ID_BYTES], "little") & 0x7FF
        receiver.feed(CanFrame(identifier, data[ID_BYTES:], fd, False))

    return Target(name, _seeds_of_c(name), feed, repaired)


def _repaired_classic(data: bytes) -> bytes:
    number = (int.from_bytes(data[:ID_BYTES], "little") & 0x7FF) - DEFAULT_BASE_ID
    if number not in frame_table(classic=True) or len(data) < ID_BYTES + 8:
        return data
    frame = data[ID_BYTES : ID_BYTES + 8]
    return data[:ID_BYTES] + e2e.protect_profile2(frame[1], frame[2:], e2e.data_id_list(number))


def _repaired_fd(data: bytes) -> bytes:
    number = (int.from_bytes(data[:ID_BYTES], "little") & 0x7FF) - DEFAULT_BASE_ID
    if number not in frame_table(classic=False) or len(data) < ID_BYTES + 3:
        return data
    frame = data[ID_BYTES : ID_BYTES + 64]
    return data[:ID_BYTES] + e2e.protect_profile5(frame[2], frame[3:], e2e.data_id_16(number))


def _isotp() -> Target:
    receiver = IsoTpReceiver(DEFAULT_BASE_ID, False, ISOTP_ID)

    def feed(data: bytes) -> None:
        receiver.feed(CanFrame(ISOTP_ID, data[:8], False, False))

    # a single frame, a first frame, a consecutive frame, flow control
    hexes = ("0700010203040506", "1014000102030405", "21060708090a0b0c", "300008aaaaaaaaaa")
    return Target("isotp", [bytes.fromhex(text) for text in hexes], feed)


def _profile4() -> Target:
    receiver = Profile4Receiver()
    seeds = [cobs.decode(data.rstrip(b"\0")) for data in _seeds_of_c("serial")]

    def repaired(data: bytes) -> bytes:
        if len(data) < e2e.PROFILE_4_HEADER:
            return data
        counter, identifier = int.from_bytes(data[2:4], "big"), int.from_bytes(data[4:8], "big")
        return e2e.protect_profile4(counter, data[12:], identifier)

    return Target("profile4", seeds, _ignoring(receiver.take), repaired)


def _keyed() -> Target:
    """A payload under one of a cell's keys, which the first byte chooses, and the view of cells."""
    fleet, frames = Fleet(), [cobs.decode(data.rstrip(b"\0")) for data in _seeds_of_c("serial")]
    messages = ((Profile4Receiver().take(frame), frame) for frame in frames)
    units = [Keyed(key_of(message), frame) for message, frame in messages if message is not None]
    keys = [unit.key for unit in units]

    def feed(data: bytes) -> None:
        if data:
            fleet.take(Keyed(f"hri/site/cell/{keys[data[0] % len(keys)]}", data[1:]), 0)
            fleet.rows(0)

    def repaired(data: bytes) -> bytes:
        if len(data) < 1 + e2e.PROFILE_4_HEADER:
            return data
        counter, identifier = int.from_bytes(data[3:5], "big"), int.from_bytes(data[5:9], "big")
        return data[:1] + e2e.protect_profile4(counter, data[13:], identifier)

    seeds = [bytes((i,)) + unit.data for i, unit in enumerate(units)]
    return Target("keyed", seeds, feed, repaired)


def _rtde() -> Target:
    """What a controller sends over one connection, after the setup."""
    codec = RtdeCodec()
    state = struct.pack(">d12d2iI", 1.0, *[0.1] * 12, 7, 1, 2)
    text = b"\x05hello\x02ur\x01"

    def feed(data: bytes) -> None:
        with contextlib.suppress(LinkError):  # one line; the link connects again
            for kind, found in RtdeSplitter().feed(data):
                codec.decode(RtdePacket(kind, found))

    packets = [("U", b"\1" + state), ("U", state), ("M", text), ("S", b"\1")]
    return Target("rtde", [framed_packet(ord(kind), data) for kind, data in packets], feed)


def _modbus() -> Target:
    """An address, then the words that a PLC writes there."""
    codec = RegisterCodec(plc_timeout_s=1.0)
    codec.stand([0], [None])
    state = packed(STATE, {"STATE_COUNTER": 7, "ROBOT_MODE": 1, "JOINTS": 6})
    blocks = (
        Block.of(1000, [5]),
        Block.of(1000, [5, 77, 0, 9]),
        Block.of(1001, [7, 0, 8]),
        Block.of(1100, state),
    )

    def feed(data: bytes) -> None:
        codec.decode(Block(int.from_bytes(data[:2], "big"), data[2:]))

    return Target("modbus", [codec.raw(block) for block in blocks], feed)


def _polled() -> Target:
    """Doubles that a server has where a robot's state is: heartbeat, mode, one joint."""
    joints = [JointAt[int](position=2, velocity=4)]
    state = StateAt[int](heartbeat=0, mode=1, automatic_values=[1], joints=joints)
    reader = PolledReader(state, 1.0, 0.0, ReceiveCounters())

    def feed(data: bytes) -> None:
        values = struct.unpack_from(f">{len(data) // 8}d", data)
        reader.read(Sample(values, 0.02))

    return Target("polled", [struct.pack(">4d", n, 1.0, 0.5, 0.1) for n in range(4)], feed)


def _scene_stream(name: str, joints: int, with_key: bool) -> Target:
    key = KEY if with_key else None
    stream = SceneStream(
        joint_map=joint_map(joints),
        counters=SourceCounters(),
        key=key,
        max_skew_s=1e9,
        utc_ns=lambda: UTC,
    )
    tag = scene_codec.TAG_BYTES if with_key else scene_codec.CRC_BYTES

    def repaired(data: bytes) -> bytes:
        body = data[:-tag]
        return body + (KEY.tag(body) if with_key else scene_codec.crc(body))

    return Target(name, _files("scene_stream"), _checked(stream.feed), repaired)


def _serial_skeleton() -> Target:
    counters = SourceCounters()
    stream = FramedStream(
        SceneStream(
            joint_map=joint_map(21), counters=counters, key=None, max_skew_s=1e9, utc_ns=lambda: UTC
        ),
        counters,
    )
    seeds = [framed(data) for data in _files("scene_stream")]
    return Target("serial_skeleton", seeds, _checked(stream.feed))


def _json() -> Target:
    decoder = JsonDecoder(SceneReader(tuple(names(21)), 0.5, SourceCounters()))
    lines = LineSplitter()

    def feed(data: bytes, received_ns: int) -> list[SentScene]:
        return [scene for text in lines.feed(data) for scene in decoder.feed(text, received_ns)]

    return Target("json", _files("scene_json"), _checked(feed))


def _mvn(in_stream: bool) -> Target:
    settings = MvnSettings(
        kind="mvn", rate_hz=60, sees_room=True, room_from_source={"xyz": [0, 0, 0]}
    )
    joints: JointMap = load_joint_map("xsens23")
    decoder = MvnDecoder(settings, joints, SourceCounters())
    splitter = StreamSplitter()

    def feed(data: bytes, received_ns: int) -> list[SentScene]:
        units = splitter.feed(data) if in_stream else [data]
        return [scene for unit in units for scene in decoder.feed(unit, received_ns)]

    return Target("mvn_tcp" if in_stream else "mvn", _files("mvn"), _checked(feed))


def _body() -> Floats:
    return np.arange(63, dtype=np.float64).reshape(21, 3) / 40


def _mocap(kind: str, seeds: list[bytes]) -> Target:
    cls = registry.load("sources", kind)
    data = {"kind": kind, "rate_hz": 60, "sees_room": True, "room_from_source": {}}
    source = cls(validated(cls.settings_model, data, "source"))
    assert isinstance(source, LiveSource)
    return Target(kind, seeds, _checked(source._decoder.feed))


def _vmc() -> Target:
    seeds = [packet for k in range(4) for packet in vmc_sender.capture(_body() + k, k / 60)]
    return _mocap("vmc", seeds)


def _rokoko() -> Target:
    seeds = [rokoko_sender.capture({"a": _body() + k, "b": _body()}, k / 60) for k in range(3)]
    if find_spec("lz4") is not None:
        seeds.append(rokoko_sender.capture({"a": _body()}, 1.0, lz4=True))
    return _mocap("rokoko", seeds)


def _zed_livelink() -> Target:
    people = {1: _body() + 1, 2: _body() + 2}
    seeds = [zed_sender.for_unity(people, UTC), zed_sender.for_unity({}, UTC + 1)]
    seeds += [each for k in range(3) for each in zed_sender.for_unreal(people, UTC + k, k)]
    return _mocap("zed_livelink", [*seeds, zed_sender.camera(UTC, 9)])


def _natnet() -> Target:
    seeds = [natnet_sender.server_info(), natnet_sender.model_definitions({1: "a", 2: "b"})]
    people = {1: _body(), 2: _body() + 1}
    seeds += [natnet_sender.frame(k, k / 120, people) for k in range(3)]
    return _mocap("natnet", seeds)


def _qualisys() -> Target:
    people = {"a": _body(), "b": _body() + 1}
    seeds = [qtm_sender.packet(1, b"Version set to 1.25\0"), qtm_sender.parameters(["a", "b"])]
    return _mocap("qualisys", seeds + [qtm_sender.data(k, k * 10_000, people) for k in range(3)])


def _ros2(kind: str) -> Target:
    """A message of people, or of transforms, with its origin."""
    from tests.hri_predict.protocol.ros.sent import UPRIGHT, Maker

    made, body = Maker(), np.ones((2, 3))
    messages = {
        POSE_ARRAY: [made.poses(body), made.poses(body[:0])],
        MARKER_ARRAY: [made.markers({1: body}), made.marker_array([])],
        IDS_LIST: [made.tracked("a"), made.tracked()],
        OBJECTS: [made.objects({1: np.ones((18, 3))}), made.objects({})],
    }[kind]
    frames = made.transforms(
        ("map", "camera", (0.0, 0.0, 2.0), UPRIGHT), ("camera", "low_a", (1.0, 0.0, 0.0), UPRIGHT)
    )
    tree, names = FrameTree(), ["low", "high"]
    if kind == OBJECTS:
        names = [f"k{k}" for k in range(18)]
    decoder = Ros2Decoder(
        kind=kind,
        topics=["/people"],
        reader=PeopleReader(names, "map", tree),
        tree=tree,
        counters=SourceCounters(),
        sees_room=True,
    )
    contents = [(0, made.cdr(message, kind)) for message in messages]
    contents += [(topic, made.cdr(frames, TF_MESSAGE)) for topic in (TF, TF_STATIC)]
    seeds = [Heard(topic, NO_GID, NO_SEQUENCE, data).packed() for topic, data in contents]
    return Target(f"ros2_{kind.rsplit('/', 1)[-1]}", seeds, _checked(decoder.feed))
