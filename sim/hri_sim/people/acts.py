"""Acts of a procedural person, each a stance over time: stand, turn, walk, reach."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from hri_predict.base.arrays import Floats
from hri_sim.people.body import MAX_LEAN, Body, Foot, Stance
from hri_sim.people.walking import (
    BEND_M_S2,
    Cruise,
    Footfalls,
    Path,
    lift,
    minimum_jerk,
    step_length,
    wrapped,
)

TURN_RAD_S = 1.6  # mean rate of a turn on the spot
TURN_STEP = math.radians(45)
TURN_LIFT_M = 0.25  # a turning foot is lifted as in a step of this length
REACH_SPEED_M_S = 1.5  # peak speed of a relaxed reach, at any joint of the arm
MAX_REACH_SPEED_M_S = 3.0
_LEVEL = 0.8  # removed share of the up-and-down motion of a stiff-legged walk
_PEAK = 1.875  # peak rate of the minimum-jerk profile


class Act(Protocol):
    """An act with a duration, at whose end the body stands still.

    Attributes:
        duration_s: its duration.
        xy, heading: place of the body at the end.
    """

    duration_s: float
    xy: Floats
    heading: float

    def stance(self, t: float) -> Stance | None:
        """Return the stance after ``t`` seconds; ``None`` while absent."""


class Stand:
    """Stand still."""

    def __init__(self, body: Body, xy: Floats, heading: float, seconds: float) -> None:
        self.duration_s, self.xy, self.heading = seconds, xy, heading
        self._stance = body.standing(xy, heading)

    def stance(self, t: float) -> Stance:
        """Return the same stance at all times."""
        return self._stance


class Absent:
    """Be out of the room."""

    def __init__(self, xy: Floats, heading: float, seconds: float) -> None:
        self.duration_s, self.xy, self.heading = seconds, xy, heading

    def stance(self, t: float) -> None:
        """Nowhere."""
        return


class Turn:
    """Turn on the spot, stepping."""

    def __init__(
        self,
        *,
        body: Body,
        xy: Floats,
        heading: float,
        to_heading: float,
        left_first: bool,
    ) -> None:
        angle = wrapped(to_heading - heading)
        self._body, self._from, self._sign = body, heading, math.copysign(1.0, angle)
        self._angle = max(abs(angle), 1e-6)
        self._falls = Footfalls(self._angle, TURN_STEP, left_first)
        self.duration_s = max(0.6, self._angle / TURN_RAD_S)
        self.xy, self.heading = xy, heading + angle

    def stance(self, t: float) -> Stance:
        """Return the stance ``t`` seconds after the start."""
        turned = self._angle * minimum_jerk(t / self.duration_s)
        feet = []
        for side, (angle, x) in zip((1.0, -1.0), self._falls.at(turned), strict=True):
            heading = self._from + self._sign * angle
            xy = self.xy + side * self._body.half_hips * _left(heading)
            feet.append(Foot(xy, heading, lift(x, TURN_LIFT_M)))
        return Stance(
            xy=self.xy, heading=self._from + self._sign * turned, left=feet[0], right=feet[1]
        )


class Walk:
    """Walk along a path through waypoints, forwards or backwards."""

    def __init__(
        self,
        *,
        body: Body,
        waypoints: Sequence[Floats],
        speed_m_s: float,
        backwards: bool,
        left_first: bool,
    ) -> None:
        self._body, self._path = body, Path(waypoints)
        bend = math.sqrt(BEND_M_S2 / max(self._path.sharpest, 1e-9))
        self._cruise = Cruise(self._path.length_m, min(speed_m_s, bend))
        step_m = step_length(self._cruise.speed_m_s) * (0.7 if backwards else 1.0)
        self._falls = Footfalls(self._path.length_m, step_m, left_first)
        # Walkers bend the knee over the stance foot, so they bob less than with stiff legs.
        half = min(self._falls.step / 2, body.leg)
        self._crouch_m = _LEVEL * (body.leg - math.sqrt(body.leg**2 - half**2))
        self._turned = math.pi if backwards else 0.0
        self.duration_s = self._cruise.duration_s
        self.first_heading = self._path.at(0.0)[1] + self._turned
        self.xy, heading = self._path.at(self._path.length_m)
        self.heading = heading + self._turned

    def stance(self, t: float) -> Stance:
        """Return the stance ``t`` seconds after the start."""
        s = self._cruise.at(t)
        xy, heading = self._path.at(s)
        feet = []
        for side, (along, x) in zip((1.0, -1.0), self._falls.at(s), strict=True):
            point, direction = self._path.at(along)
            direction += self._turned
            ankle = point + side * self._body.half_hips * _left(direction)
            feet.append(Foot(ankle, direction, lift(x, self._falls.step)))
        crouch = self._crouch_m * self._cruise.pace(t)
        return Stance(
            xy=xy, heading=heading + self._turned, left=feet[0], right=feet[1], crouch=crouch
        )


class Reach:
    """Reach to a point with the fingertips of one hand, stay, and return.

    Raises:
        ValueError: the point is out of reach, or the duration asks for an inhuman speed.
    """

    def __init__(
        self,
        *,
        body: Body,
        xy: Floats,
        heading: float,
        target: Floats,
        hand: str,
        hold_s: float,
        duration_s: float | None,
    ) -> None:
        self.xy, self.heading = xy, heading
        self._standing = replace(body.standing(xy, heading), hand=hand, target=target)
        self._lean = _lean_to(body, self._standing)
        travel_m = self._longest_way(body)
        least_s = _PEAK * travel_m / MAX_REACH_SPEED_M_S
        if duration_s is not None and duration_s < least_s:
            raise ValueError(
                f"duration_s {duration_s:g} would need a hand faster than "
                f"{MAX_REACH_SPEED_M_S:g} m/s; give {math.ceil(least_s * 10) / 10:g} or more"
            )
        self._out_s = duration_s or max(0.5, _PEAK * travel_m / REACH_SPEED_M_S)
        self._hold_s = hold_s
        self.duration_s = 2 * self._out_s + hold_s

    def stance(self, t: float) -> Stance:
        """Return the stance ``t`` seconds after the start."""
        back = t - self._out_s - self._hold_s
        reach = minimum_jerk(t / self._out_s) - minimum_jerk(back / self._out_s)
        return self._at(reach)

    def _at(self, reach: float) -> Stance:
        return replace(self._standing, reach=reach, lean=reach * self._lean)

    def _longest_way(self, body: Body) -> float:
        """Return the maximum travel of any joint, metres per unit of ``reach``."""
        joints = np.array([body.joints(self._at(float(r))) for r in np.linspace(0, 1, 41)])
        return float(np.linalg.norm(np.diff(joints, axis=0), axis=-1).max()) * 40


def _lean_to(body: Body, standing: Stance) -> float:
    """Return the minimum lean (radians) that brings the target within the arm's reach."""
    near, far = body.reach_limits()
    target = standing.target
    assert target is not None
    shoulder_joint = 5 if standing.hand == "left" else 9
    distance = math.inf
    for lean in np.linspace(0.0, MAX_LEAN, 36):
        shoulder = body.joints(replace(standing, lean=float(lean)))[shoulder_joint]
        distance = float(np.linalg.norm(target - shoulder))
        if (target - shoulder)[2] > 0.85 * distance:
            raise ValueError("the target is overhead; give one in front")
        if distance < near:
            raise ValueError(
                f"the target is {distance:.2f} m from the shoulder, too close; stand "
                f"{near - distance:.2f} m farther away"
            )
        if distance <= far:
            return float(lean)
    raise ValueError(
        f"the target is {distance:.2f} m from the shoulder, and the arm reaches {far:.2f} m; "
        f"walk {distance - far:.2f} m nearer first"
    )


def _left(heading: float) -> Floats:
    return np.array([-math.sin(heading), math.cos(heading)])
