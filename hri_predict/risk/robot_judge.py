"""One robot against everybody: what the people, and what the sensor does not see, ask of it."""

from dataclasses import dataclass, replace

import numpy as np

from hri_predict.reasons import Reason
from hri_predict.risk.areas import FieldOfView, approach_m
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.geometry import horizontal_distance
from hri_predict.risk.levels import Demand, demand_of, margins
from hri_predict.risk.nearest_in_time import BodiesInTime, NearestInTime
from hri_predict.risk.plan import OnPlan
from hri_predict.risk.robot_tracker import RobotNow, RobotTracker
from hri_predict.risk.separation import Finding, StoppingCurve
from hri_predict.risk.separation_in_time import Course, farthest, judge_in_time
from hri_predict.risk.separation_now import judge_fixed, judge_iso
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.types import Capsules
from hri_predict.risk.zones import BodyZones
from hri_predict.scene import Floats

MOVING_M_S = 0.02
"""Below this speed the direction of motion says nothing about where the robot will go."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """What one tick asks of one robot.

    Attributes:
        demand: of people and unseen places together.
        people: what was found about the people; ``None`` where nobody is.
        unseen_decides: whether it is the unseen that asks for more.
    """

    demand: Demand
    people: Finding | None
    unseen_decides: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """How the robot moves now, and would stop. K steps after now."""

    q: Floats
    qd: Floats
    speed_m_s: float
    clearance_m: float  # C + Z_d + Z_r
    capsules: Capsules  # (C,) now
    stopping_s: float
    stopping_m: float
    times_s: Floats  # (K+1,)
    until_braking_s: float  # from now
    on_plan: OnPlan | None

    @property
    def is_foreseen(self) -> bool:
        """Whether it is known which way the robot goes on."""
        return self.on_plan is not None or self.speed_m_s > MOVING_M_S


class RobotJudge:
    """Judges one robot.

    Args:
        settings: see ``RiskSettings``.
        tracker: where the robot is.
        budget: the delays.
        view: what the sensor sees; ``None``: everything.
        horizon_s: the forecast's last step after the capture.

    Attributes:
        name: the robot's.
        max_speed_m_s: its highest speed in production.
        longest_s: T_r + T_s at worst: input almost stale, highest speed.
        fixed_radius_m: of mode ``fixed``: as set, or the reach plus S_p at worst.

    Raises:
        ConfigError: that goes past the horizon.
    """

    def __init__(
        self,
        settings: RiskSettings,
        tracker: RobotTracker,
        budget: DelayBudget,
        view: FieldOfView | None,
        horizon_s: float,
    ) -> None:
        self.tracker = tracker
        self.name = tracker.settings.name
        self.max_speed_m_s = tracker.settings.max_speed_m_s
        self._settings = settings
        self._in_time = settings.mode in ("predictive", "reactive")
        self._margins = margins(settings)
        self._budget = budget
        self._view = view
        self._horizon_s = horizon_s
        self._curve = StoppingCurve.of(tracker.model.stopping, self.max_speed_m_s)
        slowest_s = float(self._curve.time_s[-1])
        budget.check(self.name, slowest_s, horizon_s, settings.beyond_horizon)
        self._farthest_of = (0, 0.0)
        self._farthest_m: Floats = np.zeros((0, 0))
        reaction_s = budget.reaction_s(budget.stale_s, self.name)
        self.longest_s = reaction_s + slowest_s
        needed_m = float(self._curve.required_m(reaction_s, settings.clearance_m)[-1])
        self.fixed_radius_m = settings.fixed_radius_m or tracker.model.reach_m + needed_m

    def judge(self, now: RobotNow, bodies: BodyZones) -> Judgement:
        """Judge the robot as it is ``now`` against ``bodies``."""
        if now.q is None or now.qd is None or not _is_finite(now):
            reason = next(iter(now.reasons), Reason.ROBOT_STATE_INVALID)
            return Judgement(Demand.unknown(reason), None, False)
        motion = self._motion(now, now.q, now.qd, bodies)
        if motion is None:
            return Judgement(Demand.unknown(Reason.HORIZON_TOO_SHORT), None, False)
        people = self._people(motion, bodies) if len(bodies.zones.ids) else None
        unseen = None if self._view is None else self._unseen(motion, bodies.age_s, self._view)
        demand = Demand.nothing(self.max_speed_m_s)
        if people is not None:
            demand = demand | self._demand(people, _reason(people, bodies))
        if unseen is None:
            return Judgement(demand, people, False)
        out_of_view = self._demand(unseen, Reason.OUT_OF_VIEW)
        both = demand | out_of_view
        decides = both.reason is Reason.OUT_OF_VIEW
        return Judgement(both, people, decides)

    def where(self, people: Finding) -> str:
        """How far from what the person is that decides, for people."""
        if self._settings.mode == "fixed":
            return f"{max(people.slack_m + self.fixed_radius_m, 0.0):.2f} m from the base's axis"
        link = self.tracker.model.capsule_names[people.link]
        return f"{max(people.separation_m, 0.0):.2f} m from {link}"

    def _demand(self, finding: Finding, reason: Reason) -> Demand:
        return demand_of(finding, self._settings, self.max_speed_m_s, reason)

    def _motion(self, now: RobotNow, q: Floats, qd: Floats, bodies: BodyZones) -> _Motion | None:
        """The robot's motion, or ``None`` if its stop is not covered by the zones."""
        stopping_s, stopping_m = self.tracker.model.stopping(now.speed_m_s)
        until_braking_s = self._budget.after_now_s(self.name)
        end_s = until_braking_s + max(stopping_s, float(self._curve.time_s[-1]))
        times_s = bodies.zones.times_s
        if self._in_time:
            extend = self._settings.beyond_horizon
            reach_s = times_s[-1] if extend else min(times_s[-1], self._horizon_s - bodies.age_s)
            if end_s > reach_s + 1e-9:
                return None
            times_s = times_s[: int(np.searchsorted(times_s, end_s)) + 1]
        return _Motion(
            q=q,
            qd=qd,
            speed_m_s=now.speed_m_s,
            clearance_m=self._settings.clearance_m + now.uncertainty_m,
            capsules=now.capsules or self.tracker.model.capsules(q),
            stopping_s=stopping_s,
            stopping_m=stopping_m,
            times_s=times_s,
            until_braking_s=until_braking_s,
            on_plan=now.on_plan,
        )

    def _people(self, motion: _Motion, bodies: BodyZones) -> Finding:
        zones = bodies.zones.capsules
        steps = len(motion.times_s) if self._in_time else 1
        course = BodiesInTime(
            Capsules(zones.a[:, :steps], zones.b[:, :steps], zones.radius[:, :steps])
        )
        standing = course.nearest(_once(motion.capsules))
        distance = float(standing.distance[0])
        if not self._in_time:
            who = int(standing.person[0]), int(standing.segment[0]), int(standing.link[0])
            found = self._iso(distance, motion, bodies.age_s, who)
            return found if self._settings.mode == "iso" else self._fixed(found, motion, zones)

        def at_speeds(speeds_m_s: Floats) -> tuple[NearestInTime, Floats]:
            robot, stands_s = self._stopping(motion, speeds_m_s)
            return _later(course.nearest(robot)), stands_s

        ahead = at_speeds if motion.is_foreseen else None
        return self._over_time(Course(distance, _later(standing), ahead), motion)

    def _unseen(self, motion: _Motion, age_s: float, view: FieldOfView) -> Finding:
        """A person who stands just outside the field of view since the capture."""
        distance = float(view.distance_outside(motion.capsules).min())
        if not self._in_time:
            return self._iso(distance, motion, age_s, (-1, -1, -1))
        come = approach_m(motion.times_s[1:] + age_s)
        nobody = np.full(len(come), -1)
        standing = NearestInTime(distance - come, nobody, nobody, nobody)

        def at_speeds(speeds_m_s: Floats) -> tuple[NearestInTime, Floats]:
            robot, stands_s = self._stopping(motion, speeds_m_s)
            outside = view.distance_outside(robot).min(-1)[:, 1:]
            unknown = np.full(outside.shape, -1)
            return NearestInTime(outside - come, unknown, unknown, unknown), stands_s

        ahead = at_speeds if motion.is_foreseen else None
        return self._over_time(Course(distance, standing, ahead), motion)

    def _stopping(self, motion: _Motion, speeds_m_s: Floats) -> tuple[Capsules, Floats]:
        """(L, K+1, C) the robot as it goes on at each speed and stops, and (L,) when it stands.

        Along its plan where it is on it; else straight on in joint space.
        """
        plan = self.tracker.plan
        if plan is not None and motion.on_plan is not None:
            return plan.stopping_capsules(
                motion.on_plan, speeds_m_s, motion.times_s, motion.until_braking_s
            )
        times_s = np.interp(speeds_m_s, self._curve.speed_m_s, self._curve.time_s)
        times_s = np.where(speeds_m_s == motion.speed_m_s, motion.stopping_s, times_s)
        capsules = self.tracker.model.stopping_capsules(
            motion.q,
            motion.qd,
            motion.times_s,
            motion.until_braking_s,
            times_s,
            speeds_m_s / motion.speed_m_s,
            motion.speed_m_s,
        )
        return capsules, motion.until_braking_s + times_s

    def _iso(
        self, distance_m: float, motion: _Motion, age_s: float, who: tuple[int, int, int]
    ) -> Finding:
        return judge_iso(
            distance_m,
            motion.speed_m_s,
            (motion.stopping_s, motion.stopping_m),
            self._curve,
            self._budget.reaction_s(age_s, self.name),
            motion.clearance_m,
            self._margins,
            who,
        )

    def _fixed(self, found: Finding, motion: _Motion, zones: Capsules) -> Finding:
        """The circle around the base, and who is nearest to it."""
        base = self.tracker.model.base
        now = Capsules(zones.a[:, 0], zones.b[:, 0], zones.radius[:, 0])
        from_base = horizontal_distance(now, base)  # (P, S)
        person, segment = np.unravel_index(int(from_base.argmin()), from_base.shape)
        found = replace(found, person=int(person), segment=int(segment), link=0)
        return judge_fixed(
            found,
            float(from_base[person, segment]),
            self.fixed_radius_m,
            self.max_speed_m_s,
            self._margins,
            motion.speed_m_s,
        )

    def _over_time(self, course: Course, motion: _Motion) -> Finding:
        return judge_in_time(
            course,
            motion.times_s,
            motion.speed_m_s,
            (motion.stopping_s, motion.stopping_m),
            self._curve,
            motion.until_braking_s,
            motion.clearance_m,
            self._margins,
            self._farthest(len(motion.times_s), motion),
        )

    def _farthest(self, steps: int, motion: _Motion) -> Floats:
        """As ``separation.farthest``; the same tick after tick unless the steps change."""
        key = steps, motion.until_braking_s
        if key != self._farthest_of:
            self._farthest_of = key
            self._farthest_m = farthest(self._curve, motion.times_s, motion.until_braking_s)
        return self._farthest_m


def _reason(finding: Finding, bodies: BodyZones) -> Reason:
    if bodies.lost[finding.person]:
        return Reason.PERSON_LOST
    return Reason.PERSON_NEAR if finding.near else Reason.PERSON_APPROACHING


def _is_finite(now: RobotNow) -> bool:
    values = (now.q, now.qd, now.speed_m_s, now.uncertainty_m)
    return all(bool(np.isfinite(v).all()) for v in values if v is not None) and now.speed_m_s >= 0


def _once(capsules: Capsules) -> Capsules:
    """(C,) to (1, C): the same at every step."""
    return Capsules(capsules.a[None], capsules.b[None], capsules.radius[None])


def _later(nearest: NearestInTime) -> NearestInTime:
    """Without entry 0, the bodies as captured."""
    return NearestInTime(
        nearest.distance[..., 1:],
        nearest.person[..., 1:],
        nearest.segment[..., 1:],
        nearest.link[..., 1:],
    )
