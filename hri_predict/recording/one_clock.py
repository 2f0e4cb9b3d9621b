"""Captures on one clock, although the sender's clock was set back, or some stamps are wrong.

A sender that starts again during a recording often counts from zero again. Ordered by stamps alone,
all that follows would be left out until the stamps exceed the old ones, and the rest would seem to
follow immediately: a person would leap.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.contracts.scene import Scene
from hri_predict.recording.recording import Recording

MANY = 10
"""From this number of captures in a row on, none is wrong: the clock was set back."""
LONG_NS = 500_000_000
"""Captures are not as late as this: before the end, fewer than ``MANY`` mean the same."""


@dataclass(frozen=True, slots=True)
class OneClock:
    """Times of captures, in the order of their receipt.

    Attributes:
        times_ns: on the clock of the first ones, and never decreasing; ``None`` for a capture that
            came late, or whose stamp is wrong.
        restarts: captures at which the sender's clock was set back.
    """

    times_ns: list[int | None]
    restarts: list[int]


def on_one_clock(stamps_ns: Sequence[int], receipts_ns: Sequence[int]) -> OneClock:
    """Return times of captures; they are the stamps themselves if these never decrease.

    After the clock was set back, the captures go on where the receipts say, and then by their
    stamps.
    """
    times: list[int | None] = []
    restarts: list[int] = []
    kept: list[tuple[int, int]] = []  # capture, and its time
    shift_ns = 0
    for k, stamp_ns in enumerate(stamps_ns):
        times.append(None)
        time_ns = stamp_ns + shift_ns
        if kept and time_ns < kept[-1][1]:
            last, last_ns = kept[-1]
            behind, recovers = _behind(stamps_ns[k : k + MANY], last_ns - shift_ns)
            ahead = sum(ns > time_ns for _, ns in kept[-MANY:])
            if ahead < behind:  # these stamps were wrong, not the many after them
                for wrong, _ in kept[-ahead:]:
                    times[wrong] = None
                del kept[-ahead:]
            elif behind == MANY or not (recovers or last_ns - time_ns <= LONG_NS):
                passed_ns = receipts_ns[k] - receipts_ns[last]
                time_ns = last_ns + max(passed_ns, _usual_step(stamps_ns))
                shift_ns = time_ns - stamp_ns
                restarts.append(k)
            else:
                continue
        times[k] = time_ns
        kept.append((k, time_ns))
    return OneClock(times, restarts)


def timed(recording: Recording) -> Iterator[tuple[int, Scene]]:
    """Yield the scenes of a recording with their times (ns), which never decrease."""
    stamps = [scene.stamp_ns for scene in recording.scenes]
    times = on_one_clock(stamps, recording.arrival_ns).times_ns
    for time_ns, scene in zip(times, recording.scenes, strict=True):
        if time_ns is not None:
            yield time_ns, scene


def _behind(stamps_ns: Sequence[int], last_ns: int) -> tuple[int, bool]:
    """Return how many stamps come before the first one that is not before ``last_ns``, if any."""
    for count, stamp_ns in enumerate(stamps_ns):
        if stamp_ns >= last_ns:
            return count, True
    return len(stamps_ns), False


def _usual_step(stamps_ns: Sequence[int]) -> int:
    return max(1, int(np.median(np.diff(stamps_ns))))
