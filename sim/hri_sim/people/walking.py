"""Walking of a body: paths through waypoints, footfalls, turns, and smooth time profiles.

Step length and cadence keep a constant ratio over walking speeds (the walk ratio: Sekiya &
Nagasaki, *Gait & Posture* 7, 1998); every stance foot stays in place, and the pelvis is
half a step ahead of the rear foot when the other lands. Point-to-point movements follow the
minimum-jerk profile of Flash & Hogan, *J. Neurosci.* 5(7), 1985, equation 5.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats

WALK_RATIO = 0.0065  # metres per (step per minute)
MAX_STEP_M = 0.7
RAMP_S = 1.0  # to reach or leave walking speed
LIFT_PER_STEP = 0.12  # lift of a foot, as a share of the step's length
BEND_M_S2 = 1.3  # sideways acceleration at which a walker slows down for a bend
_TABLE_M = 0.005


def minimum_jerk(x: float) -> float:
    """Return 0 to 1 for x from 0 to 1, at rest at both ends, with a peak rate of 1.875."""
    x = min(max(x, 0.0), 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


def wrapped(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    return -((math.pi - angle) % (2 * math.pi) - math.pi)


def step_length(speed_m_s: float) -> float:
    """Return the step length at a walking speed, in metres."""
    return min(math.sqrt(speed_m_s * 60 * WALK_RATIO), MAX_STEP_M)


class Path:
    """A curve through waypoints (N, 2): a natural cubic spline, so its curvature has no step.

    Attributes:
        length_m: length along the curve.
        sharpest: maximum curvature, 1/m.
    """

    def __init__(self, waypoints: Sequence[Floats]) -> None:
        points = np.asarray(waypoints, dtype=np.float64)
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        self._knots = np.concatenate(([0.0], np.cumsum(chords)))
        self._points, self._bends = points, _natural_spline(self._knots, points)
        self._u = np.linspace(0.0, self._knots[-1], 2 + int(self._knots[-1] / _TABLE_M))
        fine = self._all_at(self._u)
        steps = np.linalg.norm(np.diff(fine, axis=0), axis=1)
        self._s = np.concatenate(([0.0], np.cumsum(steps)))
        self.length_m = float(self._s[-1])
        along = np.interp(np.linspace(0.0, self.length_m, 200), self._s, self._u)
        dx, dy = self._all_at(along, derivative=True).T
        ways = np.unwrap(np.arctan2(dy, dx))
        self.sharpest = float(np.abs(np.diff(ways)).max()) * 199 / self.length_m

    def at(self, s: float) -> tuple[Floats, float]:
        """Return position (2,) and direction of travel (radians) at ``s`` metres along the path."""
        u = float(np.interp(s, self._s, self._u))
        dx, dy = self._at(u, derivative=True)
        return self._at(u), math.atan2(dy, dx)

    def _at(self, u: float, derivative: bool = False) -> Floats:
        i = min(int(np.searchsorted(self._knots, u, side="right")) - 1, len(self._knots) - 2)
        h = self._knots[i + 1] - self._knots[i]
        p, q = self._points[i : i + 2], self._bends[i : i + 2]
        return _cubic((u - self._knots[i]) / h, h, p, q, derivative=derivative)

    def _all_at(self, u: Floats, derivative: bool = False) -> Floats:
        """Return (N, 2) as ``_at``, for (N,) parameters; the path's table has 1000 entries."""
        i = np.minimum(np.searchsorted(self._knots, u, side="right") - 1, len(self._knots) - 2)
        h = (self._knots[i + 1] - self._knots[i])[:, None]
        p, q = self._points[[i, i + 1]], self._bends[[i, i + 1]]
        return _cubic((u - self._knots[i])[:, None] / h, h, p, q, derivative=derivative)


def _cubic(b: Any, h: Any, p: Floats, q: Floats, *, derivative: bool) -> Floats:
    """Return the position or derivative at fraction ``b`` of a span ``h`` between two knots.

    ``p``, ``q``: positions and second derivatives at the two knots.
    """
    a = 1.0 - b
    if derivative:
        result = (p[1] - p[0]) / h + ((1 - 3 * a * a) * q[0] + (3 * b * b - 1) * q[1]) * h / 6
    else:
        result = a * p[0] + b * p[1] + ((a**3 - a) * q[0] + (b**3 - b) * q[1]) * h * h / 6
    return np.asarray(result)


def _natural_spline(knots: Floats, points: Floats) -> Floats:
    """Return second derivatives (N, 2) at the knots, zero at both ends."""
    n, h = len(knots), np.diff(knots)
    system, right = np.eye(n), np.zeros_like(points)
    for i in range(1, n - 1):
        system[i, i - 1 : i + 2] = h[i - 1], 2 * (h[i - 1] + h[i]), h[i]
        slopes = (points[i + 1] - points[i]) / h[i] - (points[i] - points[i - 1]) / h[i - 1]
        right[i] = 6 * slopes
    return np.asarray(np.linalg.solve(system, right))


class Cruise:
    """Distance along a path over time: speed up, cruise, slow down; no step in acceleration."""

    def __init__(self, length_m: float, speed_m_s: float) -> None:
        self.speed_m_s = min(speed_m_s, length_m / RAMP_S)
        self._length_m = length_m
        self.duration_s = length_m / self.speed_m_s + RAMP_S

    def at(self, t: float) -> float:
        """Return the distance walked after ``t`` seconds, in metres."""
        if t > self.duration_s / 2:
            return self._length_m - self._rising(self.duration_s - t)
        return self._rising(t)

    def pace(self, t: float) -> float:
        """Return the speed after ``t`` seconds, as a fraction of the cruising speed."""
        return minimum_jerk(t / RAMP_S) * minimum_jerk((self.duration_s - t) / RAMP_S)

    def _rising(self, t: float) -> float:
        x = min(max(t / RAMP_S, 0.0), 1.0)
        ramp = RAMP_S * (x**6 - 3 * x**5 + 2.5 * x**4)  # integral of the minimum-jerk rise
        return self.speed_m_s * (ramp + max(t - RAMP_S, 0.0))


class Footfalls:
    """Positions of both feet while the body advances from 0 to ``length``, in metres or radians.

    The feet start and end together and swing in turn; the first and last swing is half a stride. A
    swing lasts while the body advances by one step, and moves the foot twice as far.
    """

    def __init__(self, length: float, longest_step: float, left_first: bool) -> None:
        self.steps = max(1, math.ceil(length / longest_step - 1e-9))
        self.step = length / self.steps
        self._length = length
        self._left_first = left_first

    def at(self, s: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return position and swing phase (0 to 1) of the left and the right foot."""
        k = min(max(math.floor(s / self.step + 0.5), 0), self.steps)  # the current swing
        begin, end = max((k - 0.5) * self.step, 0.0), min((k + 0.5) * self.step, self._length)
        x = min(max((s - begin) / (end - begin), 0.0), 1.0)
        before, after = max((k - 1) * self.step, 0.0), min((k + 1) * self.step, self._length)
        swinging = (before + (after - before) * (1 - math.cos(math.pi * x)) / 2, x)
        standing = (k * self.step, 0.0)
        left_swings = (k % 2 == 0) == self._left_first
        return (swinging, standing) if left_swings else (standing, swinging)


def lift(x: float, step_m: float) -> float:
    """Return the height (m) of a foot at phase ``x`` (0 to 1) of its swing."""
    return LIFT_PER_STEP * step_m * math.sin(math.pi * x) ** 2
