"""The rate of Status and Advice: once a cycle, and again until the next.

A controller stops after a short silence, so that people need not be farther away for the case that
a link dies. Messages must then come at a rate at which a few may be lost. A repetition is the
newest advice with its age; ``docs/decisions/repeated-advice.md`` says why the delay budget
covers it.
"""

from math import ceil

LOST_MESSAGES = 2
"""Number of messages in a row that may be lost without silence, at the default interval."""
HEARD_LATE_S = 0.015
"""Time by which a message may seem late to its receiver: one cycle of a PLC, 10 ms, and jitter."""
MAX_REPEAT_HZ = 200.0


def default_interval_s(silence_timeout_s: float) -> float:
    """Return the interval at which ``LOST_MESSAGES`` lost in a row are not yet silence."""
    room_s = silence_timeout_s - HEARD_LATE_S
    return max(1.0 / MAX_REPEAT_HZ, room_s / (LOST_MESSAGES + 1))


def lost_without_silence(silence_timeout_s: float, interval_s: float) -> int:
    """Return the number of messages in a row that may be lost; -1 if each interval is silence."""
    return int((silence_timeout_s - HEARD_LATE_S) / interval_s + 1e-9) - 1


def messages_hz(interval_s: float, least_hz: float, most_hz: float) -> float:
    """Return how often a message is sent at most.

    Args:
        interval_s: after which the newest is sent again.
        least_hz, most_hz: limits between which the cycles come; each sends a new one.
    """
    shortest_s, longest_s = 1.0 / most_hz, 1.0 / least_hz
    sent = max(1, ceil(shortest_s / interval_s - 1e-9))  # in the shortest cycle
    once_more_s = sent * interval_s  # a cycle that is longer than this sends once more
    if once_more_s < longest_s - 1e-9:
        return max(sent / shortest_s, (sent + 1) / once_more_s)
    return sent / shortest_s
