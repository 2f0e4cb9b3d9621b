"""One picture of the cell, and its format in a pipe: JSON for facts, floats for shapes.

length (4 bytes, little endian) | length of the JSON (4 bytes) | JSON | 32-bit floats
"""

import json
import math
import struct
from dataclasses import dataclass, fields
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

Shapes = NDArray[np.float32]
MAX_BYTES = 16 * 1024 * 1024
"""16 people of 20 segments at 8 steps are 0.2 MB."""
_LENGTH = struct.Struct("<I")
_SHAPES = ("bodies", "forecast", "zones", "robots")


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Content of one tick on screens. Capsules are rows of ax ay az bx by bz r: metres, room frame.

    Attributes:
        facts: plain data; see ``packing.facts_of``.
        bodies: (P, S, 7) people as captured, lost people where last seen; NaN: unknown.
        forecast: (P, K, S, 7) predicted bodies at each of ``facts["times_s"]``.
        zones: (Z, K, S, 7) space where people may be; a row for each of ``facts["zones"]``.
        robots: (C, 7) capsules of all robots, in the order of the robots.
    """

    facts: dict[str, Any]
    bodies: Shapes
    forecast: Shapes
    zones: Shapes
    robots: Shapes


def pack(picture: Picture) -> bytes:
    """Return the picture as bytes, preceded by its length."""
    shapes = [np.ascontiguousarray(getattr(picture, name), "<f4") for name in _SHAPES]
    head = json.dumps({"facts": _finite(picture.facts), "shapes": [s.shape for s in shapes]})
    encoded = head.encode()
    body = b"".join((_LENGTH.pack(len(encoded)), encoded, *(s.tobytes() for s in shapes)))
    return _LENGTH.pack(len(body)) + body


def unpack(body: bytes) -> Picture:
    """Return the picture from the bytes that follow the first length.

    Raises:
        ValueError: these bytes are not a picture.
    """
    try:
        (length,) = _LENGTH.unpack_from(body)
        head = json.loads(body[4 : 4 + length])
        at, shapes = 4 + length, []
        for shape in head["shapes"]:
            count = math.prod(int(n) for n in shape)
            shapes.append(np.frombuffer(body, "<f4", count, at).reshape(shape))
            at += 4 * count
        if at != len(body) or not isinstance(head["facts"], dict):
            raise ValueError("wrong length")
        return Picture(head["facts"], *shapes)
    except (struct.error, KeyError, TypeError, ValueError, RecursionError, OverflowError) as error:
        raise ValueError(f"no picture: {error}") from error


def read(stream: BinaryIO) -> Picture | None:
    """Return the next picture of a pipe; ``None`` at its end.

    Raises:
        ValueError: the pipe contains something else.
    """
    start = stream.read(_LENGTH.size)
    if len(start) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(start)
    if length > MAX_BYTES:
        raise ValueError(f"no picture: {length} bytes")
    body = stream.read(length)
    return unpack(body) if len(body) == length else None


def empty_shapes() -> dict[str, Shapes]:
    """Return empty shapes, by name."""
    assert tuple(f.name for f in fields(Picture))[1:] == _SHAPES
    people = np.zeros((0, 1, 1, 7), np.float32)
    return {
        "bodies": people[:, 0],
        "forecast": people,
        "zones": people,
        "robots": people[:, 0, 0],
    }


def _finite(value: Any) -> Any:
    """Replace values that are not finite, which JSON cannot represent, by ``None``."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
