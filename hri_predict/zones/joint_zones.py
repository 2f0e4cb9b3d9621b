"""Joint zones: one sphere for each joint of each person and each interval.

The growth rule
===============
Time ``t`` runs from each person's capture. A joint that was seen in
that capture, and in ``SETTLED_STEPS`` of the last ``RECENT_STEPS`` steps, is within its *calibrated
radius* of its forecast position (``radii`` computes it for this joint and forecast). The live
self-check may widen this radius by a factor.

Without a calibration the *uncalibrated rule* applies. The joint is within

    min(v t, a t^2 / 2 + e_v t)

of its forecast position. ``v`` comes from the standard, ``a`` from SaRA (``HumanLimits``), and
``e_v`` bounds the error of the forecast's velocity. A person who suddenly does the opposite of the
forecast can leave such a zone; the rate of this is unknown.

*Physical limits* bound what a body can do in a given time (``reach``). They apply without a
forecast, to a joint that was not seen in the capture or only recently appeared, and to a person
whose motion is out of distribution. Without a calibration, the standard's assumption replaces them:
the joint is at most ``v (t + joint_age)`` from where it was last seen, where ``v`` is the higher of
the physical speed and the joint's present speed, or the physical limit if the person's speed could
not be measured. The zones of a lost person grow from each joint's last seen position, at the higher
of the last measured speed and the physical speed. A limb that was faster than its body may get up
to an arm's length ahead of it. Past the last calibrated step the zone stays where
the forecast was then, and grows at the physical speed.

Zones that follow a forecast are also cut to the physical limits.

If the tracker never delivers a joint, its sphere is centred on its *inferred* position, and always
enlarged by the radius that holds the true joint.
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Bools, Floats, plain_flags
from hri_predict.base.machine.compiled import kernel, plain
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.human_speed import Velocities, velocities_in
from hri_predict.zones.joint_zone_arrays import spheres_by_arrays
from hri_predict.zones.learned_scale import Evidence
from hri_predict.zones.loops.spheres import (
    FRESH_S,
    LIMB_M,
    Ahead,
    CapturedBodies,
    Rule,
    spheres_by_loops,
)
from hri_predict.zones.motion_class import trunk_speed
from hri_predict.zones.radii import Radii
from hri_predict.zones.reach import BodyReach
from hri_predict.zones.settings import HumanLimits
from hri_predict.zones.toward import Toward, followed, ways
from hri_predict.zones.trust import Trust

__all__ = ["FRESH_S", "LIMB_M", "JointSpheres", "JointZones"]

RECENT_STEPS, SETTLED_STEPS = 15, 8
"""Number of recent steps in which a settled joint was seen; calibrated radii assume at least as
much history."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointSpheres:
    """Regions where joints may be. P people (lost people last), K steps after now, J joints.

    Attributes:
        mid, radius: (P, K+1, J, 3) and (P, K+1, J); entry 0 is for the capture, entry k for the
            whole interval that ends with step k.
        path, inflation: as ``mid`` and ``radius``, for the forecast positions without growth or
            cut. Joints without a forecast grow at the standard's speeds.
        joint_age: (P, J) seconds from a joint's last observation to its person's capture.
        claimed: (P, H, J) calibrated radii before widening, for the people in view, including those
            out of distribution, whose zones use physical limits. Infinite if there is no radius.
            ``None`` without a calibration.
    """

    mid: Floats
    radius: Floats
    path: Floats
    inflation: Floats
    joint_age: Floats
    claimed: Floats | None


class JointZones:
    """Builds joint zones; see the module's docstring.

    Args:
        skeleton: the joints.
        limits: see ``HumanLimits``.
        rate_hz: steps per second of the forecast.
        horizon_steps: H of the forecast.
        times_s: (K+1,) ends of the intervals after now, from 0.
        radii: calibrated radii; ``None``: the predictor is not calibrated.
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
        self._radii = radii
        self._trusted_steps = horizon_steps if radii is None else min(horizon_steps, radii.steps)
        arm = np.zeros(len(skeleton.joints), dtype=bool)
        for part in ("left_arm", "right_arm"):
            arm[list(skeleton.parts.get(part, ()))] = True
        self._rule = Rule(
            times_s=plain(times_s),
            rate_hz=float(rate_hz),
            horizon_steps=horizon_steps,
            trusted_steps=self._trusted_steps,
            calibrated=radii is not None,
            speed=np.where(arm, limits.arm_speed_m_s, limits.body_speed_m_s),
            acceleration=np.where(arm, limits.arm_acceleration_m_s2, limits.body_acceleration_m_s2),
            velocity_error_m_s=float(limits.velocity_error_m_s),
            physical_m_s=float(limits.physical_speed_m_s),
            std_factor=float(limits.std_factor),
            reach=BodyReach.of(limits, skeleton, rate_hz),
        )

    def build(
        self,
        snapshot: PeopleSnapshot,
        forecast: Forecast | None,
        *,
        capture_ns: int | None,
        trust: Trust | None,
        velocities: Velocities | None = None,
        growth_m_s: Floats | None = None,
        unknown: Bools | None = None,
    ) -> JointSpheres:
        """Return spheres for all people in ``snapshot``; see ``ZoneBuilder.build``.

        Args:
            snapshot, forecast, trust, velocities: as in ``ZoneBuilder.build``.
            capture_ns: time of the oldest capture; ``None``: no capture.
            growth_m_s: (P, J) speeds for joints without a forecast; ``None``: the physical speed.
            unknown: (P,) whether a person's speed is unknown; without a calibration, their forecast
                is not used.
        """
        if velocities is None:
            velocities = velocities_in(snapshot, self._rate_hz)
        claimed = None if forecast is None else self._claimed(snapshot, forecast, trust, velocities)
        if unknown is None:
            unknown = np.zeros(len(snapshot.ids), np.bool_)
        if growth_m_s is None:
            growth_m_s = np.full(snapshot.joint_age_s.shape, float(self._limits.physical_speed_m_s))
        bodies = self._bodies(snapshot, capture_ns, growth_m_s, unknown)
        ahead = self._ahead(forecast, claimed, trust)
        mid, radius, path, inflation, joint_age = _spheres(bodies, ahead, self._rule)
        return JointSpheres(
            mid=mid,
            radius=radius,
            path=path,
            inflation=inflation,
            joint_age=joint_age,
            claimed=claimed,
        )

    def toward(
        self,
        snapshot: PeopleSnapshot,
        forecast: Forecast | None,
        *,
        spheres: JointSpheres,
        trust: Trust | None,
        velocities: Velocities,
    ) -> Toward | None:
        """Return the extent of each joint by direction, without segments; see ``Toward``.

        ``None``: there is no calibration, or no person in view.
        """
        here, rule = len(snapshot.ids), self._rule
        if forecast is None or trust is None or spheres.claimed is None or self._radii is None:
            return None
        shares = self._radii.shares(trunk_speed(velocities, self._skeleton))
        if shares is None or not here:
            return None
        follows = followed(
            spheres.joint_age[:here], spheres.claimed, trust.out_of_distribution, rule.trusted_steps
        )
        age_s = np.maximum(0.0, (snapshot.now_ns - snapshot.capture_ns) * 1e-9)
        until = age_s[:, None] + rule.times_s  # (P, K+1)
        at = np.ceil(until * rule.rate_hz - 1e-6).astype(np.intp) - 1
        at = np.clip(at, 0, rule.trusted_steps - 1)
        person = np.arange(here)[:, None]
        claim = spheres.claimed[person, at] * trust.widen[person, at][..., None]
        claim = np.where(follows[:, None], claim, 0.0)
        claim[:, 0] = 0.0
        within = np.zeros(spheres.joint_age[:here].shape)
        if snapshot.inferred is not None:
            within = snapshot.inferred.within_m
        end_s = rule.trusted_steps / rule.rate_hz
        beyond = rule.physical_m_s * np.maximum(until - end_s, 0.0)[..., None]
        rest = spheres.inflation[:here] - within[:, None] + beyond
        rest = np.where(follows[:, None], rest, np.inf)
        if forecast.std is not None:  # where the deviation decides, it does in every direction
            std = np.maximum(forecast.std[person, at], forecast.std[person, np.maximum(at - 1, 0)])
            least = rule.std_factor * std
            rest = np.where((least > 0) & (least >= spheres.claimed[person, at]), np.inf, rest)
        rest[:, 0] = np.inf
        path = spheres.path[:here]
        return Toward(
            ends=np.zeros((here, 0, 2), np.int64),
            extra=np.zeros((here, 0)),
            mid=plain(spheres.mid[:here]),
            radius=plain(spheres.radius[:here]),
            path=plain(path),
            claim=plain(claim),
            rest=plain(rest),
            within=plain(within),
            way=plain(ways(path - path[:, :1])),
            # a step begins where the one before ends
            shares=plain(np.maximum(shares[person, at], shares[person, np.maximum(at - 1, 0)])),
        )

    def _bodies(
        self,
        snapshot: PeopleSnapshot,
        capture_ns: int | None,
        growth_m_s: Floats,
        unknown: Bools,
    ) -> CapturedBodies:
        people, joints = len(snapshot.ids), len(self._rule.speed)
        here = np.zeros((people, joints))
        inferred = here if snapshot.inferred is None else snapshot.inferred.within_m
        rows = [snapshot.last_positions, snapshot.joint_age_s, growth_m_s, here, inferred]
        age_s = np.maximum(0.0, (snapshot.now_ns - snapshot.capture_ns) * 1e-9)
        waited = np.zeros(people)
        if snapshot.lost:
            rows = [np.concatenate(pair) for pair in zip(rows, self._lost(snapshot), strict=True)]
            seen_ns = np.array([p.last_seen_ns for p in snapshot.lost], dtype=np.int64)
            reference = snapshot.now_ns if capture_ns is None else capture_ns
            gone = np.maximum(0.0, (snapshot.now_ns - seen_ns) * 1e-9)
            age_s = np.concatenate([age_s, gone])
            waited = np.concatenate([waited, np.maximum(0.0, (reference - seen_ns) * 1e-9)])
        last, joint_age, growth, limbs, within = map(plain, rows)
        return CapturedBodies(
            last=last.reshape(-1, joints, 3),
            joint_age=joint_age.reshape(-1, joints),
            growth=growth,
            limbs=limbs,
            inferred=within,
            age=age_s,
            waited=waited,
            unknown=unknown,
            history=plain(snapshot.history),
            measured=plain_flags(snapshot.measured),
        )

    def _lost(self, snapshot: PeopleSnapshot) -> list[Floats]:
        """Return rows of lost people: positions, joint ages, speeds, limb speeds, inferred
        radii."""
        lost, joints = snapshot.lost, len(self._rule.speed)
        onward = np.array([[p.speed_m_s] for p in lost])
        onward = np.maximum(onward, self._limits.physical_speed_m_s)  # as just before the loss
        none = np.zeros(joints)
        return [
            np.array([p.positions for p in lost]),
            np.array([p.joint_age_s for p in lost]),
            np.repeat(onward, joints, axis=1),
            np.array([p.limbs_m_s for p in lost]),
            np.array([none if p.inferred_m is None else p.inferred_m for p in lost]),
        ]

    def _ahead(
        self, forecast: Forecast | None, claimed: Floats | None, trust: Trust | None
    ) -> Ahead:
        if forecast is None:
            return _NOTHING
        ahead = _NOTHING._replace(given=True, positions=plain(forecast.positions))
        if forecast.std is not None and self._limits.std_factor > 0:
            ahead = ahead._replace(std=plain(forecast.std))
        if claimed is None or trust is None:
            return ahead
        return ahead._replace(
            judged=True,
            claimed=plain(claimed),
            widen=plain(trust.widen),
            outside=plain_flags(trust.out_of_distribution),
        )

    def _claimed(
        self,
        snapshot: PeopleSnapshot,
        forecast: Forecast,
        trust: Trust | None,
        velocities: Velocities,
    ) -> Floats | None:
        """Return (P, H, J) calibrated radii, infinite for people and joints without one.

        They are at least ``std_factor`` stated standard deviations: the learned scale reads the
        deviation only within the range in which it was fitted, and need not grow with it.
        """
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
            measured=snapshot.measured,
            std=forecast.std,
        )
        claimed = self._radii.of(speed, evidence)
        if forecast.std is not None:
            claimed = np.maximum(claimed, self._limits.std_factor * forecast.std)
        recent = snapshot.observed[:, -RECENT_STEPS:].sum(1)  # (P, J)
        settled = recent >= min(SETTLED_STEPS, snapshot.observed.shape[1])
        known = settled & np.isfinite(claimed[:, : self._trusted_steps]).all(1)
        return np.where(known[:, None], claimed, np.inf)


_NOTHING = Ahead(
    given=False,
    judged=False,
    positions=np.zeros((0, 0, 0, 3)),
    std=np.zeros((0, 0, 0)),
    claimed=np.zeros((0, 0, 0)),
    widen=np.zeros((0, 0)),
    outside=np.zeros(0, np.bool_),
)

_spheres = kernel(spheres_by_loops, spheres_by_arrays)
