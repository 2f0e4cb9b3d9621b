"""``check --listen``: do a sender's stamps count nanoseconds?

Scenes carry the time of capture in nanoseconds. A sender that counts in milliseconds is understood
all the same, as one whose clock stands nearly still, so that each scene looks newer than it is.
"""

import math
from collections.abc import Sequence

UNITS_NS = {"seconds": 1e9, "milliseconds": 1e6, "microseconds": 1e3}
LEAST_SPAN_NS = 200_000_000
"""Over a shorter time, the arrival of bursts says nothing about stamps."""
WITHIN = 3.0
"""Factor within which the two times agree: units differ by a thousand, and clocks by much less."""


def unit_of_stamps(captured_ns: Sequence[int], arrived_ns: Sequence[int]) -> str | None:
    """The unit that stamps count in, if it is not nanoseconds; ``None`` if they fit.

    Args:
        captured_ns: the stamps, in the order of arrival.
        arrived_ns: when the scenes arrived.
    """
    if len(captured_ns) < 2 or arrived_ns[-1] - arrived_ns[0] < LEAST_SPAN_NS:
        return None
    stamped, passed = captured_ns[-1] - captured_ns[0], arrived_ns[-1] - arrived_ns[0]
    if stamped <= 0:
        return None
    for unit, ns in UNITS_NS.items():
        if abs(math.log(stamped * ns / passed)) < math.log(WITHIN):
            return unit
    return None


def stamps_remedy(captured_ns: Sequence[int], arrived_ns: Sequence[int]) -> str | None:
    """Return the problem of the stamps and the remedy, in one line; ``None`` if there is none."""
    unit = unit_of_stamps(captured_ns, arrived_ns)
    if unit is not None:
        factor = round(UNITS_NS[unit])
        return (
            f"stamps count {unit} where nanoseconds are meant: let the sender multiply the time "
            f"of capture by {factor:,}"
        )
    if len(captured_ns) >= 10 and captured_ns[-1] == captured_ns[0]:
        return "all stamps are alike: let the sender state the time of capture, in nanoseconds"
    return None
