"""Interface that a link requires of a wire; an in-memory wire for virtual time and tests."""

import threading
from collections import deque
from typing import Generic, TypeVar

from hri_predict.base.errors import LinkError
from hri_predict.contracts.link import Transport

__all__ = ["PipeEnd", "Transport", "TransportBusy", "pipe"]

U = TypeVar("U")

READ_TIMEOUT_S = 0.1
"""Maximum wait of a thread in ``read``, and therefore maximum time to stop the thread."""
PIPE_CAPACITY = 4096
TOO_SLOW = (
    "the simulated controller does not read in time: this machine is too slow; stop other "
    "programs, or lower rate_hz"
)
"""Replaces the remedies of ``TransportBusy`` for cables, which a simulated link does not have."""


class TransportBusy(LinkError):
    """The wire accepts nothing now (buffer full, write timed out), but the device is still present.

    The unit was not accepted, or only in part. A link keeps the message and encodes it again later.
    """


class PipeEnd(Generic[U]):
    """One end of ``pipe()``.

    Attributes:
        written: units accepted since the start.
        overflowed: units lost because the other end did not read in time; the oldest go first, as
            in a full receive buffer.
        unheard: number of units written while the other end was closed.
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
        """Start receiving from the other end; never fails."""
        with self._arrived:
            self._inbox.clear()
            self._open = True

    def write(self, unit: U) -> None:
        """Pass ``unit`` to the other end immediately."""
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
        """Return everything that has arrived; waits in real time only if ``timeout_s`` > 0."""
        with self._arrived:
            if not self._open:
                raise LinkError(f"pipe {self.name} is closed; open it first")
            if not self._inbox and timeout_s > 0:
                self._arrived.wait(timeout_s)
            units = list(self._inbox)
            self._inbox.clear()
            return units

    def close(self) -> None:
        """Stop receiving, and discard unread units."""
        with self._arrived:
            self._open = False
            self._inbox.clear()
            self._arrived.notify_all()


def pipe(capacity: int = PIPE_CAPACITY) -> tuple[PipeEnd[U], PipeEnd[U]]:
    """Two ends of a wire in memory: each reads the other's units, in order and without delay."""
    a: PipeEnd[U] = PipeEnd("a", capacity)
    b: PipeEnd[U] = PipeEnd("b", capacity)
    a._peer, b._peer = b, a
    return a, b
