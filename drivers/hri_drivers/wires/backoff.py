"""Wait before the next attempt to open a lost device."""

FIRST_S = 0.05
LAST_S = 2.0
SETTLED_NS = 1_000_000_000
"""A connection that lasted this long resets the back-off."""


class BackOff:
    """Doubles the wait after each failure, from 50 ms up to 2 s (exponential back-off)."""

    def __init__(self) -> None:
        self._wait_s = FIRST_S
        self._opened_ns: int | None = None

    def opened(self, now_ns: int) -> None:
        """Note that the device is open."""
        self._opened_ns = now_ns

    def next_s(self, now_ns: int) -> float:
        """Seconds to wait now that the device is lost or did not open."""
        if self._opened_ns is not None and now_ns - self._opened_ns >= SETTLED_NS:
            self._wait_s = FIRST_S
        self._opened_ns = None
        wait_s = self._wait_s
        self._wait_s = min(2 * wait_s, LAST_S)
        return wait_s
