"""A connection that reads from a server at a fixed rate."""

import contextlib
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from hri_drivers.links.polled.reader import Sample
from hri_predict.base.errors import LinkError


class PolledTransport(ABC):
    """``Transport[Sample]``: reads the values when due, and writes nothing.

    Args:
        named: protocol and address, for messages.
        rate_hz: rate of the readings.
        monotonic_s: this machine's clock, s.
    """

    def __init__(
        self, named: str, rate_hz: float, monotonic_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._named = named
        self._period_s = 1.0 / rate_hz
        self._monotonic_s = monotonic_s
        self._closed = threading.Event()
        self._closed.set()
        self._due_s = 0.0
        self._asked_s: float | None = None

    @abstractmethod
    def _connect(self) -> None:
        """Connect, and check that all values can be read.

        Raises:
            LinkError: one line with the remedy.
        """

    @abstractmethod
    def _read(self) -> tuple[tuple[float | None, ...], str]:
        """Read everything in one request.

        Returns:
            The values, and the reason if one of them is not a number.

        Raises:
            LinkError: the connection is lost, or the server refuses.
        """

    @abstractmethod
    def _disconnect(self) -> None:
        """Close; never raises, safe to call twice."""

    def open(self) -> None:
        """Connect.

        Raises:
            LinkError: one line that names the address, what failed and the remedy.
        """
        self.close()
        try:
            self._connect()
        except LinkError as error:
            self._disconnect()
            raise LinkError(f"{self._named}: {error}") from error
        self._asked_s, self._due_s = None, self._monotonic_s()
        self._closed.clear()

    def write(self, unit: Sample) -> None:
        """Refuse: this link only reads.

        Raises:
            LinkError: always.
        """
        raise LinkError(f"{self._named}: this link only reads")

    def read(self, timeout_s: float) -> list[Sample]:
        """Wait until a reading is due, at most ``timeout_s``; return it, or nothing.

        Raises:
            LinkError: the connection is lost.
        """
        if self._closed.is_set():
            raise LinkError(f"{self._named} is closed; open it first")
        left_s = self._due_s - self._monotonic_s()
        if left_s > 0 and (self._closed.wait(min(left_s, timeout_s)) or left_s > timeout_s):
            return []
        asked_s = self._monotonic_s()
        try:
            values, why = self._read()
        except LinkError as error:
            raise LinkError(f"{self._named}: {error}") from error
        now_s = self._monotonic_s()
        span_s = None if self._asked_s is None else now_s - self._asked_s
        self._asked_s = asked_s
        self._due_s = max(self._due_s + self._period_s, now_s)
        return [Sample(values, span_s, why)]

    def close(self) -> None:
        """Close; never raises, safe to call twice."""
        self._closed.set()
        with contextlib.suppress(Exception):
            self._disconnect()
