"""Open Sound Control 1.0: the messages of one packet, with the argument types that VMC uses.

Source: "The Open Sound Control 1.0 Specification" (opensoundcontrol.org): big-endian, texts end
with zeros up to a multiple of 4 bytes, a bundle is ``#bundle``, 8 bytes of time and elements, each
after its size. Elements may be bundles. The package ``python-osc`` logs a line for each unknown
type tag and recurses into nested bundles, which network input must not cause; the tests use it as
an independent sender.
"""

import functools
import itertools
import struct
from collections.abc import Iterator
from dataclasses import dataclass

BUNDLE = b"#bundle\0"
HEADER = len(BUNDLE) + 8
MAX_DEPTH = 4
MAX_MESSAGES = 1000

Argument = int | float | str | bool | None
_NUMBERS = {"i": "i", "f": "f", "d": "d", "h": "q"}  # type tag to format of ``struct``
_CONSTANTS: dict[str, Argument] = {"T": True, "F": False, "N": None}


class OscError(ValueError):
    """The bytes are not a packet; one line gives the reason."""


@dataclass(frozen=True, slots=True)
class Message:
    """One message.

    Attributes:
        address: such as ``/VMC/Ext/Bone/Pos``.
        arguments: in order.
    """

    address: str
    arguments: tuple[Argument, ...]


def messages(packet: bytes) -> list[Message]:
    """All messages of a packet, in order; times of bundles are ignored.

    Raises:
        OscError: the bytes are not a packet. No input raises any other exception.
    """
    found: list[Message] = []
    for element in _elements(packet, 0):
        if len(found) == MAX_MESSAGES:
            raise OscError(f"more than {MAX_MESSAGES} messages in one packet")
        found.append(_message(element))
    return found


def _elements(packet: bytes, depth: int) -> Iterator[bytes]:
    if not packet.startswith(BUNDLE):
        yield packet
        return
    if depth == MAX_DEPTH:
        raise OscError(f"bundles nested more than {MAX_DEPTH} deep")
    if len(packet) < HEADER:
        raise OscError("a bundle without its time")
    at = HEADER
    while at < len(packet):
        size = int.from_bytes(packet[at : at + 4], "big")
        at += 4
        if size == 0 or size % 4 or at + size > len(packet):
            raise OscError(f"an element of {size} bytes where {len(packet) - at} are left")
        yield from _elements(packet[at : at + size], depth + 1)
        at += size


def _message(data: bytes) -> Message:
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise OscError("neither a message nor a bundle")
    if at == len(data):
        return Message(address, ())
    tags, at = _text(data, at)
    if not tags.startswith(","):
        raise OscError("a message without type tags")
    arguments: list[Argument] = []
    for part in _parts(tags[1:]):
        if isinstance(part, struct.Struct):
            if at + part.size > len(data):
                raise OscError("a message that ends within an argument")
            arguments += part.unpack_from(data, at)
            at += part.size
        elif part == "s":
            text, at = _text(data, at)
            arguments.append(text)
        else:
            arguments.append(_CONSTANTS[part])
    return Message(address, tuple(arguments))


@functools.lru_cache(maxsize=64)
def _parts(tags: str) -> tuple[struct.Struct | str, ...]:
    """Return what the type tags announce; numbers that follow each other are one structure."""
    parts: list[struct.Struct | str] = []
    for is_number, run in itertools.groupby(tags, key=_NUMBERS.__contains__):
        if is_number:
            parts.append(struct.Struct(">" + "".join(_NUMBERS[tag] for tag in run)))
            continue
        for tag in run:
            if tag != "s" and tag not in _CONSTANTS:
                raise OscError(f"an argument of type {tag!a}")
            parts.append(tag)
    return tuple(parts)


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at)
    if end < 0:
        raise OscError("a text without end")
    try:
        text = data[at:end].decode("utf-8")
    except UnicodeDecodeError:
        raise OscError("a text that is not UTF-8") from None
    return text, min(len(data), (end // 4 + 1) * 4)
