"""Joint zones: one sphere for each joint of each person and each interval.

The growth rule
===============
Time ``t`` runs from each person's capture. A joint that was seen in that capture, and in
``SETTLED_STEPS`` of the last ``RECENT_STEPS`` steps, is within its *calibrated radius* of its
forecast position (``radii``: by what is known of this joint and this forecast). The live
self-check may widen this radius by a factor.

Without a calibration the *uncalibrated rule* applies. The joint is within

    min(v t, a t^2 / 2 + e_v t)

of its forecast position. ``v`` comes from the standard, ``a`` from SaRA (``HumanLimits``), and
``e_v`` bounds the error of the forecast's velocity. A person who suddenly does the opposite of the
forecast can leave such a zone; how often is unknown.

*Physical limits*, what a body can do by then (``reach``), apply without a forecast, to a joint that
was not seen in the capture or only recently appeared, and to a person whose motion is out of
distribution. Without a calibration, the standard's assumption replaces them: the joint is at most
``v (t + joint_age)`` from where it was last seen, where ``v`` is the physical speed or the joint's
present speed, whichever is higher, and the physical limit if nobody could measure how fast the
person is. A lost person goes on from where each joint was last seen, at the speed last measured or
the physical speed, whichever is higher; a limb that was faster than its body gets an arm's length
farther. Past the last calibrated step the zone grows at the physical speed.

Zones that follow a forecast are also cut to what a body can do by then.
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.arrays import Bools, Floats
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.base import Forecast
from hri_predict.risk.self_check.self_check import Trust
from hri_predict.risk.settings import HumanLimits
from hri_predict.risk.zones.human_speed import Velocities, velocities_in
from hri_predict.risk.zones.learned_scale import Evidence
from hri_predict.risk.zones.motion_class import trunk_speed
from hri_predict.risk.zones.radii import Radii
from hri_predict.risk.zones.reach import BodyReach
from hri_predict.risk.zones.spheres import enclosed
from hri_predict.skeleton import Skeleton

_NEVER_S = 1e3
"""Age of a joint that was never seen: at any human speed it may be anywhere."""
_UNBOUNDED_M = 1e5
"""Radius of a joint before the cut to what bodies can do."""
_FAR_M = 1e4
"""A coordinate beyond this is no position in a room."""
FRESH_S = 1e-6
LIMB_M = 0.85
"""How far a limb gets ahead of its body: an arm's reach by ISO 13855:2010."""
RECENT_STEPS, SETTLED_STEPS = 15, 8
"""A joint is settled if it was seen in so many of the most recent steps: calibrated radii rest on
at least as much history."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointSpheres:
    """Where joints may be. P people (lost ones last), K steps after now, J joints.

    Attributes:
        mid, radius: (P, K+1, J, 3) and (P, K+1, J); entry 0 at the capture, entry k during the
            whole interval that ends with step k.
        path, inflation: the same for the forecast positions, without growth or cut. Joints without
            a forecast grow at the standard's speeds.
        joint_age: (P, J) seconds from when a joint was last seen to its person's capture.
        claimed: (P, H, J) the calibrated radii before widening, of the people who are here, also of
            those out of distribution, whose zones have physical limits. A missing radius is
            infinite. ``None`` without a calibration.
    """

    mid: Floats
    radius: Floats
    path: Floats
    inflation: Floats
    joint_age: Floats
    claimed: Floats | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Tracks:
    """Joints of P people at their captures, lost people last, and how they move on."""

    last: Floats  # (P, J, 3) where last seen
    joint_age: Floats  # (P, J) seconds before the capture
    speed: Floats  # (P, J) of a joint that is not forecast
    forecast: Bools  # (P, J) whether the joint follows the forecast
    age: Floats  # (P,) seconds from capture to now
    waited: Floats  # (P,) seconds from capture to the time of entry 0
    limbs: Floats  # (P, J) how much faster than its body a lost person's joint was


class JointZones:
    """Builds joint zones; see the module's docstring.

    Args:
        skeleton: the joints.
        limits: see ``HumanLimits``.
        rate_hz: steps per second of the forecast.
        horizon_steps: H of the forecast.
        times_s: (K+1,) ends of the intervals after now, from 0.
        radii: calibrated ones; ``None``: the predictor is not calibrated.
    """

    def __init__(
        self,
        *,
        skeleton: Skeleton,
        limits: HumanLimits,
        rate_hz: float,
        horizon_steps: int,
        times_s: Floats,
        radii: Radii | None,
    ) -> None:
        self._skeleton = skeleton
        self._limits = limits
        self._rate_hz = rate_hz
        self._horizon_steps = horizon_steps
        self._times_s = times_s
        self._radii = radii
        self._trusted_steps = horizon_steps if radii is None else min(horizon_steps, radii.steps)
        self._body = BodyReach(limits, skeleton, rate_hz)
        arm = np.zeros(len(skeleton.joints), dtype=bool)
        for part in ("left_arm", "right_arm"):
            arm[list(skeleton.parts.get(part, ()))] = True
        self._speed: Floats = np.where(arm, limits.arm_speed_m_s, limits.body_speed_m_s)
        self._acceleration: Floats = np.where(
            arm, limits.arm_acceleration_m_s2, limits.body_acceleration_m_s2
        )

    def build(
        self,
        snapshot: PeopleSnapshot,
        forecast: Forecast | None,
        *,
        capture_ns: int | None,
        trust: Trust | None,
        velocities: Velocities | None = None,
        growth_m_s: Floats | float | None = None,
        unknown: Bools | None = None,
    ) -> JointSpheres:
        """Spheres for everybody in ``snapshot``; see ``ZoneBuilder.build``.

        Args:
            snapshot, forecast, trust, velocities: as there.
            capture_ns: the oldest capture; ``None``: there is none.
            growth_m_s: (P, J) speeds of joints without a forecast; ``None``: the physical speed.
            unknown: (P,) whose speed is unknown: without a calibration they have no forecast.
        """
        if velocities is None:
            velocities = velocities_in(snapshot, self._rate_hz)
        claimed = None if forecast is None else self._claimed(snapshot, forecast, trust, velocities)
        tracks = self._tracks(
            snapshot,
            claimed=claimed,
            trust=trust,
            capture_ns=capture_ns,
            growth_m_s=self._limits.physical_speed_m_s if growth_m_s is None else growth_m_s,
            is_forecast=forecast is not None,
            unknown=np.zeros(len(snapshot.ids), np.bool_) if unknown is None else unknown,
        )
        since = tracks.age[:, None] + self._times_s  # (P, K+1) seconds since capture
        until = since.copy()
        since[:, 0] = until[:, 0] = tracks.waited
        unseen = until[..., None] + tracks.joint_age[:, None]
        growth = tracks.speed[:, None] * unseen
        growth += np.minimum(tracks.limbs[:, None] * unseen, LIMB_M)
        shape = (*since.shape, tracks.last.shape[1])
        follows = tracks.forecast[:, None]
        if forecast is None or not tracks.forecast.any():
            path = np.broadcast_to(tracks.last[:, None], (*shape, 3))
            inflation, around = growth, growth
        else:
            path, inflation = enclosed(self._knots(tracks, forecast), since * self._rate_hz)
            rule = self._deviation(until, forecast, claimed, trust)
            around = inflation + np.where(follows, rule, growth)
            inflation = np.where(follows, inflation, inflation + growth)
        mid, radius = path, around
        if self._radii is not None or tracks.forecast.any():
            mid, radius = self._cut(path, around, tracks=tracks, snapshot=snapshot, until=until)
        return JointSpheres(
            mid=mid,
            radius=radius,
            path=path,
            inflation=inflation,
            joint_age=tracks.joint_age,
            claimed=claimed,
        )

    def _claimed(
        self,
        snapshot: PeopleSnapshot,
        forecast: Forecast,
        trust: Trust | None,
        velocities: Velocities,
    ) -> Floats | None:
        """(P, H, J) calibrated radii, infinite for people and joints that have none."""
        if self._radii is None:
            return None
        people, joints = len(snapshot.ids), len(self._skeleton.joints)
        if trust is None:
            return np.full((people, self._horizon_steps, joints), np.inf)
        speed = trunk_speed(velocities, self._skeleton)
        evidence = Evidence(
            history=snapshot.history,
            observed=snapshot.observed,
            forecast=forecast.positions,
            error_m=trust.error_m,
            residual_m=trust.residual_m,
        )
        claimed = self._radii.of(speed, evidence)
        recent = snapshot.observed[:, -RECENT_STEPS:].sum(1)  # (P, J)
        settled = recent >= min(SETTLED_STEPS, snapshot.observed.shape[1])
        known = settled & np.isfinite(claimed[:, : self._trusted_steps]).all(1)
        return np.where(known[:, None], claimed, np.inf)

    def _tracks(
        self,
        snapshot: PeopleSnapshot,
        *,
        claimed: Floats | None,
        trust: Trust | None,
        capture_ns: int | None,
        growth_m_s: Floats | float,
        is_forecast: bool,
        unknown: Bools,
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
            [
                snapshot.joint_age_s.reshape(people, joints),
                np.array([p.joint_age_s for p in snapshot.lost]).reshape(lost, joints),
            ]
        )
        seen = (np.abs(last) < _FAR_M).all(-1) & (joint_age >= 0)  # false for NaN too
        last = np.where(seen[..., None], last, 0.0)
        joint_age = np.where(seen, np.minimum(joint_age, _NEVER_S), _NEVER_S)
        is_lost = np.arange(people + lost)[:, None] >= people
        fresh = (joint_age < FRESH_S) & ~is_lost
        follows = np.zeros_like(fresh)
        if is_forecast:
            follows = fresh & ~np.append(unknown, np.zeros(lost, bool))[:, None]
            if claimed is not None and trust is not None:
                # a joint without a radius, and a person out of distribution, have physical limits
                has = np.isfinite(claimed[:, : self._trusted_steps]).all(1)
                has &= ~trust.out_of_distribution[:, None]
                follows = fresh & np.concatenate([has, np.zeros((lost, joints), bool)])
        captures = np.array(
            [*snapshot.capture_ns, *(p.last_seen_ns for p in snapshot.lost)], dtype=np.int64
        )
        # a hidden joint of a person of unknown speed is within its reach of those that are seen
        hidden = unknown[:, None] & ~fresh[:people]
        present = np.where(hidden, self._limits.physical_speed_m_s, growth_m_s)
        onward = np.array([p.speed_m_s for p in snapshot.lost]).reshape(lost, 1)
        onward = np.maximum(onward, self._limits.physical_speed_m_s)  # as just before the loss
        limbs = np.array([p.limbs_m_s for p in snapshot.lost]).reshape(lost, joints)
        reference = snapshot.now_ns if capture_ns is None else capture_ns
        return _Tracks(
            last=last,
            joint_age=joint_age,
            speed=np.concatenate([present, np.repeat(onward, joints, axis=1)]),
            limbs=np.concatenate([np.zeros((people, joints)), limbs]),
            forecast=follows,
            age=np.maximum(0.0, (snapshot.now_ns - captures) * 1e-9),
            waited=np.where(is_lost[:, 0], np.maximum(0.0, (reference - captures) * 1e-9), 0.0),
        )

    def _knots(self, tracks: _Tracks, forecast: Forecast) -> Floats:
        """(P, H+1, J, 3) the forecast's path from the capture on; other joints stay in place."""
        people = len(forecast.positions)
        knots = np.repeat(tracks.last[:, None], self._horizon_steps + 1, axis=1)
        follows = np.broadcast_to(tracks.forecast[:people, None, :, None], forecast.positions.shape)
        np.copyto(knots[:people, 1:], forecast.positions, where=follows)
        return knots

    def _deviation(
        self,
        until: Floats,
        forecast: Forecast,
        claimed: Floats | None,
        trust: Trust | None,
    ) -> Floats:
        """(P, K+1, J) largest distance from the forecast by each interval's end (P, K+1),
        metres."""
        end = self._trusted_steps / self._rate_hz
        beyond = self._limits.physical_speed_m_s * np.maximum(until - end, 0.0)[..., None]
        people, steps = len(forecast.positions), until * self._rate_hz
        if claimed is None or trust is None:
            within = self._uncalibrated(np.minimum(until, end)[..., None])
        else:
            table = claimed * trust.widen[..., None]
            at = np.ceil(steps[:people] - 1e-6).astype(np.intp) - 1  # the step that ends it
            person = np.arange(people)[:, None]
            here = table[person, np.minimum(np.maximum(at, 0), self._trusted_steps - 1)]
            within = np.zeros((*until.shape, here.shape[-1]))
            within[:people] = here
        rule: Floats = within + beyond
        if forecast.std is not None and self._limits.std_factor > 0:
            std = _std_during(forecast.std, steps, self._horizon_steps)
            rule[:people] = np.maximum(rule[:people], self._limits.std_factor * std)
        rule[:, 0] = 0.0
        return rule

    def _uncalibrated(self, t: Floats) -> Floats:
        free = (0.5 * self._acceleration * t + self._limits.velocity_error_m_s) * t
        return np.minimum(self._speed * t, free)

    def _cut(
        self,
        mid: Floats,
        radius: Floats,
        *,
        tracks: _Tracks,
        snapshot: PeopleSnapshot,
        until: Floats,
    ) -> tuple[Floats, Floats]:
        """Cut to what a body can do; entry 0 stays as captured.

        With a calibration, this cut alone bounds a joint without a radius: zones at the standard's
        speeds hold fewer bodies than calibrated zones. Without a calibration, joints that follow no
        forecast keep the standard's speeds.
        """
        people = len(snapshot.ids)
        begin = np.maximum(until[:people, 1:] - 1.0 / self._rate_hz, 0.0)
        age, follows = tracks.joint_age[:people], tracks.forecast[:people, None]
        around, fresh = radius[:people, 1:], age < FRESH_S
        if self._radii is not None:
            around = np.where(follows, around, _UNBOUNDED_M)
        own_mid, own = self._body.cut_by_motion(
            mid[:people, 1:],
            around,
            last=tracks.last[:people],
            velocity=self._body.velocity(snapshot.history, snapshot.observed),
            since=begin,
            until=until[:people, 1:],
            joint_age=age,
        )
        if self._radii is None:
            own_mid = np.where(follows[..., None], own_mid, mid[:people, 1:])
            own = np.where(follows, own, around)
        cut = self._body.cut_by_bones(
            own_mid,
            own,
            last=tracks.last[:people],
            seen=fresh,
            all_joints=self._radii is not None,
        )
        mid, radius = mid.copy(), radius.copy()
        mid[:people, 1:], radius[:people, 1:] = cut
        return mid, radius


def _std_during(std: Floats, steps: Floats, horizon_steps: int) -> Floats:
    """(P, H, J) at the forecast's steps to the largest (P, K+1, J) during each interval."""
    people = len(std)
    person = np.arange(people)[:, None]
    end = np.ceil(steps[:people]).astype(np.intp)  # forecast step k is at (k + 1)
    after = std[person, np.clip(end - 1, 0, horizon_steps - 1)]
    before = std[person, np.clip(end - 2, 0, horizon_steps - 1)]
    return np.maximum(after, before)
