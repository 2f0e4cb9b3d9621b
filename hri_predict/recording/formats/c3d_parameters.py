"""The parameters of a C3D file: groups of named arrays. See ``c3d``. The layout is in the C3D User
Guide, chapter "The C3D Parameter Section".

A record is: length of the name (below 0 if locked), number of the group (below 0 for the group
itself), the name, an offset from there to the next record; then for a parameter: type (-1 text,
1 byte, 2 integer, 4 float), number of dimensions, a byte for each, the values.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK = 512
MAGIC = 0x50
_INTEL, _DEC, _MIPS = 84, 85, 86
_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}
MAX_SECTION = 2**20  # bytes; the format counts 255 blocks of 512, and some programs write more


class Damaged(Exception):
    """Raised if the section is inconsistent."""


@dataclass(frozen=True)
class _Record:
    kind: int
    dimensions: tuple[int, ...]
    data: bytes


@dataclass(frozen=True)
class Parameters:
    """Parameters by group and name, and numbers as the writing machine stored them."""

    processor: int
    records: Mapping[tuple[str, str], _Record]

    def texts(self, group: str, name: str) -> list[str]:
        """Texts of a parameter and of its continuations (``LABELS2``, ...); empty if missing."""
        found: list[str] = []
        part = 1
        while record := self.records.get((group, name if part == 1 else f"{name}{part}")):
            part += 1
            if record.kind == -1 and record.data:
                width, *counts = record.dimensions or (1,)  # no dimensions: a single character
                count = math.prod(counts)
                cut = [record.data[k * width : (k + 1) * width] for k in range(count)]
                found += [text.split(b"\0")[0].decode("latin-1").strip() for text in cut]
        return found

    def number(self, group: str, name: str, default: float) -> float:
        """The first value of a parameter; integers count as unsigned, as in all programs."""
        record = self.records.get((group, name))
        if record is None or record.kind not in (2, 4) or not record.data:
            return default
        value = float(self.array(record.data, 0, 1, floats=record.kind == 4)[0])
        return value % 65536 if record.kind == 2 else value

    def count(self, group: str, name: str, most: int) -> int:
        """The first value of a parameter as a count, 0 to ``most``; 0 if it is not a number."""
        return int(max(0.0, min(self.number(group, name, 0.0), most)))

    def words(self, group: str, name: str) -> list[int]:
        """All values of an integer parameter, unsigned; empty if missing."""
        record = self.records.get((group, name))
        if record is None or record.kind != 2:
            return []
        values = self.array(record.data, 0, len(record.data) // 2, floats=False)
        return [int(v) % 65536 for v in values]

    def header_word(self, data: bytes, offset: int) -> int:
        """An unsigned integer of the header."""
        return int(self.array(data, offset, 1, floats=False)[0]) % 65536

    def header_float(self, data: bytes, offset: int) -> float:
        """A float of the header."""
        return float(self.array(data, offset, 1, floats=True)[0])

    def array(self, data: bytes, start: int, count: int, *, floats: bool) -> NDArray[Any]:
        """(count,) 16-bit integers or 32-bit floats, in the writing machine's order.

        Raises:
            Damaged: some numbers are missing.
        """
        size = 4 if floats else 2
        if start + count * size > len(data):
            raise Damaged("the file ends too early")
        order = ">" if self.processor == _MIPS else "<"
        if not floats:
            return np.frombuffer(data, f"{order}i2", count, start)
        if self.processor != _DEC:
            return np.frombuffer(data, f"{order}f4", count, start)
        swapped = np.frombuffer(data, "<u2", count * 2, start).reshape(-1, 2)[:, ::-1]
        return np.ascontiguousarray(swapped).view("<f4").ravel() / 4.0  # its exponent is 2 more


def read_parameters(data: bytes) -> Parameters:
    """Read the section that the header points to.

    Raises:
        Damaged: the section is missing, is from an unknown machine, or has records beyond its end.
    """
    start = (data[0] - 1) * BLOCK
    if start < BLOCK or start + BLOCK > len(data):
        raise Damaged("where they start")
    data = data[: start + MAX_SECTION]
    processor = data[start + 3]
    if processor not in (_INTEL, _DEC, _MIPS):
        raise Damaged(f"processor type {processor}")
    order = ">" if processor == _MIPS else "<"
    groups: dict[int, str] = {}
    found: list[tuple[int, str, _Record]] = []
    at = start + 4
    while True:
        length, group = struct.unpack_from("bb", data, at) if at + 2 <= len(data) else (0, 0)
        if length == 0 or group == 0:
            break
        name = data[at + 2 : at + 2 + abs(length)].decode("latin-1").strip().upper()
        here = at + 2 + abs(length)
        if here + 2 > len(data):
            raise Damaged("a name goes past the end")
        (offset,) = struct.unpack_from(f"{order}H", data, here)
        if group < 0:
            groups[-group] = name
        else:
            end = here + offset if offset else len(data)
            found.append((group, name, _record(data, here + 2, min(end, len(data)))))
        if offset == 0:
            break
        at = here + offset  # always forward, so the loop ends
    records = {(groups.get(group, ""), name): record for group, name, record in found}
    return Parameters(processor, records)


def _record(data: bytes, at: int, end: int) -> _Record:
    """A parameter with its values before ``end``, so the total is no larger than the file."""
    if at + 2 > end:
        raise Damaged("a parameter goes past the end")
    kind, rank = struct.unpack_from("bB", data, at)
    dimensions = tuple(data[at + 2 : at + 2 + rank])
    size = math.prod(dimensions) * _SIZES.get(kind, 1)
    begin = at + 2 + rank
    if rank > 7 or begin + size > end:
        raise Damaged("a parameter goes past the end")
    return _Record(kind, dimensions, data[begin : begin + size])


def pack_parameters(groups: Mapping[str, Mapping[str, object]]) -> bytes:
    """The whole section, for Intel machines, filled up to blocks."""
    records = []
    for number, (group, parameters) in enumerate(groups.items(), start=1):
        records.append((struct.pack("bb", len(group), -number) + group.encode(), b"\0"))
        for name, value in parameters.items():
            head = struct.pack("bb", len(name), number) + name.encode()
            records.append((head, _packed(value) + b"\0"))
    body = b"".join(head + struct.pack("<H", len(rest) + 2) + rest for head, rest in records)
    body += b"\0\0"
    blocks = -(-(len(body) + 4) // BLOCK)
    return (bytes([1, MAGIC, blocks & 0xFF, _INTEL]) + body).ljust(blocks * BLOCK, b"\0")


def _packed(value: object) -> bytes:
    """Type, dimensions and values of a parameter."""
    if isinstance(value, str):
        return struct.pack("bBB", -1, 1, len(value)) + value.encode("ascii")
    if isinstance(value, float):
        return struct.pack("<bBf", 4, 0, value)
    if isinstance(value, int):
        return struct.pack("<bBH", 2, 0, value)
    assert isinstance(value, Sequence)
    if isinstance(value[0], int):
        return struct.pack(f"<bBB{len(value)}H", 2, 1, len(value), *value)
    width = max(map(len, value))
    cells = b"".join(text.encode("ascii").ljust(width) for text in value)
    return struct.pack("bBBB", -1, 2, width, len(value)) + cells
