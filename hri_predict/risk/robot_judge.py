"""One robot against everybody: what the people, and what the sensor does not see, ask of it."""

from dataclasses import dataclass, replace

import numpy as np

from hri_predict.errors import ConfigError
from hri_predict.reasons import Reason
from hri_predict.risk.areas import FieldOfView, approach_m
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.geometry import horizontal_distance
from hri_predict.risk.levels import Demand, demand_of, margins
from hri_predict.risk.nearest_in_time import BodiesInTime, NearestInTime, nearest_in_time
from hri_predict.risk.outlook import Outlook, outlooks
from hri_predict.risk.retreat import retreat_steps
from hri_predict.risk.robot import RobotModel, RobotSettings
from hri_predict.risk.robot_motion import RobotMotion
from hri_predict.risk.robot_tracker import RobotNow, RobotTracker
from hri_predict.risk.separation import (
    Finding,
    ProtectiveDistance,
    StoppingCurve,
    protective_distance,
    worst_of,
)
from hri_predict.risk.separation_in_time import Course, TimeByTime, farthest
from hri_predict.risk.separation_now import judge_fixed, judge_iso, judge_retreat
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.types import Capsules
from hri_predict.risk.zones import BodyZones
from hri_predict.scene import Bools, Floats


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
        in_time: whether it judges by zones over time: modes ``predictive`` and ``reactive``.
        longest_s: T_r + T_s at worst: input almost stale, highest speed.
        fixed_radius_m: of mode ``fixed``: as set, or the reach plus S_p at worst.

    Raises:
        ConfigError: that goes past the horizon, or the circle is smaller than the robot.
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
        self.in_time = settings.mode in ("predictive", "reactive")
        self._margins = margins(settings)
        self._budget = budget
        self._view = view
        self._horizon_s = horizon_s
        self._curve = StoppingCurve.of(tracker.model.stopping, self.max_speed_m_s)
        slowest_s = float(self._curve.time_s[-1])
        budget.check(self.name, slowest_s, horizon_s, settings.beyond_horizon)
        self._farthest_of = (0, 0.0)
        self._farthest_m: Floats = np.zeros((0, 0))
        self.longest_s = budget.reaction_s(budget.stale_s, self.name) + slowest_s
        reach_m = tracker.model.reach_m
        self.fixed_radius_m = settings.fixed_radius_m or reach_m + self._needed_m()
        if settings.mode == "fixed" and self.fixed_radius_m < reach_m:
            raise ConfigError(
                f"risk.fixed_radius_m: {self.fixed_radius_m:g} m is less than robot {self.name}"
                f" reaches, {reach_m:.2f} m; give more, or leave it out"
            )

    def judge(
        self,
        now: RobotNow,
        bodies: BodyZones,
        human_m_s: Floats | None = None,
        outlook: Outlook | None = None,
    ) -> Judgement:
        """Judge the robot as it is ``now`` against ``bodies``.

        Args:
            now: where it is.
            bodies: the people.
            human_m_s: (P,) of who is faster than the standard assumes, 0 of the others, in the
                order of ``bodies`` as far as it goes; ``None``: nobody is.
            outlook: its own, where all robots' were found together; see ``outlooks``.
        """
        motion = outlook.motion if outlook is not None else self.motion(now, bodies)
        if motion is None:
            reason = next(iter(now.reasons), Reason.ROBOT_STATE_INVALID)
            if _is_known(now):
                reason = Reason.HORIZON_TOO_SHORT
            return Judgement(Demand.unknown(reason), None, False)
        people, demand = None, Demand.nothing(self.max_speed_m_s)
        if len(bodies.zones.ids):
            fast = np.zeros(0) if human_m_s is None else human_m_s
            if self.in_time and outlook is None:
                judging = self.time_by_time(motion)
                (outlook,) = outlooks([motion], [judging], BodiesInTime(bodies.zones.capsules))
            people, demand = self._of_people(motion, bodies, fast, outlook)
        unseen = None if self._view is None else self._unseen(motion, bodies.age_s, self._view)
        if unseen is None:
            return Judgement(demand, people, False)
        out_of_view = self._demand(unseen, Reason.OUT_OF_VIEW)
        both = demand | out_of_view
        decides = both.reason is Reason.OUT_OF_VIEW
        return Judgement(both, people, decides)

    def _of_people(
        self,
        motion: RobotMotion,
        bodies: BodyZones,
        human_m_s: Floats,
        outlook: Outlook | None,
    ) -> tuple[Finding, Demand]:
        """What the people ask for, and the finding that it rests on.

        ``predictive`` asks for what the milder of two asks: the zones over time, and the standard's
        separation. Either keeps the robot away by itself, as long as what it assumes holds.
        """
        if outlook is None:
            found = self._now(motion, bodies, human_m_s)
            return found, self._demand(found, _reason(found, bodies))
        found = outlook.finding
        demand = self._demand(found, _reason(found, bodies))
        free = demand == Demand.nothing(self.max_speed_m_s)
        # zones that are no numbers are a fault, not a reason to look at the distance instead
        if self._settings.mode != "predictive" or free or not np.isfinite(found.slack_m):
            return found, demand
        now = self._now(motion, bodies, human_m_s, outlook.standing)
        by_standard = self._demand(now, _reason(now, bodies))
        both = demand.milder(by_standard)
        rests_on_zones = (both.level, both.limit_m_s) == (demand.level, demand.limit_m_s)
        return (found if rests_on_zones else now), both

    def where(self, people: Finding) -> str:
        """How far from what the person is that decides, for people."""
        if self._settings.mode == "fixed":
            return f"{max(people.slack_m + self.fixed_radius_m, 0.0):.2f} m from the base's axis"
        link = self.tracker.model.capsule_names[people.link]
        return f"{max(people.separation_m, 0.0):.2f} m from {link}"

    def _demand(self, finding: Finding, reason: Reason) -> Demand:
        return demand_of(finding, self._settings, self.max_speed_m_s, reason)

    def motion(self, now: RobotNow, bodies: BodyZones) -> RobotMotion | None:
        """The robot's motion; ``None``: it is not known, or zones end before the robot stands."""
        if not _is_known(now):
            return None
        until_braking_s = self._budget.after_now_s(self.name)
        stopping = self.tracker.model.stopping(now.speed_m_s)
        end_s = until_braking_s + max(stopping[0], float(self._curve.time_s[-1]))
        times_s = bodies.zones.times_s
        if self.in_time:
            extend = self._settings.beyond_horizon
            reach_s = times_s[-1] if extend else min(times_s[-1], self._horizon_s - bodies.age_s)
            if end_s > reach_s + 1e-9:
                return None
            times_s = times_s[: int(np.searchsorted(times_s, end_s)) + 1]
        return RobotMotion.of(
            now,
            stopping,
            self.tracker.model,
            self._curve,
            self.tracker.plan,
            self._settings.clearance_m,
            times_s,
            until_braking_s,
        )

    def time_by_time(self, motion: RobotMotion) -> TimeByTime:
        """How it is judged in the modes ``predictive`` and ``reactive``."""
        return TimeByTime(
            motion.times_s,
            motion.speed_m_s,
            (motion.stopping_s, motion.stopping_m),
            self._curve,
            motion.until_braking_s,
            motion.clearance_m,
            self._margins,
            self._farthest(len(motion.times_s), motion),
        )

    def _now(
        self,
        motion: RobotMotion,
        bodies: BodyZones,
        human_m_s: Floats,
        standing: NearestInTime | None = None,
    ) -> Finding:
        """By the distance now: everybody together, and who is fast by themselves.

        Beside zones over time (``standing`` is what they found for now) no retreat is looked for:
        they see it themselves.
        """
        zones, iso = bodies.zones.capsules, self._settings.mode != "fixed"
        found = []
        for fast in (None, *np.flatnonzero(human_m_s > 0)) if iso else (None,):
            who = slice(None) if fast is None else slice(fast, fast + 1)
            near = standing
            if near is None or fast is not None:
                people = Capsules(zones.a[who, :1], zones.b[who, :1], zones.radius[who, :1])
                near = nearest_in_time(people, _once(motion.capsules))
            person = int(near.person[0]) + (fast or 0)
            speed = 0.0 if fast is None else float(human_m_s[fast])
            deciding = person, int(near.segment[0]), int(near.link[0])
            alone = self._iso(float(near.distance[0]), motion, bodies.age_s, deciding, speed)
            if standing is None:
                alone = self._retreating(alone, motion, zones, bodies.age_s, speed)
            found.append(alone)
        return worst_of(found) if iso else self._fixed(found[0], motion, zones, human_m_s)

    def _retreating(
        self, found: Finding, motion: RobotMotion, zones: Capsules, age_s: float, human_m_s: float
    ) -> Finding:
        """The same, where the robot gets away from everybody while it goes on and stops."""
        free = found.slack_m >= 0 and min(found.limits[:2]) >= self.max_speed_m_s
        if self._settings.mode == "fixed" or free or not motion.is_foreseen:
            return found
        people = Capsules(zones.a[:, 0], zones.b[:, 0], zones.radius[:, 0])

        def retreats(speeds_m_s: Floats) -> Bools:
            ends = motion.ends_at(speeds_m_s)
            farthest_end = float(ends.max())
            steps = retreat_steps(people, motion.at_places(farthest_end, len(motion.times_s)))
            part = steps / (len(motion.times_s) - 1)
            until = motion.place + part * (farthest_end - motion.place)
            return ends <= until + 1e-12

        return judge_retreat(
            found,
            retreats,
            motion.speed_m_s,
            motion.stopping_s,
            self._curve,
            self._budget.reaction_s(age_s, self.name),
            motion.clearance_m,
            self._margins,
            human_m_s,
        )

    def _unseen(self, motion: RobotMotion, age_s: float, view: FieldOfView) -> Finding:
        """A person who stands just outside the field of view since the capture."""
        distance = float(view.distance_outside(motion.capsules).min())
        if not self.in_time:
            return self._iso(distance, motion, age_s)
        come = approach_m(motion.times_s[1:] + age_s)
        nobody = np.full(len(come), -1)
        standing = NearestInTime(distance - come, nobody, nobody, nobody)

        def at_speeds(speeds_m_s: Floats, enough_m: Floats) -> NearestInTime:
            robot, until = motion.stopping_at(speeds_m_s)
            outside = view.distance_outside(robot).min(-1)[:, 1:] - come
            counts = np.arange(1, len(come) + 1) <= until[:, None]
            least = np.minimum(np.where(counts, outside, np.inf).min(1), enough_m)
            unknown = np.full(len(least), -1)
            return NearestInTime(least, unknown, unknown, unknown)

        ahead = at_speeds if motion.is_foreseen else None
        return self.time_by_time(motion).judged(Course(distance, standing, ahead))

    def _iso(
        self,
        distance_m: float,
        motion: RobotMotion,
        age_s: float,
        who: tuple[int, int, int] = (-1, -1, -1),
        human_m_s: float = 0.0,
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
            human_m_s,
        )

    def _fixed(
        self, found: Finding, motion: RobotMotion, zones: Capsules, human_m_s: Floats
    ) -> Finding:
        """The circle around the base, and who is nearest to it; wider for who is fast."""
        now = Capsules(zones.a[:, 0], zones.b[:, 0], zones.radius[:, 0])
        from_base = horizontal_distance(now, self.tracker.model.base)  # (P, S)
        from_base[: len(human_m_s)] -= self._wider_m(human_m_s)[:, None]
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

    def _wider_m(self, human_m_s: Floats) -> Floats:
        """(P,) how much farther they come than the standard assumes until the robot stands."""
        worst = self._needed_m()
        return np.array([self._needed_m(float(v)) - worst if v > 0 else 0.0 for v in human_m_s])

    def _needed_m(self, human_m_s: float = 0.0) -> float:
        """S_p at the highest speed and the longest delay."""
        tracker, budget = self.tracker, self._budget
        return worst_distance(
            self._settings, tracker.settings, tracker.model, budget, human_m_s
        ).total

    def _farthest(self, steps: int, motion: RobotMotion) -> Floats:
        """As ``separation.farthest``; the same tick after tick unless the steps change."""
        key = steps, motion.until_braking_s
        if key != self._farthest_of:
            self._farthest_of = key
            self._farthest_m = farthest(self._curve, motion.times_s, motion.until_braking_s)
        return self._farthest_m


def worst_distance(
    settings: RiskSettings,
    robot: RobotSettings,
    model: RobotModel,
    budget: DelayBudget,
    human_m_s: float = 0.0,
) -> ProtectiveDistance:
    """S_p at a robot's highest speed and the longest delay, term by term."""
    return protective_distance(
        robot.max_speed_m_s,
        budget.reaction_s(budget.stale_s, robot.name),
        *model.stopping(robot.max_speed_m_s),
        intrusion_m=settings.intrusion_m,
        person_uncertainty_m=settings.person_uncertainty_m,
        robot_uncertainty_m=settings.robot_uncertainty_m,
        human_m_s=human_m_s,
    )


def _reason(finding: Finding, bodies: BodyZones) -> Reason:
    if bodies.lost[finding.person]:
        return Reason.PERSON_LOST
    return Reason.PERSON_NEAR if finding.near else Reason.PERSON_APPROACHING


def _is_known(now: RobotNow) -> bool:
    if now.q is None or now.qd is None:
        return False
    values = (now.q, now.qd, now.speed_m_s, now.uncertainty_m)
    return all(bool(np.isfinite(v).all()) for v in values) and now.speed_m_s >= 0


def _once(capsules: Capsules) -> Capsules:
    """(C,) to (1, C): the same at every step."""
    return Capsules(capsules.a[None], capsules.b[None], capsules.radius[None])
