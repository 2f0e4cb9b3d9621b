"""UTC of a recording's times on the node's clock, even if the wall clock was set meanwhile."""

import itertools

from hri_predict.recording import Told
from hri_predict.recording.mcap.clocks import STEP_NS


class RecordedTimes:
    """Offsets of UTC from the node's clock, which nothing sets, and which thus orders messages."""

    def __init__(self) -> None:
        self._offsets: list[tuple[int, int]] = []

    def note(self, told: Told) -> None:
        """Note the offset at a message; the node's times of successive messages never decrease."""
        offset_ns = told.utc_ns - told.node_ns
        if not self._offsets or abs(offset_ns - self._offsets[-1][1]) > STEP_NS:
            self._offsets.append((told.node_ns, offset_ns))

    def utc(self, start_ns: int, end_ns: int) -> list[tuple[int, int]]:
        """Return UTC intervals that contain a span of the node's time, and do not overlap.

        They are wider than the span, because an offset drifts, and because the wall clock may have
        been set in the middle of a tick.
        """
        found: list[tuple[int, int]] = []
        starts_ns = [start_ns, *(at_ns for at_ns, _ in self._offsets[1:]), end_ns]
        for (from_ns, to_ns), (_, offset_ns) in zip(
            itertools.pairwise(starts_ns), self._offsets, strict=True
        ):
            low = max(from_ns, start_ns) - STEP_NS
            high = min(to_ns, end_ns) + STEP_NS
            if low >= high:
                continue
            low, high = low + offset_ns, high + offset_ns
            for other in [each for each in found if low < each[1] and each[0] < high]:
                found.remove(other)
                low, high = min(low, other[0]), max(high, other[1])
            found.append((low, high))
        return found
