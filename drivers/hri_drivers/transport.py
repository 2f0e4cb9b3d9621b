"""What a link needs from a wire, and an in-memory wire for the virtual clock and for tests."""

import threading
from collections import deque
from typing import Generic, Protocol, TypeVar

from hri_predict.errors import LinkError

U = TypeVar("U")

PIPE_CAPACITY = 4096


class TransportBusy(LinkError):
    """The wire takes nothing now (buffer full, write timed out); the device itself is still there.

    The unit was not accepted, or not wholly. A link keeps the message and encodes it afresh later.
    """


class Transport(Protocol[U]):
    """A wire that carries units: ``bytes`` on serial, ``CanFrame`` on CAN.

    One thread may write while another reads; ``open`` and ``close`` are called by nobody else at
    the same time. After ``close``, ``open`` may be called again.
    """

    def open(self) -> None:
        """Open the device.

        Raises:
            LinkError: one line that names the port or interface and the remedy.
        """

    def write(self, unit: U) -> None:
        """Write one unit, in bounded time.

        Raises:
            TransportBusy: the wire takes nothing now; try again later.
            LinkError: the device is lost.
        """

    def read(self, timeout_s: float) -> list[U]:
        """Return what has come, waiting at most ``timeout_s``; empty if nothing came.

        Raises:
            LinkError: the device is lost.
        """

    def close(self) -> None:
        """Close the device; never raises, safe to call twice."""


class PipeEnd(Generic[U]):
    """One end of ``pipe()``.

    Attributes:
        written: units accepted since the start.
        overflowed: units lost because the other end did not read in time; the oldest go first, as
            in a receiver whose buffer is full.
        unheard: units written while the other end was closed, as on a wire with nobody at its end.
    """

    def __init__(self, name: str, capacity: int) -> None:
        self.name = name
        self.written = 0
        self.overflowed = 0
        self.unheard = 0
        self._capacity = capacity
        self._inbox: deque[U] = deque()
        self._arrived = threading.Condition()
        self._open = False
        self._peer: PipeEnd[U] = self

    def open(self) -> None:
        """Start hearing the other end; never fails."""
        with self._arrived:
            self._inbox.clear()
            self._open = True

    def write(self, unit: U) -> None:
        """Hand ``unit`` to the other end at once."""
        if not self._open:
            raise LinkError(f"pipe {self.name} is closed; open it first")
        self.written += 1
        peer = self._peer
        with peer._arrived:
            if not peer._open:
                self.unheard += 1
                return
            if len(peer._inbox) >= self._capacity:
                peer._inbox.popleft()
                self.overflowed += 1
            peer._inbox.append(unit)
            peer._arrived.notify_all()

    def read(self, timeout_s: float) -> list[U]:
        """Return everything that has come; waits in real time only if ``timeout_s`` > 0."""
        with self._arrived:
            if not self._open:
                raise LinkError(f"pipe {self.name} is closed; open it first")
            if not self._inbox and timeout_s > 0:
                self._arrived.wait(timeout_s)
            units = list(self._inbox)
            self._inbox.clear()
            return units

    def close(self) -> None:
        """Stop hearing; what has come and was not read is gone."""
        with self._arrived:
            self._open = False
            self._inbox.clear()
            self._arrived.notify_all()


def pipe(capacity: int = PIPE_CAPACITY) -> tuple[PipeEnd[U], PipeEnd[U]]:
    """Two ends of a wire in memory: what one writes, the other reads, in order and at once."""
    a: PipeEnd[U] = PipeEnd("a", capacity)
    b: PipeEnd[U] = PipeEnd("b", capacity)
    a._peer, b._peer = b, a
    return a, b
