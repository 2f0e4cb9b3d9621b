"""NatNet's packets for skeletons: versions 4.1 and later 4.x (Motive 3.1 and later).

Source: the NatNet SDK's documentation (docs.optitrack.com, "NatNet: Data Types") and the packets
that its samples decode. Little-endian. A packet is u16 message, u16 bytes that follow.

==================  ============================================================================
server information  text in 256 bytes, u8[4] version of Motive, u8[4] version of NatNet
model definitions   i32 count, each i32 type, i32 bytes, and the definition. Of a skeleton (2):
                    name, i32 id, i32 count, each bone: name, i32 id, i32 parent, f32[3] offset, and
                    in 4.2 f32[4]; then i32 n, f32[3] n, i32 n, and n names of markers
frame               i32 number; sections of marker sets, other markers, rigid bodies, skeletons,
                    assets, labelled markers, force plates and devices, each i32 count, i32 bytes;
                    u32 u32 time code, f64 time in s, more stamps; i16 parameters, i32 zero
skeleton            i32 id, i32 count, each bone: i32 id (its low 16 bits), f32[3] position,
                    f32[4] quaternion x, y, z, w, f32 error, i16 parameters (bit 0: tracked)
==================  ============================================================================

The package ``natnet`` reads these packets as well; it uses counts from the network as memory sizes,
so it serves only as the tests' reference.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hri_drivers.sources.mocap.frames import MAX_PEOPLE, FrameError
from hri_predict.base.arrays import Floats

CONNECT, SERVER_INFO, REQUEST_MODELS, MODELS, FRAME, KEEP_ALIVE = 0, 1, 4, 5, 7, 10
SKELETON = 2
SECTIONS_BEFORE, SECTIONS_AFTER = 3, 4
MAX_BONES = 200
_BONE = struct.Struct("<i3f4ffh")
_TAIL = struct.Struct("<hi")  # parameters, and the end of the data
MODELS_CHANGED = 2
TRACKED = 1


@dataclass(frozen=True, slots=True)
class Bone:
    """A bone of a skeleton in its definition.

    Attributes:
        name: without the skeleton's.
        parent: id of the parent; 0 of the root.
        offset: from the parent, metres.
    """

    name: str
    parent: int
    offset: tuple[float, float, float]


@dataclass(slots=True)
class Pose:
    """A skeleton in a frame: positions (3,) by bone id, and the ids of tracked bones."""

    positions: dict[int, Floats] = field(default_factory=dict)
    tracked: set[int] = field(default_factory=set)


@dataclass(frozen=True, slots=True)
class MocapFrame:
    """A frame: its number, time in seconds, skeletons by id, and whether models changed."""

    number: int
    time_s: float
    skeletons: dict[int, Pose]
    models_changed: bool


class Cursor:
    """Reads values from bytes that may end anywhere."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    @property
    def left(self) -> int:
        """Number of bytes that are left."""
        return len(self._data) - self.at

    def take(self, layout: struct.Struct) -> tuple[float, ...]:
        """The next values.

        Raises:
            FrameError: the data end too early.
        """
        self.skip(layout.size)
        return layout.unpack_from(self._data, self.at - layout.size)

    def whole(self) -> int:
        """The next i32."""
        return int(self.take(_I32)[0])

    def count(self, each: int) -> int:
        """The next i32 as a number of items, each at least ``each`` bytes long."""
        count = self.whole()
        if not 0 <= count * each <= self.left:
            raise FrameError(f"{count} items where {self.left} bytes are left")
        return count

    def skip(self, size: int) -> None:
        """Skip bytes."""
        if not 0 <= size <= self.left:
            raise FrameError(f"a packet that ends {size - self.left} bytes too soon")
        self.at += size

    def text(self, most: int = 256) -> str:
        """The next text, which ends with a zero."""
        end = self._data.find(b"\0", self.at, self.at + most)
        if end < 0:
            raise FrameError("a name without end")
        found = self._data[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return found


_I32, _F64, _TWO = struct.Struct("<i"), struct.Struct("<d"), struct.Struct("<2i")
_OFFSET = struct.Struct("<ii3f")


def payload(packet: bytes) -> tuple[int, bytes]:
    """The message and payload of a packet.

    Raises:
        FrameError: it is cut short.
    """
    if len(packet) < 4:
        raise FrameError("a packet without its header")
    message, size = struct.unpack_from("<HH", packet)
    if len(packet) - 4 < size:
        raise FrameError(f"a packet of {len(packet) - 4} of {size} bytes")
    return message, packet[4 : 4 + size]


def request(message: int) -> bytes:
    """A client's packet."""
    text = b"Ping\0" if message == CONNECT else b"\0"
    return struct.pack("<HH", message, len(text)) + text


def version(data: bytes) -> tuple[int, int]:
    """NatNet's version in the server's information.

    Raises:
        FrameError: the data end too early, or this version is not supported.
    """
    cursor = Cursor(data)
    cursor.skip(260)
    cursor.skip(2)
    found = data[260], data[261]
    if not (4, 1) <= found < (5, 0):
        raise FrameError(
            f"NatNet {found[0]}.{found[1]}; Motive 3.1 and later send 4.1, which this source reads"
        )
    return found


def models(data: bytes, natnet: tuple[int, int]) -> dict[int, dict[int, Bone]]:
    """The bones of each skeleton by id.

    Raises:
        FrameError: the definitions are damaged.
    """
    cursor, found = Cursor(data), {}
    for _ in range(cursor.count(8)):
        kind, size = cursor.whole(), cursor.whole()
        end = cursor.at + size
        if kind == SKELETON:
            skeleton, bones = _skeleton(cursor, natnet)
            found[skeleton] = bones
        cursor.skip(end - cursor.at)
    return found


def _skeleton(cursor: Cursor, natnet: tuple[int, int]) -> tuple[int, dict[int, Bone]]:
    name, skeleton = cursor.text(), cursor.whole()
    bones = {}
    for _ in range(cursor.count(_OFFSET.size)):
        bone = cursor.text()
        number, parent, *offset = cursor.take(_OFFSET)
        cursor.skip(16 if natnet >= (4, 2) else 0)
        markers = cursor.count(16)
        cursor.skip(16 * markers)
        for _ in range(markers):
            cursor.text()
        x, y, z = offset
        bones[int(number) & 0xFFFF] = Bone(_plain(bone, name), int(parent) & 0xFFFF, (x, y, z))
    return skeleton, bones


def _plain(bone: str, skeleton: str) -> str:
    """A bone's name without the skeleton's name, which Motive may put before it."""
    for mark in ("_", ":"):
        bone = bone.removeprefix(f"{skeleton}{mark}")
    return bone


def frame(data: bytes) -> MocapFrame:
    """A frame's skeletons.

    Raises:
        FrameError: the frame is damaged.
    """
    cursor = Cursor(data)
    number = cursor.whole()
    for _ in range(SECTIONS_BEFORE):
        _, size = (cursor.whole(), cursor.whole())
        cursor.skip(size)
    count, size = cursor.whole(), cursor.whole()
    end = cursor.at + size
    if not 0 <= count <= MAX_PEOPLE:
        raise FrameError(f"{count} skeletons; at most {MAX_PEOPLE}")
    skeletons = dict(_pose(cursor) for _ in range(count))
    if len(skeletons) < count:
        raise FrameError("a skeleton occurs twice in one frame")
    cursor.skip(end - cursor.at)
    for _ in range(SECTIONS_AFTER):
        _, size = (cursor.whole(), cursor.whole())
        cursor.skip(size)
    cursor.take(_TWO)  # the time code
    (time_s,) = cursor.take(_F64)
    cursor.skip(cursor.left - _TAIL.size)
    parameters, _ = cursor.take(_TAIL)
    return MocapFrame(number, time_s, skeletons, bool(int(parameters) & MODELS_CHANGED))


def _pose(cursor: Cursor) -> tuple[int, Pose]:
    skeleton, pose = cursor.whole(), Pose()
    for number, place, tracked in _bones(cursor):
        if number in pose.positions:
            raise FrameError("a bone occurs twice in one skeleton")
        pose.positions[number] = place
        if tracked:
            pose.tracked.add(number)
    return skeleton, pose


def _bones(cursor: Cursor) -> Iterator[tuple[int, Floats, bool]]:
    count = cursor.count(_BONE.size)
    if count > MAX_BONES:
        raise FrameError(f"a skeleton of {count} bones")
    for _ in range(count):
        number, x, y, z, *_, parameters = cursor.take(_BONE)
        yield int(number) & 0xFFFF, np.array([x, y, z]), bool(int(parameters) & TRACKED)
