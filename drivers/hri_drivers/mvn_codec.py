"""Datagrams of the Xsens MVN network stream: their bytes, and how samples are put together of them.

Source: Xsens, "MVN real-time network streaming, Protocol Specification", MV0305P revision N,
September 2018; numbers in brackets are its clauses. Everything is big-endian. A datagram is a
header of 24 bytes [2.4.1] and a payload whose length the header states::

    6s ID string "MXTP" and two digits: the type   B  character ID: one per person
    I  sample counter                              B  body segments, 23
    B  datagram counter, bit 7: the last one       B  props, 0 to 4
    B  items in this datagram                      B  finger segments, 0 or 40
    I  time code, ms since the recording began     2x reserved
                                                   H  bytes of payload (0 before MVN 2019)

Types with segments that are decoded, an item for each segment [2.5.2, 2.5.3]:

- 01, 28 bytes: segment ID, position x y z, Euler angles x y z in degrees; y up, right-handed.
- 02, 32 bytes: segment ID, position x y z, quaternion w x y z; z up, right-handed.

Rotations are not used but for their being sound: a person is where the segments' origins are.

All other types (03 markers, 05 Unity3D, 12 meta data, 13 scale, 20 to 24 kinematics, 25 time code)
are told apart, for their being counted, and skipped: none of them places segments in the room.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from struct import Struct

import numpy as np

from hri_predict.scene import Bools, Floats
from hri_predict.source import SourceCounters

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
"""A sample that is older by no more arrived late; by more, the sender began anew."""
LATE_RUN = 10
"""Datagrams in a row that are late mean that the sender began anew soon after it had begun."""
GONE_AFTER = 3
"""A character of which nothing came in so many samples in a row has left the stream."""
MAX_LOST = 100_000
"""A sample that is ahead by more is not the next after a loss: the sender began anew."""


class MalformedDatagram(ValueError):
    """These bytes are no datagram of the specification."""


@dataclass(frozen=True, slots=True)
class Datagram:
    """One datagram; ``index`` counts those of one character's sample, from 0."""

    type: int
    sample: int
    index: int
    last: bool
    items: int
    time_code_ms: int
    character: int
    payload: bytes


@dataclass(slots=True)
class Pose:
    """One character in one sample, in the stream's own units and axes.

    Attributes:
        positions: (23, 3) origins of the body segments, by index; NaN where not sent.
        observed: (23,) which were sent, with finite numbers and a sound rotation.
    """

    positions: Floats = field(default_factory=lambda: np.full((SEGMENTS, 3), np.nan))
    observed: Bools = field(default_factory=lambda: np.zeros(SEGMENTS, np.bool_))


@dataclass(frozen=True, slots=True)
class Sample:
    """All characters at one sampling instance."""

    counter: int
    time_code_ms: int
    poses: dict[int, Pose]


def parse(data: bytes) -> Datagram:
    """Decode header and length of a whole datagram.

    Raises:
        MalformedDatagram: it is none.
    """
    if len(data) < HEADER.size:
        raise MalformedDatagram("shorter than a header")
    tag, sample, counter, items, time_code, character, _, _, _, size = HEADER.unpack_from(data)
    if tag[:4] != b"MXTP" or not tag[4:].isdigit():
        raise MalformedDatagram("no MXTP and two digits")
    number = int(tag[4:])
    payload = data[HEADER.size :]
    expected = items * ITEM_BYTES[number] if number in ITEM_BYTES else size or len(payload)
    if len(payload) != expected or size not in (0, expected):
        raise MalformedDatagram("its length is not what its header says")
    return Datagram(
        number, sample, counter & ~LAST, bool(counter & LAST), items, time_code, character, payload
    )


def add_segments(datagram: Datagram, pose: Pose) -> None:
    """Put the body segments of a datagram of type 01 or 02 into ``pose``; props and fingers not.

    A segment whose numbers are no position or no rotation stays unobserved.
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
    """Finds datagrams in a stream of bytes (TCP); never keeps more than one.

    What is between them comes out as well, for the decoder to refuse and count.
    """

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes as they come; yield the datagrams that they complete."""
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
        """Of the datagram that starts here."""
        tag, _, _, items, _, _, _, _, _, size = HEADER.unpack_from(self._buffer)
        return HEADER.size + int(size or items * ITEM_BYTES.get(int(tag[4:]), 0))

    def _garbage(self) -> int:
        """Bytes until where a datagram may start."""
        at = self._buffer.find(b"MXTP", 1)
        return len(self._buffer) - 3 if at < 0 else at  # 3: "MXT" may be a start


@dataclass(slots=True)
class _Part:
    """What has come of one character's sample."""

    pose: Pose = field(default_factory=Pose)
    indices: set[int] = field(default_factory=set)
    last: int | None = None

    @property
    def whole(self) -> bool:
        return self.last is not None and self.indices == set(range(self.last + 1))


class Assembler:
    """Puts datagrams together to samples of everybody in the stream.

    Each character sends datagrams of its own [2.4.1.6], several where they would be too long
    [2.4.1.3]. A sample is whole once all of those came of every character that is in the stream;
    one that is not whole when the next begins is lost and counted, so that nobody vanishes because
    a datagram did. A character of which nothing came in ``GONE_AFTER`` samples in a row has left.

    Args:
        number: the type to decode, 1 or 2; the others are counted alone.
        samples_per_scene: by how much the sample counter rises from one sample sent to the next;
            more than 1 where MVN streams fewer samples than it takes.
        counters: counts ``ignored``, ``lost``, ``incomplete``, ``out_of_order``, ``replayed``.

    Attributes:
        session: rises when the sample counter begins anew.
    """

    def __init__(self, number: int, samples_per_scene: float, counters: SourceCounters) -> None:
        self.session = 0
        self._type = number
        self._step = samples_per_scene
        self._counters = counters
        self._known: dict[int, int] = {}  # characters: samples in a row in which it was missing
        self._sample: int | None = None
        self._parts: dict[int, _Part] = {}
        self._given = False  # the sample under way was whole and is given already
        self._late = 0  # datagrams in a row

    def reset(self) -> None:
        """Forget everything but the counters, as after a reconnection."""
        self._known.clear()
        self._sample, self._parts, self._given = None, {}, False

    def add(self, datagram: Datagram) -> Sample | None:
        """Take one datagram; return the sample that it makes whole, if any."""
        if datagram.type != self._type:
            self._counters.ignored += 1
            return None
        if not self._reach(datagram.sample):
            self._counters.out_of_order += 1
            return None
        self._known.setdefault(datagram.character, 0)
        if self._given and datagram.character not in self._parts:
            self._counters.out_of_order += 1  # a new character: the next sample waits for it
            return None
        part = self._parts.setdefault(datagram.character, _Part())
        if datagram.index in part.indices:
            self._counters.replayed += 1
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
        """Go on to ``sample``; false if it is over already."""
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
        """The next sample begins: whoever is missing in this one may have gone."""
        if self._given:
            return
        self._counters.incomplete += 1
        for number in list(self._known):
            # Of whom anything came, is there: nobody leaves because the same datagram of theirs is
            # lost every time. No sample is whole then, and the source falls silent.
            self._known[number] = 0 if number in self._parts else self._known[number] + 1
            if self._known[number] >= GONE_AFTER:
                del self._known[number]
