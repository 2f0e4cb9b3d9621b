"""Stamps of ROS messages, and the clock that they appear to come from."""

from typing import Any, Literal

CLOSE_NS = 3600 * 10**9
"""Maximum difference between a stamp and its clock; time zones and wrong dates differ by more."""

StampClock = Literal["utc", "boot", "other"]


def stamp_ns(stamp: Any) -> int:
    """Return a ``builtin_interfaces/Time`` in nanoseconds.

    Raises:
        ValueError: its field ``nanosec`` exceeds 999,999,999.
    """
    if not 0 <= stamp.nanosec < 10**9:
        raise ValueError("a stamp with a second or more of nanoseconds")
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def clock_of(at_ns: int, utc_ns: int, boot_ns: int) -> StampClock:
    """Return which clock a stamp was taken from.

    The stamp is compared with this machine's clocks at the same time. Simulated time and the boot
    clock of another machine are "other".

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
