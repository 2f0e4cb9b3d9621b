"""Zones: where every body segment of every person may be, interval by interval.

The growth rule
===============
Time ``t`` runs from each person's capture. A joint that was seen in that capture is at most

    min(v t, a t^2 / 2 + e_v t)

from where the forecast puts it: ``v`` and ``a`` are what the human body can do (``HumanLimits``
names the sources), ``e_v`` bounds the error of the forecast's velocity at capture. This takes the
*deviation from the forecast* to be limited as human motion itself is; somebody who at once reverses
what was forecast can leave such a zone, which is what calibration measures. Where the forecast has
a standard deviation, zones can be asked to hold a number of them as well.

Without a forecast, and for a joint that was not seen in the capture, nothing is assumed: the joint
is at most ``v (t + joint_age)`` from where it was last seen, with ``v`` the physical speed. A lost
person walks from where they were last seen, arms at arm speed. Past the forecast's last step the
zone grows at the physical speed.

Position uncertainty (Z_d) is not in the zones: ``separation`` counts it, once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.errors import ConfigError
from hri_predict.predictors.base import Forecast
from hri_predict.reasons import Reason
from hri_predict.risk.settings import HumanLimits
from hri_predict.risk.types import Capsules, Zones
from hri_predict.scene import Bools, Floats
from hri_predict.skeleton import Skeleton
from hri_predict.snapshot import PeopleSnapshot

Ints = NDArray[np.intp]

_NEVER_S = 1e3
"""Age given to a joint that was never seen: at any human speed it may be anywhere."""
_FAR_M = 1e4
"""A coordinate beyond this is no position in a room."""
_FRESH_S = 1e-6


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
    """

    zones: Zones
    paths: Capsules
    lost: Bools
    age_s: float
    capture_ns: int | None
    reasons: tuple[Reason, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Tracks:
    """Joints of P people at their captures, lost people last, and how to move on from there."""

    last: Floats  # (P, J, 3) where last seen
    joint_age: Floats  # (P, J) seconds before the capture
    speed: Floats  # (P, J) of a joint that is not forecast
    forecast: Bools  # (P, J) whether the joint follows the forecast
    age: Floats  # (P,) seconds from capture to now
    waited: Floats  # (P,) seconds from capture to the instant of entry 0


class ZoneBuilder:
    """Builds zones from a snapshot and its forecast, everything in one batch.

    Args:
        skeleton: the joints' order and the segments.
        absent_parts: parts of the body that are not there (a seated person's legs).
        limits: see ``HumanLimits``.
        rate_hz: steps per second of the forecast, and of the zones.
        horizon_steps: H of the forecast.
        steps: how many steps of zones to build after now; defaults to ``horizon_steps``.

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
    ) -> None:
        self.limits = limits
        self.rate_hz = rate_hz
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
        arm = np.zeros(len(skeleton.joints), dtype=bool)
        for part in ("left_arm", "right_arm"):
            arm[list(skeleton.parts.get(part, ()))] = True
        self._speed: Floats = np.where(arm, limits.arm_speed_m_s, limits.body_speed_m_s)
        self._acceleration: Floats = np.where(
            arm, limits.arm_acceleration_m_s2, limits.body_acceleration_m_s2
        )
        self.times_s: Floats = np.arange(1 + (steps or horizon_steps)) / rate_hz

    def build(
        self, snapshot: PeopleSnapshot, forecast: Forecast | None, with_paths: bool = True
    ) -> BodyZones:
        """Zones of everybody in ``snapshot``.

        Args:
            snapshot: people at this tick.
            forecast: of the same people in the same order, or ``None``: physical limits alone.
            with_paths: whether ``paths`` are wanted; else they are the zones.
        """
        capture_ns = _oldest_capture(snapshot)
        tracks = self._tracks(snapshot, forecast, capture_ns)
        mid, inflation, growth = self._motion(tracks, forecast)
        zones = self._segments(mid, inflation + growth, tracks)
        paths = zones
        if with_paths and tracks.forecast.any():
            along = np.where(tracks.forecast[:, None], 0.0, growth)
            paths = self._segments(mid, inflation + along, tracks)
        ids = snapshot.ids + tuple(person.id for person in snapshot.lost)
        return BodyZones(
            zones=Zones(ids, self.segment_names, self.times_s, zones),
            paths=paths,
            lost=np.arange(len(ids)) >= len(snapshot.ids),
            age_s=0.0 if capture_ns is None else max(0.0, (snapshot.now_ns - capture_ns) * 1e-9),
            capture_ns=capture_ns,
        )

    def _tracks(
        self, snapshot: PeopleSnapshot, forecast: Forecast | None, capture_ns: int | None
    ) -> _Tracks:
        people, joints = len(snapshot.ids), len(self._speed)
        lost = len(snapshot.lost)
        last = np.concatenate(
            [
                snapshot.last_positions.reshape(people, joints, 3),
                np.array([p.positions for p in snapshot.lost]).reshape(lost, joints, 3),
            ]
        )
        joint_age = np.concatenate(
            [snapshot.joint_age_s.reshape(people, joints), np.zeros((lost, joints))]
        )
        seen = (np.abs(last) < _FAR_M).all(-1) & (joint_age >= 0)  # false for NaN too
        last = np.where(seen[..., None], last, 0.0)
        joint_age = np.where(seen, np.minimum(joint_age, _NEVER_S), _NEVER_S)
        is_lost = np.arange(people + lost)[:, None] >= people
        fresh = (joint_age < _FRESH_S) & ~is_lost
        captures = np.array(
            [*snapshot.capture_ns, *(p.last_seen_ns for p in snapshot.lost)], dtype=np.int64
        )
        reference = snapshot.now_ns if capture_ns is None else capture_ns
        return _Tracks(
            last=last,
            joint_age=joint_age,
            speed=np.where(is_lost, self._speed, self.limits.physical_speed_m_s),
            forecast=fresh if forecast is not None else np.zeros_like(fresh),
            age=np.maximum(0.0, (snapshot.now_ns - captures) * 1e-9),
            waited=np.where(is_lost[:, 0], np.maximum(0.0, (reference - captures) * 1e-9), 0.0),
        )

    def _motion(self, tracks: _Tracks, forecast: Forecast | None) -> tuple[Floats, Floats, Floats]:
        """Centre (P, K+1, J, 3), inflation that encloses its motion, and growth (P, K+1, J)."""
        since = tracks.age[:, None] + self.times_s  # (P, K+1) seconds since capture
        until = since.copy()
        since[:, 0] = until[:, 0] = tracks.waited
        growth = tracks.speed[:, None] * (until[..., None] + tracks.joint_age[:, None])
        shape = (*since.shape, tracks.last.shape[1])
        if forecast is None or not tracks.forecast.any():
            mid = np.broadcast_to(tracks.last[:, None], (*shape, 3))
            return mid, np.zeros(shape), growth
        people = len(forecast.positions)
        knots = np.repeat(tracks.last[:, None], self.horizon_steps + 1, axis=1)
        follows = tracks.forecast[:people, None, :, None]
        knots[:people, 1:] = np.where(follows, forecast.positions, knots[:people, 1:])
        mid, inflation = _enclosed(knots, since * self.rate_hz)
        rule = self._deviation(until)
        if forecast.std is not None and self.limits.std_factor > 0:
            std = _std_during(forecast.std, since * self.rate_hz, self.horizon_steps)
            rule[:people] = np.maximum(rule[:people], self.limits.std_factor * std)
        rule[:, 0] = 0.0
        return mid, inflation, np.where(tracks.forecast[:, None], rule, growth)

    def _deviation(self, t: Floats) -> Floats:
        """(P, K+1) seconds since capture to (P, K+1, J) metres from the forecast."""
        end = self.horizon_steps / self.rate_hz
        inside = np.minimum(t, end)[..., None]
        limits = self.limits
        free = (0.5 * self._acceleration * inside + limits.velocity_error_m_s) * inside
        beyond = limits.physical_speed_m_s * np.maximum(t - end, 0.0)[..., None]
        return np.minimum(self._speed * inside, free) + beyond

    def _segments(self, mid: Floats, around: Floats, tracks: _Tracks) -> Capsules:
        """Joints' centres and radii to capsules (P, K+1, S)."""
        a, b = mid.take(self._a, axis=2), mid.take(self._b, axis=2)
        radius = np.maximum(around.take(self._a, axis=2), around.take(self._b, axis=2))
        if (tracks.joint_age > _FRESH_S).any():
            unseen = tracks.joint_age * self.limits.physical_speed_m_s  # (P, J)
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


def _enclosed(knots: Floats, steps: Floats) -> tuple[Floats, Floats]:
    """Spheres around a piecewise linear path.

    Args:
        knots: (P, N, J, 3) the path at steps 0..N-1; it rests at the last.
        steps: (P, K+1) ascending by at most 1 from entry 1 on, so that an interval spans at most
            one knot.

    Returns:
        mid (P, K+1, J, 3) and radius (P, K+1, J): entry k >= 1 holds the path between
        ``steps[k-1]`` and ``steps[k]``; entry 0 is the path at step 0. Interval 1 begins at
        ``steps[1] - 1``, the step of now.
    """
    last = knots.shape[1] - 1
    ends = steps[:, 1:]
    bounds = np.clip(np.concatenate([ends[:, :1] - 1.0, ends], axis=1), 0.0, last)
    below = np.minimum(bounds.astype(np.intp), max(last - 1, 0))
    person = np.arange(len(knots))[:, None]
    part = (bounds - below)[..., None, None]
    lower, upper = knots[person, below], knots[person, np.minimum(below + 1, last)]
    at = lower + part * (upper - lower)  # (P, K+1, J, 3) at the bounds
    start, end = at[:, :-1], at[:, 1:]
    corner = upper[:, :-1]
    inside = (below[:, :-1] + 1 < bounds[:, 1:])[..., None]
    mid = 0.5 * (start + end)
    half = 0.5 * _norm(end - start)
    radius = np.maximum(half, np.where(inside, _norm(corner - mid), 0.0))
    return (
        np.concatenate([knots[:, :1], mid], axis=1),
        np.concatenate([np.zeros_like(radius[:, :1]), radius], axis=1),
    )


def _std_during(std: Floats, steps: Floats, horizon_steps: int) -> Floats:
    """(P, H, J) at the forecast's steps to the largest (P, K+1, J) during each interval."""
    people = len(std)
    person = np.arange(people)[:, None]
    end = np.ceil(steps[:people]).astype(np.intp)  # forecast step k is at (k + 1)
    after = std[person, np.clip(end - 1, 0, horizon_steps - 1)]
    before = std[person, np.clip(end - 2, 0, horizon_steps - 1)]
    return np.maximum(after, before)


def _norm(vectors: Floats) -> Floats:
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    result: Floats = np.sqrt(x * x + y * y + z * z)
    return result
