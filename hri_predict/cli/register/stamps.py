"""``check --listen``: do a sender's stamps run as fast as time passes?

Scenes carry the time of capture, in nanoseconds once decoded. Stamps of another unit are understood
all the same, as those of a clock that stands nearly still or that races, so each scene looks newer
or older than it is.
"""

import math
from collections.abc import Sequence

TOO_SLOW = {1e9: "seconds", 1e6: "milliseconds", 1e3: "microseconds"}
"""Units in place of nanoseconds, by the factor that the stamps lack."""
TOO_FAST = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
"""Units in place of seconds, by the factor that the stamps have too much."""
LEAST_SPAN_NS = 200_000_000
"""Over a shorter time, the arrival of bursts says nothing about stamps."""
LEAST_STAMPS = 10
WITHIN = 3.0
"""Factor within which the two times agree: units differ by a thousand, and clocks by much less."""


def stamps_remedy(captured_ns: Sequence[int], arrived_ns: Sequence[int]) -> str | None:
    """Return the problem of the stamps and the remedy, in one line; ``None`` if there is none.

    Args:
        captured_ns: the stamps, in the order of arrival.
        arrived_ns: when the scenes arrived.
    """
    if len(captured_ns) < 2:
        return None
    stamped, passed = captured_ns[-1] - captured_ns[0], arrived_ns[-1] - arrived_ns[0]
    if len(captured_ns) >= LEAST_STAMPS and stamped == 0:
        return "all stamps are alike: let the sender state the time of capture of each scene"
    if passed < LEAST_SPAN_NS:
        return None
    if stamped < 0:
        return "stamps run backwards: let the sender state the time of capture of each scene"
    pace = stamped / passed
    for factor, unit in TOO_SLOW.items():
        if _is_near(pace * factor):
            return (
                f"stamps count {unit} where nanoseconds are meant: let the sender multiply the "
                f"time of capture by {factor:,.0f}"
            )
    for factor, unit in TOO_FAST.items():
        if _is_near(pace / factor):
            return (
                f"stamps count {unit} where seconds are meant: let the sender divide the time of "
                f"capture by {factor:,.0f}"
            )
    if stamped and not _is_near(pace):
        return (
            f"stamps run {pace:.3g} times as fast as time passes: let the sender state the time "
            f"of capture of each scene"
        )
    return None


def _is_near(pace: float) -> bool:
    """Whether a pace is that of time."""
    return pace > 0 and abs(math.log(pace)) < math.log(WITHIN)
