"""Stamps of ROS messages, and which clock they seem to be of."""

from typing import Any, Literal

CLOSE_NS = 3600 * 10**9
"""Stamps within this time of a clock are of that clock: time zones and wrong dates are farther."""

StampClock = Literal["utc", "boot", "other"]


def stamp_ns(stamp: Any) -> int:
    """Nanoseconds of a ``builtin_interfaces/Time``.

    Raises:
        ValueError: it has more than 999,999,999 nanoseconds.
    """
    if not 0 <= stamp.nanosec < 10**9:
        raise ValueError("a stamp with a second or more of nanoseconds")
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def clock_of(at_ns: int, utc_ns: int, boot_ns: int) -> StampClock:
    """Return the clock that a stamp is of, by its distance from this machine's clocks then.

    Simulated time, and the boot clock of another machine, are "other".

    Args:
        at_ns: the stamp.
        utc_ns: nanoseconds since 1970.
        boot_ns: nanoseconds since this machine started.
    """
    if abs(at_ns - utc_ns) <= CLOSE_NS:
        return "utc"
    return "boot" if boot_ns - CLOSE_NS <= at_ns <= boot_ns and at_ns > 0 else "other"


CLOCK_TEXTS: dict[StampClock, str] = {
    "utc": "UTC",
    "boot": "time since this machine started",
    "other": "neither UTC nor this machine's uptime: simulated time, or another machine's uptime",
}
