"""The separation stage: computes distances between people and robots, and the permitted speeds.

It is a pure function of this tick's bodies and robots, without memory. It only measures; ``levels``
derives the advice from its findings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules
from hri_predict.protocol.messages import OperatingMode
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import FieldOfView, NamedZone
from hri_predict.risk.contact.clamping import anywhere_until
from hri_predict.risk.contact.judge import ContactJudge
from hri_predict.risk.contact.limits import FOLLOWS
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.backing_out import why_not_backing_out
from hri_predict.risk.separation.in_time import TimeByTime, farthest
from hri_predict.risk.separation.nearest import BodiesInTime
from hri_predict.risk.separation.now import by_circle, by_standard, wherever_it_is
from hri_predict.risk.separation.outlook import Outlook, outlooks
from hri_predict.risk.separation.unseen import beside_view
from hri_predict.risk.separation.warm_up import warm_up
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding, worst_of
from hri_predict.risk.types import NamedZoneState
from hri_predict.robots.mode_request import NOTHING_ASKED, ModeRequest
from hri_predict.robots.motion import RobotMotion
from hri_predict.robots.tracker import RobotNow
from hri_predict.zones.body_zones import BodyZones


@dataclass(frozen=True, slots=True)
class RobotFindings:
    """Findings for one robot from one tick's bodies.

    Attributes:
        unknown: why the situation is unknown; the other fields are then ``None``.
        people: finding for the people according to the mode; ``None`` if there are no people.
        standard: in mode ``predictive``, if the zones do not permit the highest speed: finding for
            the same people, using the separation distance of the standard where its assumptions
            hold, and the zones elsewhere (``BodyZones.as_assumed``). The milder of the two findings
            applies.
        contact: in mode ``hybrid``, in the same case: finding with permitted contact, for a robot
            that may touch people.
        wherever: for a robot with an unproven reported position: finding for the people and all
            positions that the robot can reach; ``None`` if it is proven, or no person is present.
        unseen: finding for unseen space; ``None`` if the sensor sees everything.
        speed_m_s: speed of the robot's fastest point.
        tool: number of the assumed tool; ``None``: no tool is named, or the worst case is assumed.
        asked: requests of the robot's controllers.
        not_backing_out: why the robot would not recede from all people if it backed out; "" if it
            would, or without a request.
        motion: the assumed motion of the robot; ``None`` if the situation is unknown.
    """

    unknown: tuple[Reason, ...] = ()
    people: Finding | None = None
    standard: Finding | None = None
    contact: Finding | None = None
    wherever: Finding | None = None
    unseen: Finding | None = None
    speed_m_s: float = 0.0
    tool: int | None = None
    asked: ModeRequest = NOTHING_ASKED
    not_backing_out: str = ""
    motion: RobotMotion | None = field(default=None, compare=False)

    @property
    def ways(self) -> dict[str, Finding | None]:
        """The findings for the people, by the rule that each of them follows."""
        return {"zones": self.people, "standard": self.standard, "contact": self.contact}

    @property
    def mildest(self) -> tuple[str, Finding | None]:
        """The finding for the people with the most slack, and its rule."""
        there = {name: way for name, way in self.ways.items() if way is not None}
        if not there:
            return "", None
        return max(there.items(), key=lambda way: way[1].slack_m)


@dataclass(frozen=True, slots=True)
class Findings:
    """Findings of the separation stage in one tick, by robot and by named zone."""

    robots: tuple[RobotFindings, ...]
    named: tuple[NamedZoneState, ...]


_AboutPeople = tuple[Finding, Finding | None, Finding | None]
"""``people``, ``standard`` and ``contact`` of ``RobotFindings``."""


class Separation:
    """The separation stage, called with bodies and robots.

    Args:
        settings: see ``RiskSettings``.
        robots: R of them; their owner replaces one that was measured to stop late, see
            ``revised``.
        named: the user's zones.
        view: space that the sensor sees; ``None``: everything.
        times_s: (K+1,) the zones' times, see ``Zones``.
        horizon_s: the forecast's last step after the capture.
        contact: contact judges, by index of the robot that may touch people.
    """

    def __init__(
        self,
        *,
        settings: RiskSettings,
        robots: Sequence[RobotConstants],
        named: Sequence[NamedZone],
        view: FieldOfView | None,
        times_s: Floats,
        horizon_s: float,
        contact: Mapping[int, ContactJudge] | None = None,
    ) -> None:
        self._settings = settings
        self._contact = contact or {}
        self._robots = robots
        self._named = named
        self._view = view
        self._times_s = times_s
        self._horizon_s = horizon_s
        self._farthest_m = [_farthest(r, times_s) for r in robots]

    def warm_up(self) -> None:
        """Compile the numba kernels before the first tick."""
        warm_up(self._robots, self._times_s)

    def revised(self, robot: int) -> None:
        """Take in the replaced constants of a robot, after it was measured to stop late."""
        revised = self._robots[robot]
        if robot in self._contact:
            self._contact[robot].revise(revised)
        self._farthest_m[robot] = _farthest(revised, self._times_s)

    def __call__(self, bodies: BodyZones, robots: Sequence[RobotNow]) -> Findings:
        """Compare all bodies with all robots.

        Args:
            bodies: all people. If ``bodies.untrusted``, people may be anywhere: every robot's
                situation is unknown, and every named zone is treated as occupied.
            robots: R present robot states.
        """
        if bodies.untrusted:
            return Findings(
                robots=tuple(
                    RobotFindings((*bodies.untrusted, *r.reasons), asked=r.asked) for r in robots
                ),
                named=tuple(NamedZoneState(z.settings.name, True, 0.0) for z in self._named),
            )
        named = tuple(zone.state(bodies) for zone in self._named)
        motions = [self._motion(i, now, bodies) for i, now in enumerate(robots)]
        known = {i: motion for i, motion in enumerate(motions) if isinstance(motion, RobotMotion)}
        about_people: dict[int, _AboutPeople] = {}
        if known and len(bodies.zones.ids):
            judge = {"iso": self._iso, "fixed": self._fixed}.get(
                self._settings.mode, self._over_time
            )
            about_people = dict(zip(known, judge(known, bodies), strict=True))
        found = [
            replace(
                self._found(i, motion, bodies, about_people.get(i, (None, None, None))),
                asked=robots[i].asked,
                not_backing_out=self._not_backing_out(i, robots[i], motion, bodies),
            )
            for i, motion in enumerate(motions)
        ]
        return Findings(tuple(found), named)

    def _found(
        self,
        robot: int,
        motion: RobotMotion | tuple[Reason, ...],
        bodies: BodyZones,
        about_people: tuple[Finding | None, Finding | None, Finding | None],
    ) -> RobotFindings:
        if not isinstance(motion, RobotMotion):
            return RobotFindings(unknown=motion)
        people, standard, contact = (_numbered(each, motion) for each in about_people)
        unseen, wherever = self._unseen(robot, motion, bodies), None
        if not motion.proven and len(bodies.zones.ids):
            wherever = wherever_it_is(self._robots[robot], motion, bodies)
        return RobotFindings(
            people=people,
            standard=standard,
            contact=contact,
            wherever=wherever,
            unseen=unseen,
            speed_m_s=motion.speed_m_s,
            tool=motion.tool,
            motion=motion,
        )

    def _not_backing_out(
        self,
        robot: int,
        now: RobotNow,
        motion: RobotMotion | tuple[Reason, ...],
        bodies: BodyZones,
    ) -> str:
        if now.asked.request is not OperatingMode.RECOVERY or not isinstance(motion, RobotMotion):
            return ""
        return why_not_backing_out(self._constants(robot, motion), now, motion, bodies)

    def _motion(
        self, robot: int, now: RobotNow, bodies: BodyZones
    ) -> RobotMotion | tuple[Reason, ...]:
        """Return the robot's motion, or the reasons why it is unknown."""
        if now.reasons:
            return now.reasons
        if not _is_known(now):
            return (Reason.ROBOT_STATE_INVALID,)
        constants, times_s = self._robots[robot].counting(now.tool), self._times_s
        stopping = constants.model.stopping(now.speed_m_s)
        if self._settings.judges_over_time:
            stop_s = max(stopping[0], float(constants.curve.time_s[-1]))
            end_s = constants.until_braking_s + stop_s
            reach_s = float(times_s[-1])
            if not self._settings.beyond_horizon:
                reach_s = min(reach_s, self._horizon_s - bodies.age_s)
            if end_s > reach_s + 1e-9:
                return (Reason.HORIZON_TOO_SHORT,)
            times_s = times_s[: int(times_s.searchsorted(end_s)) + 1]
        return RobotMotion.of(
            now,
            stopping=stopping,
            model=constants.model,
            curve=constants.curve,
            plan=constants.plan,
            clearance_m=self._settings.clearance_m,
            times_s=times_s,
            until_braking_s=constants.until_braking_s,
        )

    def _iso(self, motions: Mapping[int, RobotMotion], bodies: BodyZones) -> list[_AboutPeople]:
        return [
            (by_standard(self._constants(i, m), m, bodies), None, None) for i, m in motions.items()
        ]

    def _fixed(self, motions: Mapping[int, RobotMotion], bodies: BodyZones) -> list[_AboutPeople]:
        return [(by_circle(self._robots[i], m, bodies), None, None) for i, m in motions.items()]

    def _over_time(
        self, motions: Mapping[int, RobotMotion], bodies: BodyZones
    ) -> list[_AboutPeople]:
        """Assess all robots; also with the standard and with contact, if that may permit more."""
        judging = [self._time_by_time(i, motion) for i, motion in motions.items()]
        people = BodiesInTime(bodies.zones.capsules, bodies.toward)
        found = outlooks(list(motions.values()), judging, people)
        result: list[_AboutPeople] = []
        for (i, motion), judge, outlook in zip(motions.items(), judging, found, strict=True):
            standard = contact = None
            if self._may_permit_more(self._constants(i, motion), outlook.finding):
                standard = self._milder(
                    robot=i, motion=motion, judging=judge, bodies=bodies, outlook=outlook
                )
                if i in self._contact:
                    others = self._others(i, motions, float(motion.times_s[-1]))
                    contact = self._contact[i](motion, bodies, outlook.finding, others)
            result.append((outlook.finding, standard, contact))
        return result

    def _others(
        self, robot: int, motions: Mapping[int, RobotMotion], until_s: float
    ) -> list[Capsules | None]:
        """Return the space that other robots may occupy by then; ``None``: unknown or too fast."""
        result: list[Capsules | None] = []
        for i in range(len(self._robots)):
            if i == robot:
                continue
            is_known = i in motions and motions[i].proven
            other = self._constants(i, motions[i]) if is_known else None
            if other is not None and motions[i].speed_m_s <= FOLLOWS * other.max_speed_m_s:
                known = motions[i]
                moved_m = known.clearance_m - self._settings.clearance_m
                uncertain_m = moved_m + self._settings.robot_uncertainty_m
                fastest_m_s = max(other.max_speed_m_s, known.speed_m_s)
                result.append(anywhere_until(known, fastest_m_s, until_s, uncertain_m))
            else:
                result.append(None)
        return result

    def _milder(
        self,
        *,
        robot: int,
        motion: RobotMotion,
        judging: TimeByTime,
        bodies: BodyZones,
        outlook: Outlook,
    ) -> Finding | None:
        """Apply the standard to people who move as it assumes, and zones to all others.

        For each person one valid argument is used, and the robot meets the demands for all people.
        ``None``: no person moves as assumed.
        """
        assumed = np.flatnonzero(bodies.as_assumed)
        if not assumed.size:
            return None
        constants = self._constants(robot, motion)
        others = np.flatnonzero(~bodies.as_assumed)
        if not others.size:
            standing = outlook.standing
            return by_standard(constants, motion, bodies, standing=standing, by_motion=False)
        relaxed = by_standard(constants, motion, bodies, who=assumed, by_motion=False)
        zones = bodies.zones.capsules
        some = zones[others]
        toward = bodies.toward
        if toward is not None:
            toward = toward.of(others[others < len(toward.extra)])
        (by_zones,) = outlooks([motion], [judging], BodiesInTime(some, toward))
        kept = by_zones.finding
        return worst_of([relaxed, replace(kept, person=int(others[kept.person]))])

    def _may_permit_more(self, robot: RobotConstants, found: Finding) -> bool:
        """Whether the standard's separation, or contact, may permit more than the zones do.

        Zones that are not finite are a fault: the distance must not replace them.
        """
        if not self._settings.uses_forecasts or not isfinite(found.slack_m):
            return False
        is_free = min(found.limits) >= robot.max_speed_m_s
        return not (is_free and found.slack_m >= self._settings.band_m)

    def _unseen(self, robot: int, motion: RobotMotion, bodies: BodyZones) -> Finding | None:
        if self._view is None:
            return None
        judging = None
        if self._settings.judges_over_time:
            judging = self._time_by_time(robot, motion)
        return beside_view(
            self._constants(robot, motion),
            motion,
            self._view,
            age_s=bodies.age_s,
            judging=judging,
            margin_m=max(self._settings.region_margins_m.values(), default=0.0),
        )

    def _time_by_time(self, robot: int, motion: RobotMotion) -> TimeByTime:
        constants = self._constants(robot, motion)
        return TimeByTime(
            times_s=motion.times_s,
            speed_m_s=motion.speed_m_s,
            stopping=(motion.stopping_s, motion.stopping_m),
            curve=constants.curve,
            reaction_s=constants.until_braking_s,
            clearance_m=motion.clearance_m,
            margins_m=self._settings.margins_m,
            farthest_m=self._farthest_m[robot][motion.tool][: len(motion.times_s) - 1],
        )

    def _constants(self, robot: int, motion: RobotMotion) -> RobotConstants:
        """Return the constants of a robot with the tool assumed in its motion."""
        return self._robots[robot].counting(motion.tool)


def _farthest(robot: RobotConstants, times_s: Floats) -> dict[int | None, Floats]:
    """Return maximum travel by tool number and for the worst case; see ``in_time.farthest``."""
    return {
        tool: farthest(robot.counting(tool).curve, times_s, robot.until_braking_s)
        for tool in (None, *robot.tools)
    }


def _numbered(found: Finding | None, motion: RobotMotion) -> Finding | None:
    """Return the finding with the capsule's index over all tools, as used in Advice."""
    numbering = motion.model.numbering
    if found is None or numbering is None or found.link < 0:
        return found
    return replace(found, link=int(numbering[found.link]))


def _is_known(now: RobotNow) -> bool:
    if now.q is None or now.qd is None:
        return False
    values = (*now.q.tolist(), *now.qd.tolist(), now.speed_m_s, now.uncertainty_m)
    return all(map(isfinite, values)) and now.speed_m_s >= 0
