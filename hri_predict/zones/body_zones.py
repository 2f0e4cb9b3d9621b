"""Zones: the region in which each body segment of each person may be, interval by interval.

``joint_zones`` gives a sphere for each joint. A capsule between the two joints of a segment
encloses the segment; its radius is the larger of their spheres' radii plus the segment's own. The
skeleton's reach from the nearest observed joint bounds a segment that was neither seen nor
inferred, in each interval in which that sphere is smaller: the sphere of a joint that was just
hidden grows at the physical limit, and soon exceeds this reach.

Zones include the position error that a source states for a person. They do not include the position
uncertainty Z_d of the configuration: ``separation`` adds it once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.geometry import Capsules
from hri_predict.base.machine.compiled import kernel, plain
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import PeopleSnapshot, RecentCaptures
from hri_predict.protocol.reasons import Reason
from hri_predict.zones.human_speed import (
    HumanSpeeds,
    SpeedRule,
    Velocities,
    joined_speeds,
    velocities_in,
)
from hri_predict.zones.joint_speeds import joint_speeds
from hri_predict.zones.joint_zones import FRESH_S, JointZones
from hri_predict.zones.lost_places import anywhere_in
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import Trust
from hri_predict.zones.settings import HumanLimits
from hri_predict.zones.toward import Toward
from hri_predict.zones.types import Zones


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BodyZones:
    """The zones of one tick, and other data about these bodies for the risk stage.

    Attributes:
        zones: people in the order of the snapshot, then lost people; see ``Zones``. Entry 0 is the
            body as captured (for a lost person, grown up to that capture); entry k >= 1 holds the
            body throughout ``[times_s[k-1], times_s[k]]`` after ``now_ns``.
        paths: as ``zones``, for the forecast bodies without growth.
        lost: (P,) whether a person is lost.
        age_s: age in seconds of the oldest capture used for the zones; 0 without people.
        capture_ns: time of that capture; without people, of the newest good capture.
        reasons: reasons why the zones are larger than usual.
        claimed: see ``JointSpheres``.
        speeds: speeds of all people, in the order of ``zones``.
        segments_m_s: (P, S) speed of each segment in the room as captured, at its faster end;
            infinite if unknown, as for a lost person. For an inferred hand or foot, the physical
            limit is used, because the tracker does not see its rotation.
        as_assumed: (P,) whether the standard's assumptions are known to hold for a person: the
            person is in view, at a measured speed that is not fast; the forecast plays no part. For
            all others, only the zones decide in mode ``predictive``.
        untrusted: reasons why the scene cannot be trusted; the zones are then not valid.
        margins_m: (S,) added thickness of each segment of ``zones``; ``None``: nothing was added.
        toward: extent of the people in view by direction; ``None``: not calibrated.
        errors_m: (P,) possible common error of all joints of a person; included in zones, paths and
            ``toward``. ``None``: 0.
        fresh: (P, J) joints of the people in view that their newest captures show.
    """

    zones: Zones
    paths: Capsules
    lost: Bools
    age_s: float
    capture_ns: int | None
    speeds: HumanSpeeds
    segments_m_s: Floats
    as_assumed: Bools
    reasons: tuple[Reason, ...] = ()
    claimed: Floats | None = None
    untrusted: tuple[Reason, ...] = ()
    margins_m: Floats | None = None
    toward: Toward | None = None
    errors_m: Floats | None = None
    fresh: Bools | None = None

    def error_m(self, person: int) -> float:
        """Return the possible common error of all joints of a person, in metres."""
        return 0.0 if self.errors_m is None else float(self.errors_m[person])

    @property
    def captured(self) -> Capsules:
        """(P, S) the bodies as captured, without margins, to check that distances grow.

        With margins, a different part may be the nearest, and the approach of another may be
        missed.
        """
        zones = self.zones.capsules
        margins: Floats | float = 0.0 if self.margins_m is None else self.margins_m
        return Capsules(zones.a[:, 0], zones.b[:, 0], zones.radius[:, 0] - margins)


class ZoneBuilder:
    """Builds zones from a snapshot and its forecast, for all people in one batch.

    Args:
        skeleton: the joints' order and the segments.
        absent_parts: body parts that are never visible (such as the legs of a seated person).
        limits: see ``HumanLimits``.
        rate_hz: steps per second of the forecast and of the zones.
        horizon_steps: H of the forecast.
        steps: number of steps of zones after now; defaults to ``horizon_steps``.
        radii: calibrated radii; ``None``: the predictor is not calibrated.
        with_paths: whether to build ``paths``; otherwise ``paths`` are the zones.
        margins_m: added thickness of segments, by region (``head``, ``hand``). Where segments
            cannot be told apart, the largest margin is used.

    Attributes:
        joints: see ``JointZones``.
        times_s: (K+1,) the zones' times, see ``Zones``.

    Raises:
        ConfigError: an absent part or a region is unknown, or no segment is left.
    """

    def __init__(
        self,
        *,
        skeleton: Skeleton,
        absent_parts: Sequence[str],
        limits: HumanLimits,
        rate_hz: float,
        horizon_steps: int,
        steps: int | None = None,
        radii: Radii | None = None,
        with_paths: bool = True,
        margins_m: Mapping[str, float] | None = None,
    ) -> None:
        self._skeleton = skeleton
        self._rate_hz = rate_hz
        self._with_paths = with_paths
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
        margins = _margins(margins_m or {}, skeleton)
        radius = np.array([s.radius + margins.get(s.region, 0.0) for s in segments])
        self._margins_m: Floats = np.array([margins.get(s.region, 0.0) for s in segments])
        self._largest_margin_m = max(margins.values(), default=0.0)
        self._segment = _Segments(
            a=self._a,
            b=self._b,
            radius=radius,
            # a sphere of this size about joint k holds the whole of segment s
            reach=np.maximum(skeleton.reach[self._a], skeleton.reach[self._b]),
            physical_m_s=float(limits.physical_speed_m_s),
        )
        self._speed_rule = SpeedRule(skeleton, limits)
        self.times_s: Floats = np.arange(1 + (steps or horizon_steps)) / rate_hz
        self.joints = JointZones(
            skeleton=skeleton,
            limits=limits,
            rate_hz=rate_hz,
            horizon_steps=horizon_steps,
            times_s=self.times_s,
            radii=radii,
        )

    def build(
        self,
        snapshot: PeopleSnapshot,
        forecast: Forecast | None,
        *,
        trust: Trust | None = None,
        velocities: Velocities | None = None,
    ) -> BodyZones:
        """Return the zones of all people in ``snapshot``.

        Args:
            snapshot: people at this tick.
            forecast: forecast for the same people in the same order; ``None``: only physical limits
                apply.
            trust: result of the live self-check, required for calibrated radii.
            velocities: velocities of the joints in ``snapshot``; ``None``: they are measured here.
        """
        capture_ns = _oldest_capture(snapshot)
        if velocities is None:
            velocities = velocities_in(snapshot, self._rate_hz)
        recent = snapshot.recent
        if recent is None:
            recent = RecentCaptures.of_history(snapshot.history, snapshot.observed, self._rate_hz)
        moving = self._speed_rule.moving(
            joint_speeds(recent, snapshot.shown), snapshot.shown, (self._a, self._b)
        )
        speeds = moving.people
        joints = self.joints.build(
            snapshot,
            forecast,
            capture_ns=capture_ns,
            trust=trust,
            velocities=velocities,
            growth_m_s=moving.growth_m_s,
            unknown=speeds.unknown,
        )
        errors_m = snapshot.all_errors_m
        zones, ends, extra = self._segments(joints.mid, joints.radius, joints.joint_age)
        zones = _grown(self._where_lost(zones, snapshot, capture_ns), errors_m)
        toward = self.joints.toward(
            snapshot, forecast, spheres=joints, trust=trust, velocities=velocities
        )
        if toward is not None:
            here = len(snapshot.ids)
            extra = extra[:here] + errors_m[:here, None]
            toward = toward._replace(ends=ends[:here], extra=extra)
        paths = zones
        if self._with_paths:
            paths, _, _ = self._segments(joints.path, joints.inflation, joints.joint_age)
            paths = _grown(self._where_lost(paths, snapshot, capture_ns), errors_m)
        ids = snapshot.ids + tuple(person.id for person in snapshot.lost)
        return BodyZones(
            zones=Zones(ids, self.segment_names, self.times_s, zones),
            paths=paths,
            lost=np.arange(len(ids)) >= len(snapshot.ids),
            age_s=0.0 if capture_ns is None else max(0.0, (snapshot.now_ns - capture_ns) * 1e-9),
            capture_ns=capture_ns,
            claimed=joints.claimed,
            speeds=joined_speeds([speeds, self._lost_speeds(snapshot)]),
            margins_m=self._margins_m,
            toward=toward,
            errors_m=errors_m,
            fresh=snapshot.fresh,
            segments_m_s=np.concatenate(
                [moving.segments_m_s, np.full((len(snapshot.lost), len(self._a)), np.inf)]
            ),
            as_assumed=np.append(
                speeds.within_standard
                & ~self._speed_rule.peaked(snapshot.history, snapshot.measured, self._rate_hz),
                np.zeros(len(snapshot.lost), np.bool_),
            ),
        )

    def _lost_speeds(self, snapshot: PeopleSnapshot) -> HumanSpeeds:
        speeds_m_s = np.array([person.speed_m_s for person in snapshot.lost], dtype=np.float64)
        return self._speed_rule.lost(speeds_m_s, len(self.segment_names))

    def _where_lost(
        self, zones: Capsules, snapshot: PeopleSnapshot, capture_ns: int | None
    ) -> Capsules:
        """Replace the zones of lost people by their possible places where these are known."""
        for i, person in enumerate(snapshot.lost, len(snapshot.ids)):
            if person.places is None or person.places_ns is None:
                continue
            reference = snapshot.now_ns if capture_ns is None else capture_ns
            until = (snapshot.now_ns - person.places_ns) * 1e-9 + self.times_s
            until[0] = (reference - person.places_ns) * 1e-9
            own = anywhere_in(person, np.maximum(until, 0.0), zones.radius.shape[-1])
            zones.a[i], zones.b[i] = own.a, own.b
            zones.radius[i] = own.radius + self._largest_margin_m
        return zones

    def _segments(
        self, mid: Floats, around: Floats, joint_age: Floats
    ) -> tuple[Capsules, Ints, Floats]:
        """Convert spheres to capsules (P, K+1, S), with ``ends`` and ``extra`` of ``Toward``."""
        a, b, radius, ends, extra = _capsules((plain(mid), plain(around), joint_age), self._segment)
        return Capsules(a, b, radius), ends, extra


def _grown(zones: Capsules, errors_m: Floats) -> Capsules:
    """Return (P, K+1, S) zones enlarged by the position errors of the bodies.

    Without errors, the same zones are returned: no code writes to them after this.
    """
    if not errors_m.any():
        return zones
    return Capsules(zones.a, zones.b, zones.radius + errors_m[:, None, None])


class _Segments(NamedTuple):
    """(S,) ends and radii of segments, (S, J) their reach from each joint; m/s."""

    a: Ints
    b: Ints
    radius: Floats
    reach: Floats
    physical_m_s: float


_ROUNDING_M = 1e-9
"""Minimum gain that replaces a sphere: a joint's own may be cut at this reach, then both are equal
but for rounding."""

_Spheres = tuple[Floats, Floats, Floats]
"""``mid``, ``radius`` and ``joint_age`` of ``JointSpheres``."""
_Found = tuple[Floats, Floats, Floats, Ints, Floats]
"""Capsules' ends and radius; ``ends`` and ``extra`` of ``Toward``."""


def _capsules_by_arrays(spheres: _Spheres, segments: _Segments) -> _Found:
    mid, around, joint_age = spheres
    a, b = mid.take(segments.a, axis=2), mid.take(segments.b, axis=2)
    ends = np.empty((len(mid), len(segments.a), 2), np.int64)
    ends[..., 0], ends[..., 1] = segments.a, segments.b
    extra = np.repeat(segments.radius[None], len(mid), axis=0)
    radius = np.maximum(around.take(segments.a, axis=2), around.take(segments.b, axis=2))
    if (joint_age > FRESH_S).any():
        oldest = np.maximum(joint_age[:, segments.a], joint_age[:, segments.b])  # (P, S)
        unseen = joint_age[:, None] * segments.physical_m_s
        holding = segments.reach + unseen  # (P, S, J)
        by_seen = np.where(joint_age[:, None] <= FRESH_S, segments.reach, inf)
        always = holding.min(-1) < oldest * segments.physical_m_s
        hidden = (oldest > FRESH_S) & (by_seen.min(-1) < inf)
        person = np.arange(len(mid))[:, None]
        for sizes, given in ((holding, always), (by_seen, hidden)):
            nearest = sizes.argmin(-1)
            centre = mid.transpose(0, 2, 1, 3)[person, nearest].transpose(0, 2, 1, 3)
            reach = segments.reach[np.arange(len(segments.a)), nearest]
            held = around.transpose(0, 2, 1)[person, nearest].transpose(0, 2, 1) + reach[:, None]
            bounded = np.broadcast_to(given[:, None], held.shape)  # (P, K+1, S)
            if sizes is by_seen:
                bounded = bounded & (held + _ROUNDING_M < radius)
            a = np.where(bounded[..., None], centre, a)
            b = np.where(bounded[..., None], centre, b)
            radius = np.where(bounded, held, radius)
            at_end = bounded[:, -1]
            ends = np.where(at_end[..., None], nearest[..., None], ends)
            extra = np.where(at_end, segments.radius + reach, extra)
    return a, b, radius + segments.radius, ends, extra


def _capsules_by_loops(spheres: _Spheres, segments: _Segments) -> _Found:
    mid, around, joint_age = spheres
    people, entries, joints = around.shape
    count = len(segments.a)
    a, b = np.empty((people, entries, count, 3)), np.empty((people, entries, count, 3))
    radius, extra = np.empty((people, entries, count)), np.empty((people, count))
    ends = np.empty((people, count, 2), np.int64)
    for p in range(people):
        stale = False
        for j in range(joints):
            stale = stale or joint_age[p, j] > FRESH_S
        for s in range(count):
            at_a, at_b, reach, seen, by_seen = segments.a[s], segments.b[s], 0.0, 0, inf
            hidden = max(joint_age[p, at_a], joint_age[p, at_b]) > FRESH_S
            if stale:
                nearest, least = 0, inf
                for j in range(joints):
                    size = segments.reach[s, j] + joint_age[p, j] * segments.physical_m_s
                    if size < least:
                        nearest, least = j, size
                    if joint_age[p, j] <= FRESH_S and segments.reach[s, j] < by_seen:
                        seen, by_seen = j, segments.reach[s, j]
                if least < max(joint_age[p, at_a], joint_age[p, at_b]) * segments.physical_m_s:
                    at_a = at_b = nearest
                    reach = segments.reach[s, nearest]
            from_a, from_b, more = at_a, at_b, reach
            for k in range(entries):
                size = max(around[p, k, at_a], around[p, k, at_b]) + reach
                from_a, from_b, more = at_a, at_b, reach
                if hidden and around[p, k, seen] + by_seen + _ROUNDING_M < size:
                    size = around[p, k, seen] + by_seen
                    from_a, from_b, more = seen, seen, by_seen
                for i in range(3):
                    a[p, k, s, i], b[p, k, s, i] = mid[p, k, from_a, i], mid[p, k, from_b, i]
                radius[p, k, s] = size + segments.radius[s]
            ends[p, s, 0], ends[p, s, 1], extra[p, s] = from_a, from_b, segments.radius[s] + more
    return a, b, radius, ends, extra


_capsules = kernel(_capsules_by_loops, _capsules_by_arrays)


def _margins(margins_m: Mapping[str, float], skeleton: Skeleton) -> Mapping[str, float]:
    known = list(dict.fromkeys(segment.region for segment in skeleton.segments))
    for region in margins_m:
        if region not in known:
            raise ConfigError(
                f"risk.region_margins_m: unknown body segment '{region}'{nearest(region, known)} "
                f"(known: {', '.join(known)})"
            )
    return margins_m


def _oldest_capture(snapshot: PeopleSnapshot) -> int | None:
    if len(snapshot.ids):
        return int(snapshot.capture_ns.min())
    return snapshot.newest_capture_ns
