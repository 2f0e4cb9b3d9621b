"""Packets of RTDE, protocol version 2: framing, recipes and the replies of the setup.

Written from the tables of Universal Robots' "Real-Time Data Exchange (RTDE) Guide". All numbers are
big-endian. A packet is its length (UINT16, header included), its kind (UINT8), and its data.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

from hri_predict.base.errors import LinkError

VERSION = 2
_HEADER = struct.Struct(">HB")
MAX_PACKET = 4096
"""Maximum length in bytes of a packet; ours with 18 fields has 200, a text at most 515."""

FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}


class Kind(IntEnum):
    """Kinds of packets: the ASCII codes of the guide's letters."""

    VERSION = ord("V")
    CONTROLLER = ord("v")
    TEXT = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet without its header; a data package also lacks the number of its recipe."""

    kind: int
    data: bytes


def framed(kind: int, data: bytes = b"") -> bytes:
    """Return the bytes of one packet."""
    return _HEADER.pack(_HEADER.size + len(data), kind) + data


class Splitter:
    """Finds packets in the bytes of one connection, regardless of how they are split.

    RTDE does not mark the start of a packet, so after one impossible header the rest is unreadable.
    """

    def __init__(self) -> None:
        self._kept = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield kind and data of the packets that these bytes complete.

        Raises:
            LinkError: a header is impossible; only a new connection helps.
        """
        self._kept += data
        while len(self._kept) >= _HEADER.size:
            length, kind = _HEADER.unpack_from(self._kept)
            if not _HEADER.size <= length <= MAX_PACKET or kind not in _KINDS:
                raise LinkError(
                    f"bytes that are not RTDE (a packet of kind {kind} with {length} bytes); "
                    "check that 'port' is the controller's RTDE port, 30004"
                )
            if len(self._kept) < length:
                return
            packet = bytes(self._kept[_HEADER.size : length])
            del self._kept[:length]
            yield kind, packet


_KINDS = frozenset(Kind)


@dataclass(frozen=True, slots=True)
class Recipe:
    """Names and types of the fields of a data package, and how they are packed."""

    names: tuple[str, ...]
    types: tuple[str, ...]

    @property
    def layout(self) -> struct.Struct:
        """The layout of a data package after its recipe's number."""
        return struct.Struct(">" + "".join(FORMATS[t] for t in self.types))


def asks_outputs(recipe: Recipe, rate_hz: float) -> bytes:
    """Data of the request for outputs."""
    return struct.pack(">d", rate_hz) + ",".join(recipe.names).encode()


def asks_inputs(recipe: Recipe) -> bytes:
    """Data of the request for inputs."""
    return ",".join(recipe.names).encode()


def recipe_number(recipe: Recipe, data: bytes, direction: str) -> int:
    """Return the number that the controller gave a recipe.

    Args:
        recipe: the requested recipe.
        data: data of the reply: the number (UINT8), then the types, separated by commas.
        direction: "output" or "input", for the error.

    Raises:
        LinkError: a name is not known or in use, a type is not ours, or the number is 0, which no
            valid recipe has; one line with the remedy.
    """
    types = data[1:].decode("ascii", "replace").split(",")
    if not data or len(types) != len(recipe.names):
        raise LinkError(
            f"the controller answers {len(recipe.names)} {direction} names with {len(types)} types;"
            " it does not speak RTDE protocol version 2"
        )
    for name, wanted, found in zip(recipe.names, recipe.types, types, strict=True):
        if found == "IN_USE":
            raise LinkError(
                f"input '{name}' is in use: another RTDE client writes it, and only one client "
                "may; stop that client (a ROS driver, another node, a fieldbus), or name another "
                "register"
            )
        if found == "NOT_FOUND":
            raise LinkError(
                f"the controller does not know the {direction} '{name}'; update its software, or "
                "name a register that it has"
            )
        if found != wanted:
            raise LinkError(
                f"{direction} '{name}' is of type {found[:20]!r}, not {wanted}; this controller's "
                "software is not supported"
            )
    if not data[0]:
        raise LinkError(
            f"the controller gives the {direction} recipe the number 0, so it accepts none of its "
            f"fields; restart its RTDE interface"
        )
    return data[0]


def text_of(data: bytes) -> str:
    """Return the text of a message from the controller as one printable line."""
    length = data[0] if data else 0
    text = data[1 : 1 + length].decode("utf-8", "replace")
    return "".join(c if c.isprintable() else " " for c in text).strip()


def number_of(data: bytes) -> int:
    """The first byte of a reply: 1 if the controller accepts; 0 for an empty reply."""
    return data[0] if data else 0


def versions_of(data: bytes) -> Sequence[int]:
    """Major, minor, bugfix and build number of the controller; empty if they are missing."""
    return struct.unpack(">4I", data) if len(data) == 16 else ()
