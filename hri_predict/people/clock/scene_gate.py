"""Decides whether scenes of a source are new, and computes their capture times."""

from collections import Counter, deque

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.contracts.scene import Scene
from hri_predict.people.clock.clock_alignment import ClockAlignment
from hri_predict.people.clock.offset_line import WANDER_NS
from hri_predict.people.ring_buffer import NEVER

# -- captures of an even rate whose stamps scatter: each is moved to where the rate puts it --------
#
# Cameras capture at an even rate. A tracker that stamps a body when it has computed it stamps
# late, now more, now less: at 1.5 m/s and 30 ms a walker jumps by up to 4 cm along the way, and
# forecasts fail by that. Over the last ``WINDOW`` scenes the captures are a line over the scenes'
# sequence, plus lateness. The line's slope is that of least squares, and it lies so low that no
# capture is before it. A capture is moved to the line: to the past alone, so that its age becomes
# larger, never smaller.
#
# Nothing is moved where the scatter is not that of stamps:
#
# - it is below ``LEAST_NS`` (the standard deviation about the line);
# - it is above ``MOST_NS`` (the latest capture of the window): the source paused, dropped scenes
#   that its sequence does not count, or changed its rate;
# - it adds up. If each capture is late by itself, the variance about the line is half of that of
#   the steps from capture to capture. If captures themselves come unevenly, each step moves all
#   that follow, and it is far larger. ``ADDS_UP`` lies between.

WINDOW = 90
"""Number of scenes, 3 s at 30 Hz: the line is then accurate to 2 ms if stamps are up to 30 ms
late."""
FEWEST = 30
LEAST_NS = 2_000_000
MOST_NS = 40_000_000
ADDS_UP = 0.8
MOST_SCENES = 2**53  # exact in double precision


class EvenCaptures:
    """Corrects capture times of one source to an even rate.

    Attributes:
        moved: number of captures moved since the start.
    """

    def __init__(self) -> None:
        self.moved = 0
        self._sequences: deque[int] = deque(maxlen=WINDOW)
        self._captures: deque[int] = deque(maxlen=WINDOW)
        self._newest_ns: int | None = None

    def forget(self) -> None:
        """Start again, because the source restarted or its clock jumped."""
        self._sequences.clear()
        self._captures.clear()
        self._newest_ns = None

    def move(self, sequence: int, capture_ns: int) -> int:
        """Return the capture time of a scene: the given time, or up to ``MOST_NS`` earlier.

        Args:
            sequence: sequence of the scene, higher than the last.
            capture_ns: stamped capture time, node's clock.
        """
        if self._sequences and sequence <= self._sequences[-1]:
            self.forget()
        self._sequences.append(sequence)
        self._captures.append(capture_ns)
        late_ns, step_ns = self._late()
        if late_ns > 0:
            # the first one that is moved must not come right after one that was not
            after_ns = capture_ns if self._newest_ns is None else self._newest_ns + step_ns // 2
            moved_ns = max(capture_ns - late_ns, min(capture_ns, after_ns))
            self.moved += moved_ns < capture_ns
            capture_ns = moved_ns
        self._newest_ns = capture_ns
        return capture_ns

    def _late(self) -> tuple[int, int]:
        """Return the lateness of the newest stamp, 0 if nothing is moved, and the line's step."""
        if len(self._captures) < FEWEST:
            return 0, 0
        first = self._sequences[0]  # a source may count further than 64 bits
        scenes = np.array([min(s - first, MOST_SCENES) for s in self._sequences], np.float64)
        stamps = np.array(self._captures, dtype=np.int64) - self._captures[0]
        late, step_ns = _lateness(scenes, stamps.astype(np.float64))
        scatter = float(late.std())
        if scatter < LEAST_NS or late.max() > MOST_NS:
            return 0, 0
        if scatter**2 > ADDS_UP * np.diff(late).var():
            return 0, 0
        return int(late[-1]), int(step_ns)


def _lateness(scenes: Floats, stamps: Floats) -> tuple[Floats, float]:
    """Return (N,) ns above the lowest line of least-squares slope, and the slope (ns/scene)."""
    apart = scenes - scenes.mean()
    slope = float((apart @ stamps) / (apart @ apart))
    late: Floats = stamps - slope * scenes
    return late - late.min(), slope


# --------------------------------------------------------------------------------------------------

RESTART_SCENES = 10
"""Number of consecutive scenes counting up from a lower sequence that indicate a restart."""


class SceneGate:
    """Lets a scene pass if its sequence and its capture advance.

    A repeated scene contains no new information, however often it arrives, and must not make the
    input look fresh.

    Args:
        period_ns: the source's nominal time between captures.
        min_latency_ns: minimum time from capture to receipt.
        clock_wander_ns: see ``ClockAlignment``.
        even_captures: whether captures arrive at an even rate; see ``EvenCaptures``.
        stamps_are_ours: stamps are already capture times on the node's clock, so nothing is
            aligned.

    Attributes:
        alignment: alignment of the source's clock with the node's.
        capture_ns: capture time of the newest scene that passed (node's clock).
        repeats: number of consecutive scenes that did not advance.
        counters: number of scenes by outcome.
    """

    def __init__(
        self,
        period_ns: int,
        min_latency_ns: int,
        *,
        clock_wander_ns: int = WANDER_NS,
        even_captures: bool = True,
        stamps_are_ours: bool = False,
    ) -> None:
        self._min_latency_ns = min_latency_ns
        self._stamps_are_ours = stamps_are_ours
        self.alignment = ClockAlignment(period_ns, min_latency_ns, wander_ns=clock_wander_ns)
        self._even = EvenCaptures() if even_captures and not stamps_are_ours else None
        self.repeats = 0
        self.counters: Counter[str] = Counter()
        self._sequence: int | None = None
        self._refused_sequence: int | None = None
        self._refused_run = 0
        self.capture_ns = NEVER

    def admit(self, scene: Scene, receipt_ns: int) -> int | None:
        """Return the scene's capture time (node's clock); ``None`` if it does not advance."""
        self.counters["scenes"] += 1
        if not self._advances(scene.sequence):
            self.repeats += 1
            return None
        self._sequence = scene.sequence
        jumps = self.alignment.jumps
        if self._stamps_are_ours:
            capture_ns = min(scene.stamp_ns, receipt_ns - self._min_latency_ns)
        else:
            capture_ns = self.alignment.align(scene.stamp_ns, scene.sequence, receipt_ns)
        if self._even is not None:
            if self.alignment.jumps != jumps:
                self._even.forget()
            capture_ns = self._even.move(scene.sequence, capture_ns)
        if capture_ns <= self.capture_ns:
            self.counters["stamps_out_of_order"] += 1
            self.repeats += 1
            return None
        self.capture_ns = capture_ns
        self.repeats = 0
        return capture_ns

    def _advances(self, sequence: int) -> bool:
        last = self._sequence
        if last is None or sequence > last:
            self.counters["lost_scenes"] += 0 if last is None else sequence - last - 1
            self._refused_sequence, self._refused_run = None, 0
            return True
        counts_on = self._refused_sequence is not None and sequence > self._refused_sequence
        self._refused_run = self._refused_run + 1 if counts_on else 1
        self._refused_sequence = sequence
        if self._refused_run >= RESTART_SCENES:
            self.counters["source_restarts"] += 1
            if not self._stamps_are_ours:  # otherwise no clock has changed
                self.alignment.restart()
            if self._even is not None:
                self._even.forget()
            self._refused_sequence, self._refused_run = None, 0
            return True
        self.counters["duplicate_scenes" if sequence == last else "scenes_out_of_order"] += 1
        return False

    def counts(self) -> dict[str, int]:
        """Return the counters of the scenes and of the clock."""
        clock = {"clock_jumps": self.alignment.jumps, "clock_spikes": self.alignment.spikes}
        evened = {} if self._even is None else {"stamps_evened": self._even.moved}
        return {**self.counters, **clock, **evened}
