"""Zones: where every body segment of every person may be, interval by interval.

``joint_zones`` says where each joint may be; a segment is within the larger of its two joints'
balls, plus its own radius. A segment never observed is bounded by the skeleton's reach from the
nearest joint that was.

Position uncertainty (Z_d) is not in the zones: ``separation`` counts it, once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.errors import ConfigError
from hri_predict.predictors.base import Forecast
from hri_predict.reasons import Reason
from hri_predict.risk.calibration import Radii
from hri_predict.risk.human_speed import SnapshotVelocities
from hri_predict.risk.joint_zones import FRESH_S, Ints, JointZones
from hri_predict.risk.self_check import Trust
from hri_predict.risk.settings import HumanLimits
from hri_predict.risk.types import Capsules, Zones
from hri_predict.scene import Bools, Floats
from hri_predict.skeleton import Skeleton
from hri_predict.snapshot import PeopleSnapshot


@dataclass(frozen=True, slots=True, eq=False)
class BodyZones:
    """The zones of one tick, and what else the risk stage needs of the same bodies.

    Attributes:
        zones: people in the order of the snapshot, then the lost ones; see ``Zones``. Entry 0 is
            the body as captured (a lost person's has grown until that capture), entry k >= 1 holds
            the body during the whole of ``[times_s[k-1], times_s[k]]`` after ``now_ns``.
        paths: the same, where the forecast puts them, without growth.
        lost: (P,) who is lost.
        age_s: seconds from the oldest capture that the zones rest on to now, 0 where nobody is.
        capture_ns: that capture; the newest good one where nobody is here.
        reasons: why the zones are no better than they are.
        claimed: see ``JointBalls``.
    """

    zones: Zones
    paths: Capsules
    lost: Bools
    age_s: float
    capture_ns: int | None
    reasons: tuple[Reason, ...] = ()
    claimed: Floats | None = None


class ZoneBuilder:
    """Builds zones from a snapshot and its forecast, everything in one batch.

    Args:
        skeleton: the joints' order and the segments.
        absent_parts: parts of the body that are not there (a seated person's legs).
        limits: see ``HumanLimits``.
        rate_hz: steps per second of the forecast, and of the zones.
        horizon_steps: H of the forecast.
        steps: how many steps of zones to build after now; defaults to ``horizon_steps``.
        radii: calibrated ones; ``None``: the predictor is not calibrated.
        velocities: shared with whoever else measures them.

    Attributes:
        joints: see ``JointZones``.

    Raises:
        ConfigError: an absent part is unknown, or nothing is left.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        absent_parts: Sequence[str],
        limits: HumanLimits,
        rate_hz: float,
        horizon_steps: int,
        steps: int | None = None,
        radii: Radii | None = None,
        velocities: SnapshotVelocities | None = None,
    ) -> None:
        self.limits = limits
        self.horizon_steps = horizon_steps
        kept = skeleton.without(absent_parts)
        if not kept:
            raise ConfigError(
                "people.absent_parts leaves no segment of the body; declare fewer parts absent"
            )
        segments = [skeleton.segments[i] for i in kept]
        self.segment_index: Ints = np.array(kept, dtype=np.intp)
        self.segment_names = tuple(s.name for s in segments)
        self._a: Ints = np.array([s.joint_a for s in segments], dtype=np.intp)
        self._b: Ints = np.array([s.joint_b for s in segments], dtype=np.intp)
        self._radius: Floats = np.array([s.radius for s in segments])
        # (S, J): a sphere of this size about joint k holds the whole of segment s
        self._reach: Floats = np.maximum(skeleton.reach[self._a], skeleton.reach[self._b])
        self.times_s: Floats = np.arange(1 + (steps or horizon_steps)) / rate_hz
        self.joints = JointZones(
            skeleton, limits, rate_hz, horizon_steps, self.times_s, radii, velocities
        )

    def build(
        self,
        snapshot: PeopleSnapshot,
        forecast: Forecast | None,
        with_paths: bool = True,
        trust: Trust | None = None,
    ) -> BodyZones:
        """Zones of everybody in ``snapshot``.

        Args:
            snapshot: people at this tick.
            forecast: of the same people in the same order, or ``None``: physical limits alone.
            with_paths: whether ``paths`` are wanted; else they are the zones.
            trust: what the live self-check says of them; needed for calibrated radii.
        """
        capture_ns = _oldest_capture(snapshot)
        joints = self.joints.build(snapshot, forecast, capture_ns, trust)
        zones = self._segments(joints.mid, joints.radius, joints.joint_age)
        paths = zones
        if with_paths:
            paths = self._segments(joints.path, joints.inflation, joints.joint_age)
        ids = snapshot.ids + tuple(person.id for person in snapshot.lost)
        return BodyZones(
            zones=Zones(ids, self.segment_names, self.times_s, zones),
            paths=paths,
            lost=np.arange(len(ids)) >= len(snapshot.ids),
            age_s=0.0 if capture_ns is None else max(0.0, (snapshot.now_ns - capture_ns) * 1e-9),
            capture_ns=capture_ns,
            claimed=joints.claimed,
        )

    def _segments(self, mid: Floats, around: Floats, joint_age: Floats) -> Capsules:
        """Joints' centres and radii to capsules (P, K+1, S)."""
        a, b = mid.take(self._a, axis=2), mid.take(self._b, axis=2)
        radius = np.maximum(around.take(self._a, axis=2), around.take(self._b, axis=2))
        if (joint_age > FRESH_S).any():
            unseen = joint_age * self.limits.physical_speed_m_s  # (P, J)
            spheres = self._reach + unseen[:, None, :]  # (P, S, J)
            nearest = spheres.argmin(-1)  # (P, S)
            ends = np.maximum(unseen[:, self._a], unseen[:, self._b])
            bounded = (spheres.min(-1) < ends)[:, None, :]
            person = np.arange(len(mid))[:, None]
            centre = mid.transpose(0, 2, 1, 3)[person, nearest].transpose(0, 2, 1, 3)
            about = around.transpose(0, 2, 1)[person, nearest].transpose(0, 2, 1)
            reach = self._reach[np.arange(len(self._radius)), nearest][:, None, :]
            a = np.where(bounded[..., None], centre, a)
            b = np.where(bounded[..., None], centre, b)
            radius = np.where(bounded, about + reach, radius)
        return Capsules(a, b, radius + self._radius)


def _oldest_capture(snapshot: PeopleSnapshot) -> int | None:
    if len(snapshot.ids):
        return int(snapshot.capture_ns.min())
    return snapshot.newest_capture_ns
