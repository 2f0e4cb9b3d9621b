"""An in-memory wire at the far end of a link, whose output is checked."""

import dataclasses
import threading
import time
from collections import deque

import numpy as np

from hri_predict.base.clock import Clock
from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import AnyLinkClass, Link, LinkSettings
from hri_predict.library.conformance.checks import Skipped
from hri_predict.protocol.messages import Message

MAX_FLIPS = 3  # as many wrong bits every protection here finds: HD 4 of the weakest (CAN, CRC-8)
LONGEST_NOISE = 80


class Wire:
    """A ``Transport`` connected to the check.

    Attributes:
        written: units that the link wrote.
        incoming: units that it will read.
        opened: number of times it was opened.
        is_open: whether it is open now.
        lost: whether the device is gone: every call fails.
        write_s: duration of a write.
    """

    def __init__(self) -> None:
        self.written: list[object] = []
        self.incoming: deque[object] = deque()
        self.opened = 0
        self.is_open = False
        self.lost = False
        self.write_s = 0.0
        self._closed = threading.Event()

    def open(self) -> None:
        """Open it."""
        self._check()
        self.opened += 1
        self.is_open = True
        self._closed.clear()

    def write(self, unit: object) -> None:
        """Write a unit, taking the time of the wire."""
        self._check()
        self._closed.wait(self.write_s)
        self.written.append(unit)

    def read(self, timeout_s: float) -> list[object]:
        """Return waiting units; an idle wire waits."""
        self._check()
        if not self.incoming and timeout_s > 0:
            time.sleep(min(timeout_s, 0.01))
        units = list(self.incoming)
        self.incoming.clear()
        return units

    def close(self) -> None:
        """Close it."""
        self.is_open = False
        self._closed.set()

    def _check(self) -> None:
        if self.lost:
            raise LinkError("wire lost; plug it in")


def units_of(
    cls: AnyLinkClass, settings: LinkSettings, clock: Clock, message: Message
) -> list[object]:
    """Return the units that a link of this kind creates for one message.

    Raises:
        Skipped: it does not carry such a message.
    """
    wire = Wire()
    link = cls(settings, clock, wire)
    return units_from(link, wire, clock, message)


def units_from(link: Link, wire: Wire, clock: Clock, message: Message) -> list[object]:
    """Return the units that a link writes for one more message; its counters continue.

    Raises:
        Skipped: it does not carry such a message.
    """
    wire.written.clear()
    link.post(message)
    link.service(clock.now_ns())
    if not wire.written:
        raise Skipped(f"this kind of link does not write {type(message).__name__}")
    return list(wire.written)


def damaged(unit: object, rng: np.random.Generator) -> object:
    """Return the unit with one to three wrong bits.

    Raises:
        Skipped: the type of the unit is unknown.
    """
    data = bytearray(_data(unit))
    for place in rng.choice(8 * len(data), int(rng.integers(1, MAX_FLIPS + 1)), replace=False):
        data[place // 8] ^= 1 << (place % 8)
    return _with_data(unit, bytes(data))


def noise(unit: object, rng: np.random.Generator) -> object:
    """Return random bytes instead of the unit: any number for a stream, otherwise the same
    number.
    """
    count = int(rng.integers(1, LONGEST_NOISE)) if isinstance(unit, bytes) else len(_data(unit))
    return _with_data(unit, rng.bytes(count))


def _data(unit: object) -> bytes:
    data = unit if isinstance(unit, bytes) else getattr(unit, "data", None)
    if not isinstance(data, bytes) or not data:
        raise Skipped(f"{type(unit).__name__} is neither bytes nor a dataclass with bytes as data")
    return data


def _with_data(unit: object, data: bytes) -> object:
    if isinstance(unit, bytes):
        return data
    assert dataclasses.is_dataclass(unit)
    assert not isinstance(unit, type)
    return dataclasses.replace(unit, data=data)
