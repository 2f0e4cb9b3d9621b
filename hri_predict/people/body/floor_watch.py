"""Detects an apparent shift of the floor: the sensor has sunk, tilted or been moved.

A skeleton shows the floor where a person stands: both ankles are still for a second at equal
height, with the hips above them. In 548 such seconds of recorded people the ankles were 3 to 14 cm
above the floor, so a floor that appears ``floor_drift_m`` higher or lower at the same place is not
due to another person. It may be a box, a pallet or a new platform, but only in one place: the
sensor counts as moved only if three places agree, each ``APART_M`` from the others.

The places and their heights are learnt in the first minutes of standing; a place with two heights,
such as the edge of a platform, is ignored. Not detected: a rotation about the vertical, a shift
along the floor, a sensor that was moved before the node started, and any shift in a cell in which
people stand at fewer than three places.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Doubt
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body
from hri_predict.protocol.reasons import Reason

STAND_NS, SAMPLE_NS = 1_000_000_000, 100_000_000
LEAST_SAMPLES = 4
"""Minimum number of samples in a second of standing: the sensor captures at least 5."""
STILL_M = 0.03
"""Maximum standard deviation of a standing person's ankle per axis: a step exceeds it."""
LEVEL_M = 0.08
"""Maximum height difference between the ankles: one foot on a step exceeds it."""
LEG_M = 0.65
"""Minimum height of the hips above the ankles: a seated person is below it."""
REACH_M, APART_M = 0.5, 1.0
"""Radius of a place; minimum distance between the three places that show a moved sensor: larger
than a pallet."""
FIRST, NEWEST, PLACES = 10, 5, 3
"""Standing time, in seconds, required for the initial and for the current height of a place; number
of places required."""
LEARNT = 600
"""Standing time, in seconds, after which no new place is learnt if ``PLACES`` are known."""
MOST_PLACES = 256
"""Maximum number of places kept; the least recently visited are dropped first."""
AGREES = 0.7
"""Share of the limit to which every place must return before the doubt ends."""
_FEET, _HIPS = ([JOINTS.index(f"{side}_{name}") for side in "lr"] for name in ("ankle", "hip"))


@dataclass(slots=True)
class _Second:
    """The captures of one body in the current second: ankles (2, 3) and the hips' mean height."""

    began_ns: int
    next_ns: int
    ankles: list[Floats] = field(default_factory=list)
    hips: list[float] = field(default_factory=list)


@dataclass(slots=True)
class _Place:
    """A place where people stand: (2,) initial and current position, and ankle heights, metres."""

    at: Floats
    now: Floats
    first: list[float] = field(default_factory=list)
    newest: deque[float] = field(default_factory=lambda: deque(maxlen=NEWEST))
    drift_m: float | None = None

    def add(self, height_m: float, limit_m: float) -> None:
        """Add a height, and update the rise of the floor relative to the initial height.

        While people stand at two heights, the rise does not change; ``None``: not yet known.
        """
        if len(self.first) < FIRST:
            self.first.append(height_m)
            return
        self.newest.append(height_m)
        if len(self.newest) == NEWEST and max(np.ptp(self.first), np.ptp(self.newest)) <= limit_m:
            self.drift_m = float(np.median(self.newest) - np.median(self.first))


class FloorWatch:
    """The floor under the people of one sensor. One thread only.

    Args:
        settings: ``floor_drift_m`` is the limit; without posture checks, the floor is not checked.

    Attributes:
        seconds: total standing time that was evaluated, in seconds.
    """

    def __init__(self, settings: PeopleSettings) -> None:
        self._on = settings.posture_unchecked is None
        self._limit_m = settings.floor_drift_m
        self.seconds = 0
        self._people: dict[int, _Second] = {}
        self._places: list[_Place] = []  # the last visited comes last
        self._drift_m: float | None = None

    def note(self, body: Body, capture_ns: int) -> None:
        """Add one body, room frame; ``capture_ns`` rises from call to call for each person.

        A body with a position error above ``floor_drift_m`` is ignored.
        """
        if not self._on or body.error_m >= self._limit_m:
            return
        second = self._people.get(body.id)
        if second is None or capture_ns - second.began_ns > 2 * STAND_NS:
            self._people = {
                k: s for k, s in self._people.items() if capture_ns - s.began_ns <= 2 * STAND_NS
            }
            second = self._people[body.id] = _Second(capture_ns, capture_ns)
        if capture_ns < second.next_ns:
            return
        second.next_ns = capture_ns + SAMPLE_NS
        if not (body.observed[_FEET].all() and body.observed[_HIPS].all()):
            del self._people[body.id]
            return
        second.ankles.append(body.positions[_FEET])
        second.hips.append(float(body.positions[_HIPS, 2].mean()))
        if capture_ns - second.began_ns >= STAND_NS:
            del self._people[body.id]
            place = _stands(second)
            if place is not None:
                self._stand(place)

    def doubts(self) -> tuple[Doubt, ...]:
        """Return the doubt while the floor appears shifted; otherwise none."""
        if self._drift_m is None:
            return ()
        way = "higher" if self._drift_m > 0 else "lower"
        cm = abs(self._drift_m) * 100
        text = f"the floor appears {cm:.0f} cm {way} than at first: the sensor was moved"
        return (Doubt(Reason.SENSOR_MOVED, text),)

    def _stand(self, ankles: Floats) -> None:
        """Add a second in which a person stood: (3,) the middle of the ankles."""
        at, away_m = ankles[:2], [math.dist(place.at, ankles[:2]) for place in self._places]
        self.seconds += 1
        if away_m and min(away_m) <= REACH_M:
            place = self._places.pop(away_m.index(min(away_m)))
        elif self._learns():
            place = _Place(at, at)
        else:
            return
        place.now = at
        place.add(float(ankles[2]), self._limit_m)
        self._places = [*self._places, place][-MOST_PLACES:]
        self._judge()

    def _learns(self) -> bool:
        known = sum(len(place.first) == FIRST for place in self._places)
        return self.seconds <= LEARNT or known < PLACES

    def _judge(self) -> None:
        known = [(p.now, p.drift_m) for p in reversed(self._places) if p.drift_m is not None]
        latest: list[tuple[Floats, float]] = []
        for now, drift_m in known:
            if len(latest) < PLACES and all(math.dist(now, at) >= APART_M for at, _ in latest):
                latest.append((now, drift_m))
        newest = [drift_m for _, drift_m in latest]
        if len(newest) == PLACES and all(abs(drift_m) > self._limit_m for drift_m in newest):
            if self._drift_m is None:  # the text stays as it was, and is logged once
                self._drift_m = float(np.median(newest))
        elif all(abs(drift_m) <= AGREES * self._limit_m for _, drift_m in known):
            self._drift_m = None


def _stands(second: _Second) -> Floats | None:
    """Return (3,) the middle of the ankles if the person stood for this second, or ``None``."""
    ankles = np.array(second.ankles)
    if len(ankles) < LEAST_SAMPLES or ankles.std(axis=0).max() > STILL_M:
        return None
    middle = np.median(ankles, axis=0)
    if abs(middle[0, 2] - middle[1, 2]) > LEVEL_M:
        return None
    place: Floats = middle.mean(axis=0)
    return place if float(np.median(second.hips)) - place[2] >= LEG_M else None
