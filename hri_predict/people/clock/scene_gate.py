"""Decides which scenes of a source are new, and when they were captured."""

from collections import Counter

from hri_predict.contracts.scene import Scene
from hri_predict.people.clock.clock_alignment import ClockAlignment
from hri_predict.people.clock.even_captures import EvenCaptures
from hri_predict.people.clock.offset_line import WANDER_NS
from hri_predict.people.ring_buffer import NEVER

RESTART_SCENES = 10
"""After this many consecutive scenes that count up from a lower sequence, the source restarted."""


class SceneGate:
    """Lets a scene pass if its sequence and its capture advance.

    A repeated scene holds no new information, however often it arrives. It must not make the input
    look fresh.

    Args:
        period_ns: the source's nominal time between captures.
        min_latency_ns: least time from capture to receipt.
        clock_wander_ns: see ``ClockAlignment``.
        even_captures: whether captures come at an even rate; see ``EvenCaptures``.

    Attributes:
        alignment: alignment of the source's clock with the node's.
        capture_ns: of the newest scene that passed (node's clock).
        repeats: number of consecutive scenes that did not advance.
        counters: counts of the scenes by their fate.
    """

    def __init__(
        self,
        period_ns: int,
        min_latency_ns: int,
        *,
        clock_wander_ns: int = WANDER_NS,
        even_captures: bool = True,
    ) -> None:
        self.alignment = ClockAlignment(period_ns, min_latency_ns, wander_ns=clock_wander_ns)
        self._even = EvenCaptures() if even_captures else None
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
