"""Forecasts and zones of a shift compared with the actual motion, one sample per second."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import CANONICAL
from hri_predict.explaining.bodies import Offset, SeenPerson, people_of, place_at
from hri_predict.explaining.hindsight import HORIZONS_S, forecast_of
from hri_predict.explaining.shift.spread import Spread
from hri_predict.explaining.times import NS
from hri_predict.explaining.values import listed, number, whole
from hri_predict.recording import RecordingInfo, Told

_EVERY_NS = NS
_KEPT_SCENES = 64
_ROUNDED_M = 0.002
"""Tolerance: zones and joints are each rounded to 1 mm, so the two roundings together may put a
joint at the edge outside.
"""
_NEAR_S = 0.021
_SEGMENTS = {segment.name: segment for segment in CANONICAL.segments}


@dataclass(slots=True)
class _Check:
    """A comparison to make when the source's clock has passed ``due_ns``."""

    ahead_s: float
    person: int
    predicted: Floats | None = None
    zone: tuple[list[str], Floats] | None = None
    due_ns: int = 0


class Foresight:
    """Attributes: ``errors``: metres of joints by horizon; ``inside``: joints in their zones, and
    all compared joints, by horizon.
    """

    def __init__(self) -> None:
        self.errors = {horizon: Spread(0.005) for horizon in HORIZONS_S}
        self.inside = {horizon: [0, 0] for horizon in HORIZONS_S}
        self._scenes: deque[tuple[Told, RecordingInfo]] = deque(maxlen=_KEPT_SCENES)
        self._checks: deque[_Check] = deque(maxlen=1000)
        self._offset = Offset()
        self._forecast_ns = self._zones_ns = 0

    def scene(self, told: Told, info: RecordingInfo) -> None:
        """Process the next scene, and make the comparisons that are due."""
        stamp_ns = whole(told.data.get("capture_ns"))
        if stamp_ns is None:
            return
        self._scenes.append((told, info))
        due = [check for check in self._checks if check.due_ns <= stamp_ns]
        if due:
            self._checks = deque((c for c in self._checks if c.due_ns > stamp_ns), maxlen=1000)
            tracks = self._tracks()
            for check in due:
                self._compare(check, tracks.get(check.person, []))

    def forecast(self, told: Told, info: RecordingInfo) -> None:
        """Add a forecast; one per second is compared."""
        if told.utc_ns - self._forecast_ns < _EVERY_NS or not self._scenes:
            return
        self._forecast_ns = told.utc_ns
        newest = people_of(*_last(self._scenes))
        self._offset.learn(told, {seen.person: seen.stamp_ns for seen in newest})
        offset_ns = self._offset.ns
        if offset_ns is None or info.forecast_rate_hz <= 0:
            return
        for person in listed(told.data.get("ids")):
            made = forecast_of(told, person)
            if made is None:
                continue
            capture_ns, steps, positions = made
            for k, step in enumerate(steps):
                ahead_s = (step + 1) / info.forecast_rate_hz
                check = _Check(ahead_s, person, predicted=positions[k])
                self._later(capture_ns - offset_ns, check)

    def zones(self, told: Told) -> None:
        """Add zones; one sample per second is compared."""
        offset_ns, now_ns = self._offset.ns, whole(told.data.get("now_ns"))
        if told.utc_ns - self._zones_ns < _EVERY_NS or offset_ns is None or now_ns is None:
            return
        self._zones_ns = told.utc_ns
        names = [str(name) for name in listed(told.data.get("segments"))]
        for k, person in enumerate(listed(told.data.get("ids"))):
            if whole(person) is None:
                continue
            for step, time_s in enumerate(listed(told.data.get("times_s"))):
                ahead_s, capsules = number(time_s), _capsules(told, k, step)
                if ahead_s is not None and capsules is not None and len(capsules) == len(names):
                    zone = names, capsules
                    self._later(now_ns - offset_ns, _Check(ahead_s, person, zone=zone))

    def _later(self, begin_ns: int, check: _Check) -> None:
        """Schedule a comparison, if it is at one of the horizons."""
        horizon = next((h for h in HORIZONS_S if abs(h - check.ahead_s) <= _NEAR_S), None)
        if horizon is not None:
            check.due_ns = begin_ns + round(check.ahead_s * NS)
            check.ahead_s = horizon
            self._checks.append(check)

    def _tracks(self) -> dict[int, list[SeenPerson]]:
        tracks: dict[int, list[SeenPerson]] = {}
        for told, info in self._scenes:
            for seen in people_of(told, info.joint_map):
                track = tracks.setdefault(seen.person, [])
                if not track or seen.stamp_ns > track[-1].stamp_ns:
                    track.append(seen)
        return tracks

    def _compare(self, check: _Check, track: list[SeenPerson]) -> None:
        there = place_at(track, check.due_ns)
        if there is None:
            return
        positions, observed = there
        if check.predicted is not None:
            error = np.linalg.norm(check.predicted - positions, axis=-1)[observed]
            for value in error[np.isfinite(error)].tolist():
                self.errors[check.ahead_s].add(value)
        if check.zone is not None:
            count = self.inside[check.ahead_s]
            for name, capsule in zip(*check.zone, strict=True):
                segment = _SEGMENTS.get(name)
                if segment is None or not np.isfinite(capsule).all():
                    continue
                ends = [j for j in (segment.joint_a, segment.joint_b) if observed[j]]
                count[0] += sum(_holds(capsule, positions[j], segment.radius) for j in ends)
                count[1] += len(ends)


def _holds(capsule: Floats, joint: Floats, radius_m: float) -> bool:
    """Whether a zone contains a joint with the surrounding body."""
    a, axis = capsule[:3], capsule[3:6] - capsule[:3]
    square = float(axis @ axis)
    share = min(1.0, max(0.0, float((joint - a) @ axis) / square)) if square > 0 else 0.0
    away = float(np.linalg.norm(joint - a - share * axis))
    return away + radius_m <= float(capsule[6]) + _ROUNDED_M


def _last(scenes: "deque[tuple[Told, RecordingInfo]]") -> tuple[Told, Any]:
    told, info = scenes[-1]
    return told, info.joint_map


def _capsules(told: Told, person: int, step: int) -> Floats | None:
    try:
        found = np.array(told.data["capsules"][person][step], dtype=np.float64)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        return None
    return found if found.ndim == 2 and found.shape[1] == 7 else None
