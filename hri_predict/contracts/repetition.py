"""The rate of Status and Advice: once a cycle, and repeated until the next cycle.

A controller stops after a short silence, so that people need little extra distance in case a link
fails. Messages must then be frequent enough that a few may be lost. A repetition is the newest
advice with its age; ``docs/decisions/repeated-advice.md`` says why the delay budget covers it.
"""

from math import ceil

LOST_MESSAGES = 2
"""Number of messages in a row that may be lost without silence, at the default interval."""
HEARD_LATE_S = 0.015
"""Apparent lateness of a message at its receiver: one PLC cycle, 10 ms, and jitter."""
MAX_REPEAT_HZ = 200.0


def default_interval_s(silence_timeout_s: float) -> float:
    """Return the interval at which ``LOST_MESSAGES`` consecutive losses do not exceed the
    timeout.
    """
    room_s = silence_timeout_s - HEARD_LATE_S
    return max(1.0 / MAX_REPEAT_HZ, room_s / (LOST_MESSAGES + 1))


def lost_without_silence(silence_timeout_s: float, interval_s: float) -> int:
    """Return the number of consecutive messages that may be lost; -1 if every interval exceeds the
    timeout.
    """
    return int((silence_timeout_s - HEARD_LATE_S) / interval_s + 1e-9) - 1


def messages_hz(interval_s: float, least_hz: float, most_hz: float) -> float:
    """Return the maximum rate of a message.

    Args:
        interval_s: time after which the newest message is repeated.
        least_hz, most_hz: limits of the cycle rate; each cycle sends a new message.
    """
    shortest_s, longest_s = 1.0 / most_hz, 1.0 / least_hz
    sent = max(1, ceil(shortest_s / interval_s - 1e-9))  # in the shortest cycle
    once_more_s = sent * interval_s  # a cycle that is longer than this sends once more
    if once_more_s < longest_s - 1e-9:
        return max(sent / shortest_s, (sent + 1) / once_more_s)
    return sent / shortest_s
