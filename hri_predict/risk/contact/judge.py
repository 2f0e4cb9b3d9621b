"""Maximum speed of a robot near people that it may touch: mode ``hybrid``.

A speed is permitted if the stopping robot can reach no body part for which contact at this speed is
not allowed. For each part, one of two conditions must hold: its zone stays away from the stopping
robot, as in mode ``predictive``; or the speed does not exceed the part's contact limit
(``limits``), reduced by the part's own speed unless ``own_speed`` is ``left_out``. A part that may
be clamped must also meet the quasi-static limits (``clamping``). No contact is allowed with head,
face and neck, or with a person who is lost or whose speed is unknown. A speed is permitted only if
every slower speed is permitted.

To bound the computing time, no contact is permitted with more than ``MAX_BESIDE`` people within
reach.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.geometry import Capsules, axis_distance, capsule_distance, norm
from hri_predict.risk.contact.clamping import Clamping
from hri_predict.risk.contact.limits import FOLLOWS, SegmentLimits
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.terms import (
    SPEED_LEVELS,
    Finding,
    closing_s,
    directed_limit,
    speed_levels,
    travel_m,
)
from hri_predict.robots.motion import RobotMotion
from hri_predict.zones.body_zones import BodyZones

MAX_BESIDE = 3
RUNGS = 5 * SPEED_LEVELS
"""Number of speeds tried for any direction, including those tried for the present direction."""
_FREE_M = 1e3
"""Slack if no person within reach is in danger."""


@dataclass(frozen=True, slots=True, eq=False)
class _Reachable:
    """Possible contacts of the N people within reach, at each of V speeds; S segments, C links.

    Attributes:
        who: (N,) their indices.
        near_m: (V, N, S, C) smallest distance between segment and link until the robot stops. The
            first speed is 0: a creeping robot that stops where it is.
        bears: (V, N, S) whether contact with the segment is allowed at this speed.
    """

    who: Ints
    near_m: Floats
    bears: Bools

    def least_m(self, speed: int) -> float:
        """Smallest distance of a segment that may not be touched at this speed."""
        return self._least_m(speed, self.near_m[speed])

    def creeping_m(self, speed: int) -> float:
        """The same for a robot that hardly moves."""
        return self._least_m(speed, self.near_m[0])

    def _least_m(self, speed: int, near_m: Floats) -> float:
        counted = np.where(self.bears[speed][..., None], np.inf, near_m)
        return float(counted.min(initial=np.inf))


class ContactJudge:
    """Determines the speeds at which one robot may touch people.

    Args:
        robot: the robot.
        limits: maximum contact speed for each of the S segments of the zones.
        clamping: objects against which it may clamp a person.
    """

    def __init__(
        self,
        robot: RobotConstants,
        limits: SegmentLimits,
        clamping: Clamping,
    ) -> None:
        self._robot = robot
        self._free = limits.transient_m_s / FOLLOWS
        self._clamped = limits.clamped_m_s / FOLLOWS
        self._clamping = clamping
        slow = robot.risk.contact.slow_margin_m
        self._margins_m = slow, slow + robot.risk.band_m

    def revise(self, robot: RobotConstants) -> None:
        """Replace the stopping curve."""
        self._robot = robot

    def __call__(
        self,
        motion: RobotMotion,
        bodies: BodyZones,
        people: Finding,
        others: Sequence[Capsules | None] = (),
    ) -> Finding | None:
        """Return the speed limits with permitted contact.

        Args:
            motion: the robot's motion.
            bodies: all people.
            people: finding from the zones, which provides the distances of the result.
            others: space that each other robot may occupy until this robot stops; ``None``:
                anywhere.

        Returns:
            A finding; its slack shows whether the present speed is permitted, its limits show the
            permitted speeds. ``None``: too many people are within reach.
        """
        curve = self._robot.curve
        rungs = curve.max_speed_m_s * np.arange(RUNGS + 1) / RUNGS
        speeds = np.append(rungs, motion.speed_m_s)
        # without entry 0, the bodies as captured, and without what is past the robot's stop
        zones = bodies.zones.capsules[:, 1 : len(motion.times_s)]
        travel = self._travel_m(motion, speeds)
        needed = [motion.clearance_m + margin for margin in self._margins_m]
        who = _within(zones, motion.capsules, float(travel.max()) + needed[-1])
        if len(who) > MAX_BESIDE:
            return None
        zones = zones[who]
        near = _near_m(zones, motion.capsules, travel, needed[-1])
        clamps = self._clamping.clamps(
            motion=motion,
            zones=zones,
            touched=near < needed[-1],
            travel=travel,
            others=others,
        )
        bears = self._bears(bodies, who, speeds, clamps)
        found = _Reachable(who, near, bears)
        least = np.array([found.least_m(i) for i in range(len(speeds))])
        limits = [_limit(rungs, least[:-1], m) for m in needed]
        slack = float(least[-1]) - motion.clearance_m
        if motion.is_foreseen:
            limits, slack = self._ahead(
                motion=motion, zones=zones, found=found, limits=limits, slack=slack
            )
        slack = min(slack, _FREE_M)
        person, segment, link = self._deciding(found, rungs, limits[0], people)
        now = bodies.zones.capsules
        pair_m = capsule_distance(
            now[person, 0, segment],
            motion.capsules[link],
        )
        return replace(
            people,
            slack_m=slack,
            near=False,
            breach_s=closing_s(slack, motion.speed_m_s),
            limits=(*limits, *limits),
            person=person,
            segment=segment,
            link=link,
            pair_m=float(pair_m),
        )

    def _travel_m(self, motion: RobotMotion, speeds: Floats) -> Floats:
        """Return (V, K) maximum travel of any point by each step's end; minus infinity when
        stopped.

        The first speed is 0, for a creeping robot; the last is the present speed.
        """
        curve = self._robot.curve
        stopping_s = np.interp(speeds, curve.speed_m_s, curve.time_s)
        stopping_m = np.interp(speeds, curve.speed_m_s, curve.distance_m)
        stopping_s[0] = curve.time_s[1]
        stopping_s[-1] = max(stopping_s[-1], motion.stopping_s)
        stopping_m[-1] = max(stopping_m[-1], motion.stopping_m)
        travel = travel_m(
            motion.times_s[1:],
            reaction_s=motion.until_braking_s,
            speed_m_s=speeds[:, None],
            stopping_s=stopping_s[:, None],
            stopping_m=stopping_m[:, None],
        )
        stands_s = motion.until_braking_s + stopping_s
        return np.where(motion.times_s[:-1] <= stands_s[:, None], travel, -np.inf)

    def _bears(self, bodies: BodyZones, who: Ints, speeds: Floats, clamps: Bools) -> Bools:
        """Return (V, N, S) whether contact with each segment is allowed at each speed."""
        own = np.where(bodies.speeds.unknown[who][:, None], np.inf, bodies.segments_m_s[who])
        if self._robot.risk.contact.own_speed == "left_out":
            own = np.where(np.isfinite(own), 0.0, np.inf)
        free = self._free - own  # (N, S); a segment that bears nothing has a limit of 0
        free = np.where(self._free > 0, free, -np.inf)
        bears = free >= speeds[:, None, None]
        slow = self._clamped >= speeds[:, None]  # (V, S)
        return bears & (slow[:, None] | ~clamps)

    def _ahead(
        self,
        *,
        motion: RobotMotion,
        zones: Capsules,
        found: _Reachable,
        limits: list[float],
        slack: float,
    ) -> tuple[list[float], float]:
        """Return limits and slack for the present direction, if these permit more.

        A part that may be clamped in any direction of motion is treated as clamped. Parts that may
        not be touched at a level must also stay away from a creeping robot, because a receding
        robot may be slower than the lowest level.
        """
        top = self._robot.curve.max_speed_m_s
        levels = speed_levels(top, min(limits)) if min(limits) < top else []
        tried, at = list(levels), [round(RUNGS * level / top) for level in levels]
        if slack < 0 and motion.speed_m_s > 0:
            tried.append(motion.speed_m_s)
            at.append(RUNGS + 1)
        if not tried:
            return limits, slack
        robot, until = motion.stopping_at(np.array(tried))
        enough = motion.clearance_m + self._margins_m[-1]
        least = np.empty(len(tried))
        for i, row in enumerate(at):
            close = (found.near_m[row].min(-1) < enough) & ~found.bears[row]
            people, segments = np.nonzero(close)
            steps = int(until[i])
            course = robot[i, 1 : steps + 1]
            least[i] = _least_m(zones, (people, segments, steps), course, at_most=enough)
        creeping = [found.creeping_m(row) for row in at[: len(levels)]]
        known = np.minimum(least[: len(levels)], creeping)
        limits = [
            directed_limit(levels, known, motion.clearance_m + margin, limit)
            for margin, limit in zip(self._margins_m, limits, strict=True)
        ]
        if len(tried) > len(levels):
            slack = max(slack, float(least[-1]) - motion.clearance_m)
        return limits, slack

    def _deciding(
        self, found: _Reachable, rungs: Floats, limit: float, people: Finding
    ) -> tuple[int, int, int]:
        """Return the person, segment and link that limit the speed."""
        row = min(int(np.searchsorted(rungs, limit, side="right")), len(rungs) - 1)
        near = np.where(found.bears[row][..., None], np.inf, found.near_m[row])
        if not (near.size and near.min() < np.inf):
            return people.person, people.segment, people.link
        n, s, c = np.unravel_index(int(near.argmin()), near.shape)
        return int(found.who[n]), int(s), int(c)


def _limit(rungs: Floats, least: Floats, needed_m: float) -> float:
    """Return the highest level that is clear together with all lower levels; 0 if none is clear."""
    blocked = np.flatnonzero(~(least >= needed_m))
    count = int(blocked[0]) if blocked.size else len(rungs)
    return float(rungs[count - 1]) if count else 0.0


def _spheres(capsules: Capsules) -> tuple[Floats, Floats]:
    """Return centres and radii of the bounding spheres of capsules."""
    return (capsules.a + capsules.b) / 2, norm(capsules.b - capsules.a) / 2 + capsules.radius


@np.errstate(invalid="ignore")
def _within(zones: Capsules, robot: Capsules, far_m: float) -> Ints:
    """Return the indices of people who may be nearer than ``far_m``, including non-finite ones."""
    middle, size = _spheres(zones)
    links, length = _spheres(robot)
    centre = middle.mean(axis=(1, 2))  # (P, 3)
    around = (norm(middle - centre[:, None, None]) + size).max(axis=(1, 2))
    apart = norm(centre[:, None] - links) - length
    some = np.flatnonzero(~(apart.min(1) - around >= far_m))
    between = norm(middle[some, :, :, None] - links) - length - size[some][..., None]
    return some[~(between.min(axis=(1, 2, 3)) >= far_m)]


@np.errstate(invalid="ignore")
def _near_m(zones: Capsules, robot: Capsules, travel: Floats, needed_m: float) -> Floats:
    """Return (V, N, S, C) smallest distances until the robot stops; infinite if surely sufficient.

    Minus infinity if a value is not finite.
    """
    middle, size = _spheres(zones)
    links, length = _spheres(robot)
    distance = norm(middle[..., None, :] - links) - size[..., None] - length  # (N, K, S, C)
    n, k, s, c = np.nonzero(~(distance >= float(travel.max()) + needed_m))
    exact = axis_distance(
        *_axis(zones.a[n, k, s], zones.b[n, k, s]), *_axis(robot.a[c], robot.b[c])
    )
    exact = exact - zones.radius[n, k, s] - robot.radius[c]
    distance = np.full(distance.shape, np.inf)
    distance[n, k, s, c] = np.where(np.isfinite(exact), exact, -np.inf)
    result = np.empty((len(travel), *distance.shape[:1], *distance.shape[2:]))
    for i, way in enumerate(travel):
        result[i] = (distance - way[:, None, None]).min(1)
    return result


def _least_m(
    zones: Capsules, which: tuple[Ints, Ints, int], robot: Capsules, *, at_most: float
) -> float:
    """Return the smallest distance of segments to a robot's course at each step, up to ``at_most``.

    Args:
        zones: (N, K, S).
        which: indices (n,) of people and of segments, and the number of steps to use.
        robot: (steps, C).
        at_most: larger distances need not be known.
    """
    people, segments, steps = which
    if not people.size:
        return at_most
    a = zones.a[people, :steps, segments][:, :, None]
    b = zones.b[people, :steps, segments][:, :, None]
    exact = axis_distance(*_axis(a, b), *_axis(robot.a[None], robot.b[None]))
    exact = exact - zones.radius[people, :steps, segments][..., None] - robot.radius
    return min(float(np.where(np.isfinite(exact), exact, -np.inf).min()), at_most)


def _axis(
    a: Floats, b: Floats
) -> tuple[tuple[Floats, Floats, Floats], tuple[Floats, Floats, Floats]]:
    along = b - a
    return (a[..., 0], a[..., 1], a[..., 2]), (along[..., 0], along[..., 1], along[..., 2])
