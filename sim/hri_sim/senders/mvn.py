"""Sends datagrams like Xsens MVN, as a stand-in for MVN in tests and fault tables.

Written from "MVN real-time network streaming, Protocol Specification", MV0305P revision N; it
shares no code with the decoder. Numbers in brackets are the specification's clauses.
"""

from struct import pack

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import CANONICAL

MTU_ITEMS = 40  # of 32 bytes, and the header: below 1500 [2.4.1.3]


def datagram(
    *,
    kind: str,
    sample: int,
    time_code_ms: int,
    character: int,
    payload: bytes,
    items: int,
    counter: int = 0x80,
    body_segments: int = 23,
    props: int = 0,
    fingers: int = 0,
) -> bytes:
    """Return one datagram [2.4.1]; ``kind``: two-digit type, ``counter``: datagram counter."""
    return b"".join(
        (
            b"MXTP" + kind.encode("ascii"),
            sample.to_bytes(4, "big"),
            bytes([counter, items]),
            time_code_ms.to_bytes(4, "big"),
            bytes([character, body_segments, props, fingers, 0, 0]),
            len(payload).to_bytes(2, "big"),
            payload,
        )
    )


def quaternions(
    sample: int,
    time_code_ms: int,
    character: int,
    positions: Floats,
    *,
    fingers: int = 0,
    items_each: int = MTU_ITEMS,
) -> list[bytes]:
    """Return the datagrams of one character in one sample, type 02 [2.5.3].

    Args:
        positions: (23, 3) metres, z up; every segment is turned by 90 degrees about z.
        fingers: 0 or 40 finger segments, all at the origin.
        items_each: maximum number of segments in one datagram.
    """
    half = float(np.sqrt(0.5))
    rotation = pack(">ffff", half, 0.0, 0.0, half)  # re, i, j, k
    origins = [*positions, *np.zeros((fingers, 3))]
    items = [pack(">ifff", i + 1, *origin) + rotation for i, origin in enumerate(origins)]
    head = {"sample": sample, "time_code_ms": time_code_ms, "character": character}
    return _split("02", items, items_each, fingers=fingers, **head)


def eulers(sample: int, time_code_ms: int, character: int, positions: Floats) -> list[bytes]:
    """Return the datagram of one character in one sample, type 01 [2.5.2]: centimetres, y up.

    Args:
        positions: (23, 3) metres, z up, x forward; MVN turns them so that z is forward, x left.
    """
    turned = np.asarray(positions)[:, [1, 2, 0]] * 100.0
    items = [pack(">iffffff", i + 1, *p, 0.0, -90.0, 180.0) for i, p in enumerate(turned)]
    head = {"sample": sample, "time_code_ms": time_code_ms, "character": character}
    return _split("01", items, MTU_ITEMS, **head)


def _split(kind: str, items: list[bytes], each: int, **head: int) -> list[bytes]:
    groups = [items[at : at + each] for at in range(0, len(items), each)]
    return [
        datagram(
            kind=kind,
            payload=b"".join(group),
            items=len(group),
            counter=index | (0x80 if index == len(groups) - 1 else 0),
            **head,
        )
        for index, group in enumerate(groups)
    ]


def meta_data(sample: int, time_code_ms: int, character: int, name: str) -> bytes:
    """Return a datagram of type 12 [2.6.1]: the character's name and number, tagged."""
    text = f"name:{name}\nxmid:00130000\ncolor:FF8000\n".encode()
    return datagram(
        kind="12",
        sample=sample,
        time_code_ms=time_code_ms,
        character=character,
        payload=pack(">i", len(text)) + text,
        items=1,
    )


def time_code(sample: int, time_code_ms: int, clock: str = "11:22:33.444") -> bytes:
    """Return a datagram of type 25 [2.7.6]: the time of day."""
    return datagram(
        kind="25",
        sample=sample,
        time_code_ms=time_code_ms,
        character=0,
        payload=clock.encode("ascii"),
        items=1,
    )


def segments_of(joints: Floats) -> Floats:
    """Return the origins (23, 3) of MVN's segments for canonical joints (21, 3).

    Spine segments that the canonical skeleton lacks are interpolated between its joints.
    """
    at = {name: joints[i] for i, name in enumerate(CANONICAL.joints)}

    def between(a: str, b: str, part: float) -> Floats:
        point: Floats = at[a] + part * (at[b] - at[a])
        return point

    def arm(side: str) -> list[Floats]:
        shoulder = between("neck", f"{side}_shoulder", 0.2)
        return [shoulder, at[f"{side}_shoulder"], at[f"{side}_elbow"], at[f"{side}_wrist"]]

    def leg(side: str) -> list[Floats]:
        return [at[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle", "foot")]

    spine = [
        at["waist"],
        between("waist", "torso", 0.3),
        between("waist", "torso", 0.65),
        at["torso"],
        between("torso", "neck", 0.4),
        at["neck"],
        at["head"],
    ]
    return np.array([*spine, *arm("r"), *arm("l"), *leg("r"), *leg("l")])
