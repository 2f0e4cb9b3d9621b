"""Check whether a robot may clamp a body part against a fixture or another robot.

Clamping is possible if a link can reach the part, the part can reach the fixture (by itself, or
pushed by the robot until it stops), and the gap between link and fixture may become smaller than
the part's thickness (ISO 13854:2017, Table 1, or the part's capsule if that is thicker).

The motion of other robots is not predicted here: another robot may move in any direction at its
highest speed, so it is treated as a fixture enlarged by that motion. If its pose is unknown, it may
be anywhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.risk.fixtures import Fixture, gaps
from hri_predict.robots.motion import RobotMotion

THICKNESS_M = {
    "head": 0.3, "shoulders": 0.5, "thorax": 0.5, "abdomen": 0.5, "pelvis": 0.5,
    "upper_arm": 0.12, "forearm": 0.12, "hand": 0.1, "thigh": 0.18, "shank": 0.18, "foot": 0.12,
}  # fmt: skip
"""Minimum gaps against crushing (ISO 13854:2017, Table 1: head, body, arm, hand, leg, foot)."""


def thickness_m(segments: Sequence[str], radii_m: Floats) -> Floats:
    """Return the distance (S,) from a fixture beyond which a link cannot clamp each segment."""
    names = [s.removeprefix("l_").removeprefix("r_") for s in segments]
    crushed = np.array([THICKNESS_M.get(name, max(THICKNESS_M.values())) for name in names])
    return np.maximum(crushed, 2 * radii_m)


def anywhere_until(
    motion: RobotMotion, max_speed_m_s: float, until_s: float, uncertainty_m: float
) -> Capsules:
    """Return capsules (C,) that contain a robot for any motion until then. They include Z_r and the
    uncertainty since its last report (``uncertainty_m``)."""
    now = motion.capsules
    return Capsules(now.a, now.b, now.radius + max_speed_m_s * until_s + uncertainty_m)


@dataclass(frozen=True, slots=True, eq=False)
class Clamping:
    """Checks for clamping by one robot.

    Attributes:
        fixtures: F of them.
        thickness_m: (S,) see ``thickness_m``.
    """

    fixtures: Sequence[Fixture]
    thickness_m: Floats

    def clamps(
        self,
        *,
        motion: RobotMotion,
        zones: Capsules,
        touched: Bools,
        travel: Floats,
        others: Sequence[Capsules | None],
    ) -> Bools:
        """Return (V, N, S) whether a link may press a segment against a fixture or another robot.

        Args:
            motion: the robot's motion.
            zones: (N, K, S) people's zones.
            touched: (V, N, S, C) whether each link may reach each segment at each of V speeds.
            travel: (V, K) maximum travel of any point by the end of each step, m.
            others: R, space that each other robot may occupy during this time; ``None``: anywhere.
        """
        result = np.zeros(touched.shape[:3], np.bool_)
        people, segments = np.nonzero(touched.any(axis=(0, 3)))
        if not ((self.fixtures or others) and people.size):
            return result
        some = zones[people, :, segments]
        pushed = np.maximum(travel.max(1), 0.0)  # (V,)
        reaches = motion.clearance_m + pushed[:, None, None]
        beside = self._gaps(some, others).min(1) < reaches  # (V, n, F + R)
        gap = self._gaps(motion.capsules, others)  # (C, F + R)
        gap[~motion.model.moves] = np.inf
        left = gap - pushed[:, None, None]  # (V, C, F + R)
        thick = self.thickness_m[segments] + motion.clearance_m  # (n,)
        narrow = left[:, None] < thick[:, None, None]  # (V, n, C, F + R)
        pressed = narrow & beside[:, :, None] & touched[:, people, segments][..., None]
        result[:, people, segments] = pressed.any(axis=(2, 3))
        return result

    def _gaps(self, capsules: Capsules, others: Sequence[Capsules | None]) -> Floats:
        return np.concatenate([gaps(capsules, self.fixtures), robot_gaps(capsules, others)], -1)


@np.errstate(invalid="ignore")
def robot_gaps(capsules: Capsules, robots: Sequence[Capsules | None]) -> Floats:
    """Return distances (..., R) of capsules (...) from each robot, metres.

    Minus infinity if a value is not finite, or the robot may be anywhere (``None``).
    """
    result = np.full((*capsules.radius.shape, len(robots)), -np.inf)
    each = Capsules(capsules.a[..., None, :], capsules.b[..., None, :], capsules.radius[..., None])
    for i, robot in enumerate(robots):
        if robot is not None:
            result[..., i] = capsule_distance(each, robot).min(-1)
    return np.where(np.isfinite(result), result, -np.inf)
