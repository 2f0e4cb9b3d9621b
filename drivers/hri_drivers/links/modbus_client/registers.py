"""Numbers in 16-bit registers: their types, byte and word order, and the registers to read."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

Type = Literal["int16", "uint16", "int32", "uint32", "float32", "float64"]
Order = Literal["big", "little"]
MOST_WORDS = 125
"""Maximum number of registers in one request (Modbus application protocol 1.1b3, 6.3)."""
_FORMATS: dict[str, str] = {
    "int16": ">h",
    "uint16": ">H",
    "int32": ">i",
    "uint32": ">I",
    "float32": ">f",
    "float64": ">d",
}


def words_of(kind: Type) -> int:
    """Return the number of registers of a value of this type."""
    return struct.calcsize(_FORMATS[kind]) // 2


def number(words: Sequence[int], kind: Type, byte_order: Order, word_order: Order) -> float:
    """Return the number in these registers; big: the high byte, or the high word, comes first."""
    data = [word.to_bytes(2, byte_order) for word in words]
    if word_order == "little":
        data.reverse()
    found: float = struct.unpack(_FORMATS[kind], b"".join(data))[0]
    return found


@dataclass(frozen=True, slots=True)
class Slot:
    """A value's registers."""

    name: str
    at: int
    kind: Type

    @property
    def end(self) -> int:
        """The first register after it."""
        return self.at + words_of(self.kind)


def check_slots(slots: Sequence[Slot]) -> None:
    """Refuse registers that overlap, or that one request cannot read.

    Two requests could read values from two different moments.

    Raises:
        ValueError: one line with the remedy.
    """
    ordered = sorted(slots, key=lambda slot: slot.at)
    for a, b in pairwise(ordered):
        if b.at < a.end:
            raise ValueError(
                f"{b.name} at {b.at} lies in the registers {a.at} to {a.end - 1} of {a.name} "
                f"({a.kind}); correct one, or the type"
            )
    first, end = ordered[0].at, max(slot.end for slot in slots)
    if end - first > MOST_WORDS:
        raise ValueError(
            f"registers {first} to {end - 1} do not fit into one request of {MOST_WORDS}; let the "
            "controller write the state into neighbouring registers"
        )
    if end > 65_536:
        raise ValueError(f"{ordered[-1].name} goes past register 65535; correct it")
