"""Packets of the QTM RT protocol, version 1.25, little-endian.

Source: Qualisys, "QTM Real-time Server Protocol Documentation" (docs.qualisys.com/qtm-rt-protocol),
and the layouts of the maker's package qtm-rt, which the tests use as a reference. A packet is u32
total bytes, u32 type, content. Of data (3): i64 time in microseconds, u32 frame, u32 components,
each u32 total bytes, u32 type; of skeletons (18): u32 skeletons, each u32 segments, each u32 id,
f32[3] position in millimetres, f32[4] quaternion x, y, z, w. NaN: not measured.
"""

import struct
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hri_drivers.sources.mocap.frames import MAX_PEOPLE, MAX_STAMP_S, FrameError
from hri_predict.base.arrays import Floats
from hri_predict.base.errors import SourceError

ERROR, COMMAND, XML, DATA, NO_MORE_DATA = 0, 1, 2, 3, 4
SKELETON = 18
MAX_BYTES = 1 << 20
_HEAD, _DATA, _SEGMENT = struct.Struct("<II"), struct.Struct("<qII"), struct.Struct("<I7f")
_COUNT = struct.Struct("<I")
_MAX_US = int(MAX_STAMP_S * 1e6)

Segments = dict[int, Floats]
"""Positions (3,) in millimetres, by segment id."""


@dataclass(frozen=True, slots=True)
class QtmFrame:
    """A data packet: time in microseconds, frame number, skeletons in the server's order."""

    time_us: int
    number: int
    skeletons: list[Segments]


class PacketSplitter:
    """Finds packets in the bytes of a connection; buffers at most one of ``MAX_BYTES``."""

    def __init__(self) -> None:
        self._buffer = b""

    @property
    def waits(self) -> bool:
        """Whether an incomplete packet is buffered."""
        return bool(self._buffer)

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes as they arrive; yield the packets that they complete.

        Raises:
            SourceError: they are not packets; only a new connection helps.
        """
        self._buffer += data
        while len(self._buffer) >= _HEAD.size:
            size, _ = _HEAD.unpack_from(self._buffer)
            if not _HEAD.size <= size <= MAX_BYTES:
                raise SourceError(
                    f"a packet of {size} bytes: not QTM's little-endian port; correct 'port'"
                )
            if len(self._buffer) < size:
                return
            packet, self._buffer = self._buffer[:size], self._buffer[size:]
            yield packet


def command(text: str) -> bytes:
    """A client's command."""
    content = text.encode("ascii") + b"\0"
    return _HEAD.pack(_HEAD.size + len(content), COMMAND) + content


def content(packet: bytes) -> tuple[int, bytes]:
    """Type and content of a packet.

    Raises:
        FrameError: it is cut short.
    """
    if len(packet) < _HEAD.size or _HEAD.unpack_from(packet)[0] != len(packet):
        raise FrameError("a packet that is cut short")
    return int(_HEAD.unpack_from(packet)[1]), packet[_HEAD.size :]


def names(data: bytes) -> list[tuple[str, dict[int, str]]]:
    """Return each skeleton's name and segments by id, in the order of the parameters.

    Raises:
        FrameError: they are not XML with skeletons.
    """
    text = data.rstrip(b"\0")
    if b"<!" in text:
        raise FrameError("parameters with a document type or entities")
    try:
        root = ET.fromstring(text.decode("utf-8"))
        found = [
            (
                each.get("Name", ""),
                {int(part.get("ID", "")): part.get("Name", "") for part in each.iter("Segment")},
            )
            for each in root.iter("Skeleton")
        ]
    except (ET.ParseError, ValueError, RecursionError):
        raise FrameError("parameters without valid skeletons") from None
    if len(found) > MAX_PEOPLE:
        raise FrameError(f"more than {MAX_PEOPLE} skeletons")
    return found


def frame(data: bytes) -> QtmFrame:
    """A data packet's skeletons.

    Raises:
        FrameError: it is damaged, or has no skeletons.
    """
    try:
        time_us, number, components = _DATA.unpack_from(data)
        if not 0 <= time_us <= _MAX_US:
            raise FrameError("a time that is not microseconds of QTM's clock")
        at = _DATA.size
        for _ in range(min(components, 64)):
            size, kind = _HEAD.unpack_from(data, at)
            if not _HEAD.size <= size <= len(data) - at:
                raise FrameError("a component that is cut short")
            if kind == SKELETON:
                part = data[at + _HEAD.size : at + size]
                return QtmFrame(time_us, number, list(_skeletons(part)))
            at += size
    except struct.error:
        raise FrameError("data cut short") from None
    raise FrameError("data without skeletons; solve skeletons in QTM's real-time actions")


def _skeletons(data: bytes) -> Iterator[Segments]:
    (count,) = _COUNT.unpack_from(data)
    if count > MAX_PEOPLE:
        raise FrameError(f"{count} skeletons; at most {MAX_PEOPLE}")
    at = _COUNT.size
    for _ in range(count):
        (segments,) = _COUNT.unpack_from(data, at)
        at += _COUNT.size
        if segments * _SEGMENT.size > len(data) - at:
            raise FrameError(f"{segments} segments where {len(data) - at} bytes are left")
        found = {}
        for _ in range(segments):
            number, x, y, z, *_ = _SEGMENT.unpack_from(data, at)
            if number in found:
                raise FrameError("a segment occurs twice in one skeleton")
            found[number] = np.array([x, y, z])
            at += _SEGMENT.size
        yield found
