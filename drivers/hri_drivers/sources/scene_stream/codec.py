"""A scene as datagrams: the node's own stream, specified in ``drivers/SCENE_STREAM.md``.

Everything is little-endian. A datagram is a header of 40 bytes, a part of the scene's body, and a
tag: a CRC-32, or HMAC-SHA256 truncated to 16 bytes. The body has one record per person::

    H        id
    B * ceil(J / 8)   which joints were observed; joint i is bit i % 8 of byte i // 8
    f * 3 * J         x, y, z of each joint, 0 if not observed
    f                 error of the place, metres; only if the header's flag ``HAS_ERRORS`` is set

A body longer than 1344 bytes takes several datagrams, in order; all but the last are full.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Literal

import fastcrc
import numpy as np

from hri_drivers.sources.scene_stream.key_file import TAG_BYTES, Key
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.contracts.scene import MAX_ERROR_M, sound_error_m

MAGIC, VERSION = b"HRIS", 1
HEADER = Struct("<4sBBBBQQqIBBH")
SEES_ROOM, AUTHENTICATED, HAS_ERRORS = 0x01, 0x02, 0x04
_PART = slice(6, 7)  # the only header byte in which the parts of one scene differ

MAX_PEOPLE, MAX_JOINTS = 16, 128
MAX_SEQUENCE = 2**63 - 1
MAX_DATAGRAM = 1400
"""Maximum size that fits an Ethernet frame of 1500 bytes over IPv6, with room for a VLAN or
tunnel."""
CHUNK = MAX_DATAGRAM - HEADER.size - TAG_BYTES
CRC_BYTES = 4

Refusal = Literal["malformed", "crc_errors", "unauthenticated"]


class Refused(ValueError):
    """A refused datagram; ``counter`` is the name of its counter in ``SourceCounters``."""

    def __init__(self, counter: Refusal, why: str) -> None:
        super().__init__(why)
        self.counter: Refusal = counter


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """The header of each part; ``part`` counts from 0 to ``parts`` - 1.

    ``session`` and ``stamp_ns`` are nanoseconds of UTC since 1970: the start of the sender, and the
    time of the capture. ``body_bytes`` is the length of all parts together.
    """

    flags: int
    part: int
    parts: int
    session: int
    sequence: int
    stamp_ns: int
    names_crc: int
    joints: int
    people: int
    body_bytes: int

    def pack(self) -> bytes:
        """The 40 bytes."""
        return HEADER.pack(
            MAGIC, VERSION, self.flags, self.part, self.parts, self.session, self.sequence,
            self.stamp_ns, self.names_crc, self.joints, self.people, self.body_bytes,
        )  # fmt: skip


def names_crc(joints: Sequence[str]) -> int:
    """CRC-32 of the joints' names in order, in UTF-8, separated by line feeds."""
    return zlib.crc32("\n".join(joints).encode())


def body_bytes(people: int, joints: int, has_errors: bool = False) -> int:
    """Length of a body."""
    return people * _record(joints, has_errors).itemsize


def encode(scene: SentScene, joints: Sequence[str], key: Key | None = None) -> list[bytes]:
    """Datagrams of a scene; older nodes refuse datagrams with a position error.

    Raises:
        ValueError: too many people or joints, or arrays that do not fit the joints.
    """
    if not 1 <= len(joints) <= MAX_JOINTS or len(scene.people) > MAX_PEOPLE:
        raise ValueError(f"a scene has 1 to {MAX_JOINTS} joints and 0 to {MAX_PEOPLE} people")
    has_errors = any(person.error_m != 0 for person in scene.people)
    records = np.zeros(len(scene.people), _record(len(joints), has_errors))
    for record, person in zip(records, scene.people, strict=True):
        record["id"] = person.id
        record["observed"] = np.packbits(person.observed, bitorder="little")
        record["positions"] = np.where(person.observed[:, np.newaxis], person.positions, 0.0)
        if has_errors:
            record["error"] = person.error_m
    body = records.tobytes()
    parts = parts_of(len(body))
    flags = (SEES_ROOM if scene.sees_room else 0) | (AUTHENTICATED if key is not None else 0)
    flags |= HAS_ERRORS if has_errors else 0
    datagrams = []
    for part in range(parts):
        header = Header(
            flags=flags,
            part=part,
            parts=parts,
            session=scene.session,
            sequence=scene.sequence,
            stamp_ns=scene.stamp_ns,
            names_crc=names_crc(joints),
            joints=len(joints),
            people=len(scene.people),
            body_bytes=len(body),
        )
        data = header.pack() + body[part * CHUNK : (part + 1) * CHUNK]
        datagrams.append(data + (key.tag(data) if key is not None else crc(data)))
    return datagrams


def open_datagram(data: bytes, key: Key | None = None) -> tuple[Header, bytes]:
    """Check a datagram; return its header and its part of the body.

    Args:
        data: as received.
        key: if given, only datagrams tagged with it are accepted.

    Raises:
        Refused: it is incomplete, of another version, not authentic, or inconsistent.
    """
    if not HEADER.size + CRC_BYTES <= len(data) <= MAX_DATAGRAM or data[:4] != MAGIC:
        raise Refused("malformed", f"{len(data)} bytes that are not a datagram of a scene stream")
    if data[4] != VERSION:
        raise Refused(
            "malformed", f"scene stream of version {data[4]}; this node reads version {VERSION}"
        )
    tagged = _tagged(data, key)
    _, _, *fields = HEADER.unpack_from(tagged)
    header = Header(**dict(zip(Header.__slots__, fields, strict=True)))
    _check(header, len(tagged) - HEADER.size)
    return header, tagged[HEADER.size :]


def decode_body(header: Header, body: bytes) -> SentScene:
    """Return the scene of a whole body; positions are NaN where not observed.

    Raises:
        Refused: the body marks joints that do not exist, an observed joint is not a number, or an
            error is absurd. A body with some NaN positions is refused, not treated as partly
            hidden.
    """
    count, has_errors = header.joints, bool(header.flags & HAS_ERRORS)
    people = []
    for record in np.frombuffer(body, _record(count, has_errors), header.people):
        bits = np.unpackbits(record["observed"], bitorder="little").astype(np.bool_)
        if bits[count:].any():
            raise Refused("malformed", f"it marks joints beyond its {count}")
        observed = bits[:count]
        raw = record["positions"]
        if not np.isfinite(raw[observed]).all():
            raise Refused("malformed", "the position of an observed joint is not a number")
        positions = np.where(observed[:, np.newaxis], raw, np.float32(np.nan)).astype(np.float64)
        error_m = sound_error_m(record["error"]) if has_errors else 0.0
        if error_m != error_m:
            raise Refused(
                "malformed",
                f"the error of a person's place is {record['error']:g} m; send 0 to "
                f"{MAX_ERROR_M:g}",
            )
        people.append(SentPerson(int(record["id"]), positions, observed, error_m))
    return SentScene(
        stamp_ns=header.stamp_ns,
        sequence=header.sequence,
        sees_room=bool(header.flags & SEES_ROOM),
        people=tuple(people),
        session=header.session,
    )


def same_scene(a: bytes, b: bytes) -> bool:
    """Whether two packed headers belong to parts of the same scene."""
    return a[: _PART.start] == b[: _PART.start] and a[_PART.stop :] == b[_PART.stop :]


def crc(data: bytes) -> bytes:
    """CRC-32 (ISO-HDLC, as in Ethernet and zlib), little-endian."""
    return int(fastcrc.crc32.iso_hdlc(data)).to_bytes(CRC_BYTES, "little")


def parts_of(length: int) -> int:
    """Number of datagrams of a body; at least one."""
    return max(1, -(-length // CHUNK))


def _tagged(data: bytes, key: Key | None) -> bytes:
    """Return the part under the tag, if the tag is right."""
    authenticated = bool(data[5] & AUTHENTICATED)
    if key is None and authenticated:
        raise Refused("unauthenticated", "the sender uses a key; set key_file")
    if key is None:
        tagged, tag = data[:-CRC_BYTES], data[-CRC_BYTES:]
        if crc(tagged) != tag:
            raise Refused("crc_errors", "wrong CRC: damaged in transit")
        return tagged
    if not authenticated:
        raise Refused("unauthenticated", "the sender uses no key; give it the key in key_file")
    if len(data) < HEADER.size + TAG_BYTES:
        raise Refused("malformed", "it is too short for its tag")
    tagged, tag = data[:-TAG_BYTES], data[-TAG_BYTES:]
    if not key.fits(tagged, tag):
        raise Refused("unauthenticated", "wrong tag: another key, or damaged in transit")
    return tagged


def _check(header: Header, payload: int) -> None:
    """Refuse a header with inconsistent numbers."""
    whole = 1 <= header.joints <= MAX_JOINTS and header.people <= MAX_PEOPLE
    known = not header.flags & ~(SEES_ROOM | AUTHENTICATED | HAS_ERRORS)
    if not (whole and known and header.sequence <= MAX_SEQUENCE):
        raise Refused("malformed", "people, joints, sequence or flags are out of range")
    length = body_bytes(header.people, header.joints, bool(header.flags & HAS_ERRORS))
    if header.body_bytes != length or header.parts != parts_of(length):
        raise Refused("malformed", "its length does not fit its people and joints")
    if header.part >= header.parts:
        raise Refused("malformed", f"part {header.part} of {header.parts}")
    if payload != min(CHUNK, length - header.part * CHUNK):
        raise Refused("malformed", f"part {header.part} has {payload} bytes")


def _record(joints: int, has_errors: bool) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("id", "<u2"),
            ("observed", "u1", (-(-joints // 8),)),
            ("positions", "<f4", (joints, 3)),
            *([("error", "<f4")] if has_errors else []),
        ]
    )
