"""Captures of an even rate whose stamps scatter: each is moved to where the rate puts it.

Cameras capture at an even rate. A tracker that stamps a body when it has computed it stamps late,
now more, now less: at 1.5 m/s and 30 ms a walker jumps by up to 4 cm along the way, and forecasts
fail by that. Over the last ``WINDOW`` scenes the captures are a line over the scenes' sequence,
plus lateness. The line's slope is that of least squares, and it lies so low that no capture is
before it. A capture is moved to the line: to the past alone, so that its age becomes larger, never
smaller.

Nothing is moved where the scatter is not that of stamps:

- it is below ``LEAST_NS`` (the standard deviation about the line);
- it is above ``MOST_NS`` (the latest capture of the window): the source paused, dropped scenes that
  its sequence does not count, or changed its rate;
- it adds up. If each capture is late by itself, the variance about the line is half of that of the
  steps from capture to capture. If captures themselves come unevenly, each step moves all that
  follow, and it is far larger. ``ADDS_UP`` lies between.
"""

from collections import deque

import numpy as np

from hri_predict.base.arrays import Floats

WINDOW = 90
"""Scenes, 3 s at 30 a second: the line is then known to 2 ms where stamps are up to 30 ms late."""
FEWEST = 30
LEAST_NS = 2_000_000
MOST_NS = 40_000_000
ADDS_UP = 0.8


class EvenCaptures:
    """Moves the captures of one source.

    Attributes:
        moved: captures moved since the start.
    """

    def __init__(self) -> None:
        self.moved = 0
        self._sequences: deque[int] = deque(maxlen=WINDOW)
        self._captures: deque[int] = deque(maxlen=WINDOW)
        self._newest_ns: int | None = None

    def forget(self) -> None:
        """Start again, since the source or its clock did."""
        self._sequences.clear()
        self._captures.clear()
        self._newest_ns = None

    def move(self, sequence: int, capture_ns: int) -> int:
        """Return when a scene was captured: at the time given, or up to ``MOST_NS`` earlier.

        Args:
            sequence: of the scene; it counts up from the last.
            capture_ns: as stamped, the node's clock.
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
        """Return the lateness of the newest stamp, 0 if nothing is moved; and the line's step."""
        if len(self._captures) < FEWEST:
            return 0, 0
        scenes = np.array(self._sequences, dtype=np.int64) - self._sequences[0]
        stamps = np.array(self._captures, dtype=np.int64) - self._captures[0]
        late, step_ns = _lateness(scenes.astype(np.float64), stamps.astype(np.float64))
        scatter = float(late.std())
        if scatter < LEAST_NS or late.max() > MOST_NS:
            return 0, 0
        if scatter**2 > ADDS_UP * np.diff(late).var():
            return 0, 0
        return int(late[-1]), int(step_ns)


def _lateness(scenes: Floats, stamps: Floats) -> tuple[Floats, float]:
    """(N,) ns above the lowest line of the least-squares slope, and that slope, ns per scene."""
    apart = scenes - scenes.mean()
    slope = float((apart @ stamps) / (apart @ apart))
    late: Floats = stamps - slope * scenes
    return late - late.min(), slope
