"""A moving robot base, modelled as three joints before the arm's joints, and its stopping.

The base's pose (x, y, yaw) in the room's frame is modelled as two prismatic joints and one revolute
joint, so positions, swept volumes and proofs are those of an arm with three more joints.

Base and arm brake at the same moment, each according to its own table. The motion of a point is the
sum of the base's motion and the arm's motion relative to the base. So its speed and travel are at
most the sums, and it stops when the later of the two stops. A single speed v does not show how the
motion is divided between base and arm; so all divisions of v are considered, and the worst is used.
(The speed of the fastest point *in the room* would not do: if the arm moves backwards as fast as
its base drives forwards, a point is at rest, but moves as soon as either of them brakes.)
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.settings import MAX_COORDINATE_M
from hri_predict.robots.kinematics import Joint
from hri_predict.robots.settings import MobileBaseSettings
from hri_predict.robots.stopping import StoppingTable

COORDINATES = ("base x", "base y", "base yaw")
"""The three joints: m, m, rad."""
FARTHEST = (MAX_COORDINATE_M, MAX_COORDINATE_M, 1000.0)
"""Limits of these joints; a reported yaw may include a reasonable number of full turns."""
_AT_ONCE = 1e9
"""Bound of the rate's change, 1/s, for an immediate stop; then the first derivative is the bound.
"""


def base_joints(base_from_robot: Floats) -> list[Joint]:
    """Return the base as joints x, y and yaw, to which the arm's chain is attached."""
    unit = np.eye(3)
    slides = [Joint(np.eye(4), axis, np.eye(4), slides=True) for axis in unit[:2]]
    return [*slides, Joint(np.eye(4), unit[2], base_from_robot)]


@dataclass(frozen=True, slots=True, eq=False)
class PartCourse:
    """Motion of one part, arm or base, until it stops: (..., K) at or before each time.

    Attributes:
        travel_s: distance along its path, in seconds at the present speed.
        rate: maximum fraction of that speed since the previous time.
        bend: bound of the rate's change since the previous time, 1/s.
        stands_s: (..., 1) time of the stop.
    """

    travel_s: Floats
    rate: Floats
    bend: Floats
    stands_s: Floats

    @classmethod
    def of(
        cls, table: StoppingTable, speeds: Floats, times_s: Floats, reaction_s: float
    ) -> "PartCourse":
        """Return a part's course at ``speeds`` (..., 1) and non-decreasing ``times_s`` (K,)."""
        stopping_s = table.times_s(speeds)
        hold = table.hold_s(speeds, stopping_s)
        onset, braking = reaction_s + hold, stopping_s - hold
        begins = np.concatenate([times_s[:1], times_s[:-1]])
        slower = np.where(braking > 0, 1.0 / np.where(braking > 0, braking, 1.0), _AT_ONCE)
        return cls(
            travel_s=table.travel_s(speeds, times_s, reaction_s, stopping_s),
            rate=1.0 - np.minimum(np.maximum(begins - onset, 0.0) * slower, 1.0),
            bend=np.where(times_s > onset, slower, 0.0),
            stands_s=reaction_s + stopping_s,
        )


@dataclass(frozen=True, slots=True, eq=False)
class BasedPath:
    """A path in time of base and arm; see ``RobotModel.swept_capsules``.

    Attributes:
        q, dq_most, ddq_most: (..., K, N).
        half: (K,) seconds.
        veer_m: (..., K) deviation from a straight line of a base that turns while driving.
    """

    q: Floats
    dq_most: Floats
    ddq_most: Floats
    half: Floats
    veer_m: Floats


class MobileBase:
    """Speed of a robot's points due to the base, and combined stopping of base and arm.

    Args:
        settings: the base's entry in the configuration.
        reach_m: maximum distance of any robot point from the base's axis of rotation.

    Attributes:
        settings: as given.
        table: stopping times and distances by speed of the fastest point due to the base, with the
            heaviest load.
    """

    def __init__(self, settings: MobileBaseSettings, reach_m: float) -> None:
        self.settings = settings
        self._reach_m = reach_m
        self.table = StoppingTable.of(settings.stopping, [None])

    @property
    def uncertainty_m(self) -> float:
        """Maximum error of any point due to the error of the base's reported pose."""
        return self.settings.uncertainty_m + self.settings.uncertainty_rad * self._reach_m

    def speed(self, qd: Floats) -> Floats:
        """Bound (...,) m/s of the speed that the base's motion gives any point, at any posture.

        ``qd`` (..., N) begins with the base's.
        """
        turn: Floats = np.abs(qd[..., 2]) * self._reach_m
        return np.hypot(qd[..., 0], qd[..., 1]) + turn

    def times_s(self, arm: StoppingTable, speeds: Floats) -> Floats:
        """Return the times until both stop, in seconds, if either has all the speed."""
        return np.maximum(arm.times_s(speeds), self.table.times_s(speeds))

    def distances_m(self, arm: StoppingTable, speeds: Floats) -> Floats:
        """Return the travel of the fastest point until both stop, m, for any division of the speed.

        Each part keeps its share of v for at most h, then brakes uniformly until T at the latest,
        where h and T are the maxima of both. So no point travels farther than one that keeps v for
        h and stops at T, over a distance of v (T + h) / 2.
        """
        times = self.times_s(arm, speeds)
        hold = np.maximum(arm.hold_most_s(speeds), self.table.hold_most_s(speeds))
        most: Floats = np.asarray(speeds) * (times + np.minimum(hold, times)) / 2
        return most

    def stopping_path(
        self,
        arm: PartCourse,
        *,
        q: Floats,
        qd: Floats,
        factor: Floats,
        times_s: Floats,
        reaction_s: float,
    ) -> "BasedPath":
        """Return the motion of a robot at ``factor`` (..., 1) times its velocities until both parts
        stop.

        Args:
            arm: course of the arm.
            q, qd: (N,) present values, the base's first.
            factor: (..., 1).
            times_s: (K,) from 0, non-decreasing.
            reaction_s: time until both brake.
        """
        base = PartCourse.of(self.table, factor * float(self.speed(qd)), times_s, reaction_s)
        lead = np.arange(len(qd)) < len(COORDINATES)

        def both(of_base: Floats, of_arm: Floats) -> Floats:
            """Return (..., K, N) each velocity times its part's value (..., K)."""
            each = np.where(lead, of_base[..., None], of_arm[..., None])
            result: Floats = each * factor[..., None] * qd
            return result

        # Its velocity of amount v turns at most at its yaw rate w, so it is accelerated sideways by
        # at most v w until it stops.
        sideways = np.hypot(qd[0], qd[1]) * abs(qd[2]) * factor**2
        return BasedPath(
            q=q + both(base.travel_s, arm.travel_s),
            dq_most=np.abs(both(base.rate, arm.rate)),
            ddq_most=np.abs(both(base.bend, arm.bend)),
            half=np.diff(times_s, prepend=times_s[0]) / 2,
            veer_m=sideways * np.minimum(times_s, base.stands_s) ** 2 / 2,
        )
