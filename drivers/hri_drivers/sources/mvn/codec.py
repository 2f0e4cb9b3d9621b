"""Datagrams of the Xsens MVN network stream: their layout, and their assembly into samples.

Source: Xsens, "MVN real-time network streaming, Protocol Specification", MV0305P revision N,
September 2018; numbers in brackets are its clauses. Everything is big-endian. A datagram is a
header of 24 bytes [2.4.1] and a payload; the header states its length::

    6s ID string "MXTP" and two digits: the type   B  character ID: one per person
    I  sample counter                              B  body segments, 23
    B  datagram counter, bit 7: the last one       B  props, 0 to 4
    B  items in this datagram                      B  finger segments, 0 or 40
    I  time code, ms since the recording began     2x reserved
                                                   H  bytes of payload (0 before MVN 2019)

Two types are decoded; they hold one item for each segment [2.5.2, 2.5.3]:

- 01, 28 bytes: segment ID, position x y z, Euler angles x y z in degrees; y up, right-handed.
- 02, 32 bytes: segment ID, position x y z, quaternion w x y z; z up, right-handed.

Rotations are only checked, not used: the segments' origins place a person.

All other types (03 markers, 05 Unity3D, 12 meta data, 13 scale, 20 to 24 kinematics, 25 time code)
are counted and skipped: none of them gives positions of segments in the room.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from struct import Struct

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts.source import SourceCounters

DEFAULT_PORT = 9763  # [2.3]
SEGMENTS = 23
EULER, QUATERNION = 1, 2
ITEM_BYTES = {EULER: 28, QUATERNION: 32}
LAST = 0x80

HEADER = Struct(">6sIBBIBBBB2xH")
MAX_DATAGRAM = HEADER.size + 0xFFFF

NORM_TOLERANCE = 0.01  # "always normalized" [2.5.8], in 32-bit floats
MAX_DEGREES = 360.5

LATE_SAMPLES = 64
"""A sample behind by at most this many arrived late; if further behind, the sender restarted."""
LATE_RUN = 10
"""This many late datagrams in a row mean that the sender restarted soon after its start."""
GONE_AFTER = 3
"""A character missing from this many samples in a row has left the stream."""
MAX_LOST = 100_000
"""Maximum number of lost samples; a larger jump ahead means that the sender restarted."""


class MalformedDatagram(ValueError):
    """The bytes are not a datagram according to the specification."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Datagram:
    """One datagram; ``index`` counts the datagrams of one character's sample from 0."""

    type: int
    sample: int
    index: int
    last: bool
    items: int
    time_code_ms: int
    character: int
    payload: bytes


@dataclass(slots=True)
class MvnPose:
    """One character in one sample, in the stream's own units and axes.

    Attributes:
        positions: (23, 3) origins of the body segments, by index; NaN where not sent.
        observed: (23,) which segments were sent, with finite numbers and a valid rotation.
    """

    positions: Floats = field(default_factory=lambda: np.full((SEGMENTS, 3), np.nan))
    observed: Bools = field(default_factory=lambda: np.zeros(SEGMENTS, np.bool_))


@dataclass(frozen=True, slots=True)
class Sample:
    """All characters at one sampling instance."""

    counter: int
    time_code_ms: int
    poses: dict[int, MvnPose]


def parse(data: bytes) -> Datagram:
    """Decode header and length of a whole datagram.

    Raises:
        MalformedDatagram: it is not a datagram.
    """
    if len(data) < HEADER.size:
        raise MalformedDatagram("shorter than a header")
    tag, sample, counter, items, time_code, character, _, _, _, size = HEADER.unpack_from(data)
    if tag[:4] != b"MXTP" or not tag[4:].isdigit():
        raise MalformedDatagram("it does not start with MXTP and two digits")
    number = int(tag[4:])
    payload = data[HEADER.size :]
    expected = items * ITEM_BYTES[number] if number in ITEM_BYTES else size or len(payload)
    if len(payload) != expected or size not in (0, expected):
        raise MalformedDatagram("its length differs from its header")
    return Datagram(
        type=number,
        sample=sample,
        index=counter & ~LAST,
        last=bool(counter & LAST),
        items=items,
        time_code_ms=time_code,
        character=character,
        payload=payload,
    )


def add_segments(datagram: Datagram, pose: MvnPose) -> None:
    """Put the body segments of a datagram of type 01 or 02 into ``pose``; skip props and fingers.

    A segment with an invalid position or rotation stays unobserved.
    """
    columns = ITEM_BYTES[datagram.type] // 4
    items = np.frombuffer(datagram.payload, ">u4").reshape(-1, columns)
    ids = items[:, 0].astype(np.int64)
    with np.errstate(all="ignore"):  # some bytes are signalling NaNs
        floats = np.frombuffer(datagram.payload, ">f4").reshape(-1, columns)
        numbers = floats[:, 1:].astype(np.float64)
        sound = np.isfinite(numbers).all(axis=1) & _rotations(datagram.type, numbers[:, 3:])
    body = (ids >= 1) & (ids <= SEGMENTS)  # an ID is the index plus one [3.1]
    index = ids[body] - 1
    pose.positions[index] = np.where(sound[body, None], numbers[body, :3], np.nan)
    pose.observed[index] = sound[body]


def _rotations(number: int, rotations: Floats) -> Bools:
    if number == EULER:
        return np.asarray((np.abs(rotations) <= MAX_DEGREES).all(axis=1))
    return np.asarray(np.abs(np.linalg.norm(rotations, axis=1) - 1.0) <= NORM_TOLERANCE)


class StreamSplitter:
    """Finds datagrams in a stream of bytes (TCP); buffers at most one.

    Bytes between datagrams are also returned, so that the decoder can refuse and count them.
    """

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes as they arrive; yield the datagrams that they complete."""
        self._buffer += data
        while len(self._buffer) >= HEADER.size:
            length = self._length() if self._starts() else self._garbage()
            if len(self._buffer) < length:
                return
            unit, self._buffer = self._buffer[:length], self._buffer[length:]
            yield unit

    def _starts(self) -> bool:
        return self._buffer.startswith(b"MXTP") and self._buffer[4:6].isdigit()

    def _length(self) -> int:
        """Length of the datagram that starts here."""
        tag, _, _, items, _, _, _, _, _, size = HEADER.unpack_from(self._buffer)
        return HEADER.size + int(size or items * ITEM_BYTES.get(int(tag[4:]), 0))

    def _garbage(self) -> int:
        """Number of bytes before the next possible start of a datagram."""
        at = self._buffer.find(b"MXTP", 1)
        return len(self._buffer) - 3 if at < 0 else at  # 3: "MXT" may be a start


@dataclass(slots=True)
class _Part:
    """The datagrams received so far for one character's sample."""

    pose: MvnPose = field(default_factory=MvnPose)
    indices: set[int] = field(default_factory=set)
    last: int | None = None

    @property
    def whole(self) -> bool:
        return self.last is not None and self.indices == set(range(self.last + 1))


class Assembler:
    """Assembles datagrams into samples of all people in the stream.

    Each character has its own datagrams [2.4.1.6], several if one would be too long [2.4.1.3]. A
    sample is whole when all datagrams of all characters in the stream have arrived. If the next
    sample starts before that, the sample is dropped and counted, so that a lost datagram does not
    make a person vanish. A character missing from ``GONE_AFTER`` samples in a row has left.

    Args:
        number: the type to decode, 1 or 2; other types are only counted.
        samples_per_scene: increment of the sample counter between two sent samples; above 1 if MVN
            streams fewer samples than it captures.
        counters: counts ``ignored``, ``lost``, ``incomplete``, ``out_of_order``, ``replayed``.

    Attributes:
        session: increases when the sample counter restarts.
        refused: the newest datagram, if it was late or came twice.
    """

    def __init__(self, number: int, samples_per_scene: float, counters: SourceCounters) -> None:
        self.session = 0
        self.refused: Datagram | None = None
        self._type = number
        self._step = samples_per_scene
        self._counters = counters
        self._known: dict[int, int] = {}  # characters: samples in a row in which it was missing
        self._sample: int | None = None
        self._parts: dict[int, _Part] = {}
        self._given = False  # the current sample was whole and has been returned
        self._late = 0  # datagrams in a row

    def reset(self) -> None:
        """Discard everything except the counters, as after a reconnection."""
        self._known.clear()
        self._sample, self._parts, self._given = None, {}, False

    def add(self, datagram: Datagram) -> Sample | None:
        """Take one datagram; return the sample that it completes, if any."""
        self.refused = None
        if datagram.type != self._type:
            self._counters.ignored += 1
            return None
        if not self._reach(datagram.sample):
            self._counters.out_of_order += 1
            self.refused = datagram
            return None
        self._known.setdefault(datagram.character, 0)
        if self._given and datagram.character not in self._parts:
            self._counters.out_of_order += 1  # a new character: the next sample waits for it
            return None
        part = self._parts.setdefault(datagram.character, _Part())
        if datagram.index in part.indices:
            self._counters.replayed += 1
            self.refused = datagram
            return None
        part.indices.add(datagram.index)
        if datagram.last:
            part.last = datagram.index
        add_segments(datagram, part.pose)
        if self._given or not self._whole():
            return None
        self._given = True
        self._known = dict.fromkeys(self._known, 0)
        poses = {number: part.pose for number, part in sorted(self._parts.items())}
        return Sample(datagram.sample, datagram.time_code_ms, poses)

    def _whole(self) -> bool:
        return self._known.keys() == self._parts.keys() and all(
            part.whole for part in self._parts.values()
        )

    def _reach(self, sample: int) -> bool:
        """Move on to ``sample``; return false if that sample has already ended."""
        if self._sample is not None and sample != self._sample:
            ahead = (sample - self._sample) & 0xFFFFFFFF
            if ahead <= MAX_LOST * self._step:
                self._leave()
                self._counters.lost += max(0, round(ahead / self._step) - 1)
            elif self._is_late(-ahead & 0xFFFFFFFF):
                return False
            else:
                self.reset()
                self.session += 1
        self._late = 0
        if sample == self._sample:
            return True
        self._sample, self._parts, self._given = sample, {}, False
        return True

    def _is_late(self, behind: int) -> bool:
        self._late += 1
        return behind <= LATE_SAMPLES * self._step and self._late < LATE_RUN

    def _leave(self) -> None:
        """End the current sample; a character missing from it may have left."""
        if self._given:
            return
        self._counters.incomplete += 1
        for number in list(self._known):
            # A character with any datagram is still there. If the same datagram of it is lost every
            # time, no sample is whole and the source falls silent.
            self._known[number] = 0 if number in self._parts else self._known[number] + 1
            if self._known[number] >= GONE_AFTER:
                del self._known[number]
