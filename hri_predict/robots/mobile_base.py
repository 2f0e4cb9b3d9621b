"""A robot's base that moves over the floor: as three joints before the arm's, and how it stops.

The base's pose (x, y, yaw) in the room's frame is two prismatic joints and a revolute one, so that
positions, swept volumes and their proofs are those of an arm with three more joints.

Base and arm brake at the same moment, each by its own table. A point of the robot moves by what the
base moves it and by what the arm moves it against the base, so its speed and its way are at most
the sums, and it stands when the later of the two stands. How an unknown motion is divided between
them does not show in one speed v; so every division of v counts, and the worst serves. (The speed
of the fastest point *in the room* would not do: an arm that moves backwards as fast as its base
drives has a point that stands, and which moves on as soon as one of the two brakes.)
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
"""Their limits; a reported yaw may count full turns, within reason."""
_AT_ONCE = 1e9
"""1/s: a part that stands at once; its first derivative bounds it then."""


def base_joints(base_from_robot: Floats) -> list[Joint]:
    """The base as joints: x, y, and the turn, behind which the arm's chain hangs."""
    unit = np.eye(3)
    slides = [Joint(np.eye(4), axis, np.eye(4), slides=True) for axis in unit[:2]]
    return [*slides, Joint(np.eye(4), unit[2], base_from_robot)]


@dataclass(frozen=True, slots=True, eq=False)
class PartCourse:
    """Motion of one part, arm or base, as it moves on and stops: (..., K) at or before each time.

    Attributes:
        travel_s: distance along its path, in seconds of its speed now.
        rate: the highest share of that speed since the time before.
        bend: 1/s, bound of the rate's change since then.
        stands_s: (..., 1) when it stands.
    """

    travel_s: Floats
    rate: Floats
    bend: Floats
    stands_s: Floats

    @classmethod
    def of(
        cls, table: StoppingTable, speeds: Floats, times_s: Floats, reaction_s: float
    ) -> "PartCourse":
        """Return the course of a part at ``speeds`` (..., 1), at ``times_s`` (K,), not falling."""
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
        veer_m: (..., K) how far a base that turns as it drives has left its straight line.
    """

    q: Floats
    dq_most: Floats
    ddq_most: Floats
    half: Floats
    veer_m: Floats


class MobileBase:
    """Speed that a base gives a robot's points, and the stopping of both together.

    Args:
        settings: the base's entry in the configuration.
        reach_m: no point of the robot is ever farther than this from the base's axis of turning.

    Attributes:
        settings: as given.
        table: stopping times and distances over the speed at which the base moves the fastest
            point; of the heaviest load.
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
        """Seconds until both stand: either may have all the speed."""
        return np.maximum(arm.times_s(speeds), self.table.times_s(speeds))

    def distances_m(self, arm: StoppingTable, speeds: Floats) -> Floats:
        """Metres of the fastest point until both stand, however the speed is divided.

        Each part holds its share of v for at most h and then brakes uniformly, until T at the
        latest, where h and T are the longest of both. So at no time is a point farther than one
        that holds all of v for h and stops at T, on a way of v (T + h) / 2.
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
            arm: the arm's course.
            q, qd: (N,) now, the base's first.
            factor: (..., 1).
            times_s: (K,) from 0, not falling.
            reaction_s: until both brake.
        """
        base = PartCourse.of(self.table, factor * float(self.speed(qd)), times_s, reaction_s)
        lead = np.arange(len(qd)) < len(COORDINATES)

        def both(of_base: Floats, of_arm: Floats) -> Floats:
            """(..., K, N) each velocity times its part's value (..., K)."""
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
