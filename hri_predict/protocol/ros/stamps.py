"""Stamps of ROS messages, and the clock that they appear to come from."""

from typing import Any, Literal

CLOSE_NS = 3600 * 10**9
"""Maximum difference between a stamp and its clock; time zones and wrong dates differ by more."""

StampClock = Literal["utc", "boot", "other"]


def stamp_ns(stamp: Any) -> int:
    """Return the nanoseconds of a ``builtin_interfaces/Time``.

    Raises:
        ValueError: it has more than 999,999,999 nanoseconds.
    """
    if not 0 <= stamp.nanosec < 10**9:
        raise ValueError("a stamp with a second or more of nanoseconds")
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def clock_of(at_ns: int, utc_ns: int, boot_ns: int) -> StampClock:
    """Return the clock of a stamp, found by comparison with this machine's clocks at that time.

    Simulated time and the boot clock of another machine are "other".

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
