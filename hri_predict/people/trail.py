"""Path of a body in the last second, and a check that a single person can have taken it.

An id identifies a person only while the motion is consistent. A person has mass: speed changes by a
few metres per second in a second, not instantly. So if the motion between two captures requires a
greater change, the bodies before and after it are two people, however close together.
"""

from collections import deque

import numpy as np

from hri_predict.base.arrays import Floats, Ints, median

SPAN_S = 0.15
"""Minimum time over which speed before and after a step is measured: five captures at 30 Hz."""
STEP_S = 0.36
"""Maximum span in which a change from one person to another is detected: three captures at 8 Hz."""
KEEP_S = 1.0
SAME_ID_M_S2 = 10.0
"""Maximum acceleration of a trunk seen throughout: a fall, a runner's sharp turn."""
FOUND_M_S2 = 2.0
"""Maximum acceleration of a person out of view: from standing to walking in a step."""
SEEN_SLACK_M = 0.18
"""Error of a path that was seen throughout: noise, or a part of the body that moves by itself."""
FOUND_SLACK_M = 0.06
"""Error of a path across a gap, with both ends averaged over ``SPAN_S``."""
SPEED_SLACK_M_S = 0.3
"""Error of a measured change of speed: a trunk sways while it walks."""
NOISES = 8.0
"""Maximum ratio of an error to the usual error; see ``Trail.noise_m``."""
MOST_NOISE_M = 0.4
"""Maximum distance attributed to noise: two people may stand this close together."""


class Trail:
    """The path of one body, from capture to capture, over the last second.

    Attributes:
        place: (2,) displacement of the body over the floor since its first capture, m.
        found_ns: newest capture at which the body was found after a gap, until its motion
            afterwards has been compared with the motion before; ``None``: nothing to compare.
        is_near: whether the body was found exactly where its motion led.
    """

    def __init__(self) -> None:
        self.place: Floats = np.zeros(2)
        self.found_ns: int | None = None
        self.is_near = True
        self._stamps: deque[int] = deque()
        self._places: deque[Floats] = deque()
        self._loose: deque[float] = deque()
        self._as_arrays: tuple[Floats, Floats] | None = None

    def add(self, capture_ns: int, moved: Floats, loose_m: float) -> None:
        """Record a motion of ``moved`` (2,) to this capture, with an error of ``loose_m``."""
        self.place = self.place + moved
        self._stamps.append(capture_ns)
        self._places.append(self.place)
        self._loose.append(loose_m)
        self._as_arrays = None
        while capture_ns - self._stamps[0] > KEEP_S * 1e9 and len(self._stamps) > 2:
            self._stamps.popleft()
            self._places.popleft()
            self._loose.popleft()
        if self.found_ns is not None and self.found_ns < self._stamps[0]:
            self.found_ns = None  # too long ago to be compared

    def find(self, capture_ns: int, is_near: bool) -> None:
        """Record that the body is found again at this capture, which is added next."""
        if self.found_ns is None or not is_near:
            self.found_ns, self.is_near = capture_ns, is_near

    def doubted_ns(self) -> int | None:
        """Return the last capture before the body was found, if it may not be the same body."""
        if self.found_ns is None or self.is_near:
            return None
        return max((ns for ns in self._stamps if ns < self.found_ns), default=None)

    @property
    def travelled(self) -> Floats:
        """Return (2,) displacement of the body since the oldest kept capture."""
        return self.place - self._places[0]

    def velocity(self) -> Floats | None:
        """Return (2,) most recent velocity in m/s; ``None`` if not measured."""
        seconds, places = self._arrays()
        if len(seconds) < 2:
            return None
        first = int(np.flatnonzero(seconds <= -SPAN_S)[-1]) if seconds[0] <= -SPAN_S else 0
        velocity: Floats = (places[-1] - places[first]) / -seconds[first]
        return velocity

    def noise_m(self) -> float:
        """Return the usual distance of a capture from the midpoint of its neighbours."""
        if len(self._places) < 5:
            return 0.0
        _, places = self._arrays()
        bent = places[1:-1] - 0.5 * (places[2:] + places[:-2])
        return median(_norm(bent))

    def slack_m(self, least_m: float) -> float:
        """Return the maximum error of a step: ``least_m``, or more if the body is noisy."""
        return max(least_m, min(NOISES * self.noise_m(), MOST_NOISE_M))

    def slip(self) -> tuple[int, int] | None:
        """Find a step that no single person can have made, using the motion after the step.

        Returns:
            the last capture of the first person, and the first capture of the second.
        """
        seconds, places = self._arrays()
        last = int(np.searchsorted(seconds, -SPAN_S, side="right")) - 1
        if last < 1:
            return None
        if self.found_ns is not None and self.found_ns <= self._stamps[last]:
            # the capture is missing if the history refused it
            found = next((i for i, ns in enumerate(self._stamps) if ns == self.found_ns), 0)
            self.found_ns = None
            if found and self._torn(seconds, places, np.array([found - 1]), found, is_found=True):
                return self._stamps[found - 1], self._stamps[found]
        earliest = max(1, int(np.searchsorted(seconds, seconds[last] - STEP_S)))
        starts = np.arange(last - 1, earliest - 1, -1)
        torn = self._torn(seconds, places, starts, last, is_found=False)
        return (self._stamps[torn[0]], self._stamps[last]) if torn else None

    def _torn(
        self, seconds: Floats, places: Floats, starts: Ints, end: int, *, is_found: bool
    ) -> list[int]:
        """Return the ``starts`` from which no person can reach ``end`` with the speeds at both."""
        earlier = np.searchsorted(seconds, seconds[starts] - SPAN_S, side="right") - 1
        earlier = np.maximum(earlier, 0)
        known = seconds[starts] - seconds[earlier] >= SPAN_S / 2
        starts, earlier = starts[known], earlier[known]
        if not len(starts):
            return []
        before = (places[starts] - places[earlier]) / (seconds[starts] - seconds[earlier])[:, None]
        after = (places[-1] - places[end]) / -seconds[end]
        taken = (seconds[end] - seconds[starts])[:, None]
        beyond = _norm(places[end] - places[starts] - 0.5 * (before + after) * taken)
        change, taken = _norm(after - before), taken[:, 0]
        if is_found:
            change = np.maximum(change - self.slack_m(SPEED_SLACK_M_S), 0.0)
            most = ((FOUND_M_S2 * taken) ** 2 - change**2) / (4 * FOUND_M_S2)
            beyond = np.where(most < 0.0, np.inf, beyond)
            slack_m = self.slack_m(FOUND_SLACK_M)
        else:
            most = 0.25 * SAME_ID_M_S2 * taken**2
            slack_m = self.slack_m(SEEN_SLACK_M)
        slack_m += max(self._loose)
        return [int(i) for i in starts[beyond > most + slack_m]]

    def _arrays(self) -> tuple[Floats, Floats]:
        """Return (N,) times relative to the newest capture (negative), and (N, 2) positions."""
        if self._as_arrays is None:
            stamps = np.array(self._stamps, np.int64)
            self._as_arrays = (stamps - stamps[-1]) * 1e-9, np.array(self._places)
        return self._as_arrays


def _norm(vectors: Floats) -> Floats:
    """Return (N,) lengths of (N, 2) vectors."""
    length: Floats = np.hypot(vectors[:, 0], vectors[:, 1])
    return length
