"""The levels stage: determines each robot's advice and its reason from the findings.

Its only memory is one ``LevelMachine`` and one ``SteadyReason`` per robot.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hri_predict.base.arrays import Ints
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Advice, Level, OperatingMode
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZone, NamedZoneSettings
from hri_predict.risk.levels.demand import Demand, combined, demand_of
from hri_predict.risk.levels.detail import detail_of
from hri_predict.risk.levels.latches import LatchIds, causes_now, recall, remembered
from hri_predict.risk.levels.machine import Advised, LevelMachine
from hri_predict.risk.levels.modes import Decision, Modes, Situation
from hri_predict.risk.levels.muted_time import MutedTime
from hri_predict.risk.levels.set_chooser import SetChooser
from hri_predict.risk.levels.steady_reason import SteadyReason
from hri_predict.risk.permitted import NEAR_M
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import Findings, RobotFindings
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding
from hri_predict.risk.types import NamedZoneState
from hri_predict.zones.body_zones import BodyZones


class Levels:
    """The levels stage, called with findings.

    Args:
        settings: see ``RiskSettings``.
        robots: the R robots.
        named: the user's zones.
        horizon_s: maximum time ahead of a breach included in the advice.
        segment_index: skeleton index of each segment of the zones.
        last_latch_id: see ``LatchIds``.
    """

    def __init__(
        self,
        *,
        settings: RiskSettings,
        robots: Sequence[RobotConstants],
        named: Sequence[NamedZone],
        horizon_s: float,
        segment_index: Ints,
        last_latch_id: int | None = None,
    ) -> None:
        self._robots = robots
        self._named = named
        self._horizon_s = horizon_s
        self._segment_index = segment_index
        self._settings = settings
        self.sets = SetChooser(settings.sets, [zone.settings for zone in named])
        ids = LatchIds(last_latch_id)
        self._machines = tuple(LevelMachine(settings, r.max_speed_m_s, ids) for r in robots)
        self._modes = tuple(Modes(r.robot.modes, r.name, r.max_speed_m_s) for r in robots)
        # about the data that an earlier run left, until the robot's latch is released
        self._notes = [""] * len(robots)
        for machine in self._machines:
            machine.latch("start")
        self._reasons = tuple(SteadyReason(settings.release_captures) for _ in robots)

    def __call__(
        self,
        snapshot: PeopleSnapshot,
        bodies: BodyZones,
        findings: Findings,
        remarks: Sequence[Sequence[Reason]] | None = None,
    ) -> tuple[Advice, ...]:
        """Advise every robot.

        Args:
            snapshot: this tick's snapshot, which provides the time and the number of captures.
            bodies: the bodies on which the findings are based.
            findings: see ``Separation``.
            remarks: for each robot, its deviations from the advice. A robot that was too fast is no
                longer slowed: it runs or is stopped, and it may not touch any person.
        """
        self.sets.update(snapshot.now_ns)
        return tuple(
            self._advise(
                robot=robot,
                snapshot=snapshot,
                bodies=bodies,
                findings=findings,
                remarks=remarks[robot] if remarks else (),
            )
            for robot in range(len(self._robots))
        )

    def acknowledge(self, latch_id: int, down_ns: int = 0) -> bool:
        """Release the latch ``latch_id``; see ``LevelMachine``. Return whether it was released."""
        for robot, machine in enumerate(self._machines):  # a number is of one latch
            if machine.acknowledge(latch_id, down_ns):
                self._notes[robot] = ""
                return True
        return False

    def remember(self) -> dict[str, Any]:
        """Return the latches and the muted time not yet recovered, for a restart of the node."""
        times = self._muted_times().items()
        muted = {name: time.used_s for name, time in times if time.used_s}
        return {**remembered(self._by_name()), **({"muted_s": muted} if muted else {})}

    def recall(self, data: Mapping[str, Any]) -> None:
        """Restore the state of an earlier run; see ``latches.recall``."""
        recall(self._by_name(), data)
        muted, times = data.get("muted_s", {}), self._muted_times()
        for name in times.keys() & muted.keys():
            times[name].recall(muted[name])

    def distrust(self, why: str) -> None:
        """Latch for every configured cause, because an earlier run's data is unreadable or too old.

        ``why`` goes into the detail of the advice until the latch is acknowledged.
        """
        self._notes = [why] * len(self._robots)
        for time in self._muted_times().values():
            time.use_up()
        for machine in self._machines:
            for cause in self._settings.latch:
                machine.latch(cause)

    def _by_name(self) -> dict[str, LevelMachine]:
        return {r.name: m for r, m in zip(self._robots, self._machines, strict=True)}

    def _muted_times(self) -> dict[str, MutedTime]:
        """Return the muted time by robot, where muting is allowed."""
        pairs = zip(self._robots, self._modes, strict=True)
        return {r.name: m.muted_time for r, m in pairs if m.muted_time is not None}

    def reset(self) -> None:
        """Forget everything that supports a release, after a failed tick."""
        for machine in self._machines:
            machine.reset()
        for modes in self._modes:
            modes.reset()

    @property
    def mode_counters(self) -> Counter[str]:
        """Return how often each operating mode started and was refused, over all robots."""
        return sum((modes.counters for modes in self._modes), Counter())

    def limit_m_s(
        self, robot: int, snapshot: PeopleSnapshot, bodies: BodyZones, findings: Findings
    ) -> float:
        """Return only the speed limit of one robot's advice, m/s, without any text.

        It advances that robot's tick: call either this or the stage itself.
        """
        self.sets.update(snapshot.now_ns)
        found = findings.robots[robot]
        demand = self._demand(robot, found, bodies, findings.named)[0]
        demand = self._decide(robot, demand, found, snapshot.now_ns).demand
        return self._advance(robot, snapshot, bodies, demand).limit_m_s

    def asked_m_s(self, robot: int, bodies: BodyZones, findings: Findings) -> float:
        """Return the limit that these findings require, m/s; memory can only lower it."""
        return self._demand(robot, findings.robots[robot], bodies, findings.named)[0].limit_m_s

    def _advance(
        self,
        robot: int,
        snapshot: PeopleSnapshot,
        bodies: BodyZones,
        demand: Demand,
        *,
        muted: Demand | None = None,
    ) -> Advised:
        return self._machines[robot].update(
            demand,
            snapshot.captures,
            snapshot.now_ns,
            causes_now(snapshot, bodies.untrusted),
            lost=snapshot.to_acknowledge,
            cap_m_s=self.sets.in_force.max_speed_m_s,
            muted=muted,
        )

    def _advise(
        self,
        *,
        robot: int,
        snapshot: PeopleSnapshot,
        bodies: BodyZones,
        findings: Findings,
        remarks: Sequence[Reason],
    ) -> Advice:
        found, too_fast = findings.robots[robot], Reason.ROBOT_TOO_FAST in remarks
        if too_fast:  # who may be touched at a limit that the robot does not keep?
            found = replace(found, contact=None)
        natural, people = self._demand(robot, found, bodies, findings.named)
        decision = self._decide(robot, natural, found, snapshot.now_ns)
        demand = decision.demand
        if too_fast:
            demand = demand.full_or_stop(Reason.ROBOT_TOO_FAST)
        muted = natural if decision.mode is OperatingMode.MUTED else None
        advised = self._advance(robot, snapshot, bodies, demand, muted=muted)
        reason = advised.reason
        if reason is Reason.NONE and bodies.speeds.unknown.any():
            reason = Reason.SPEED_UNKNOWN
        elif reason is Reason.NONE and bodies.speeds.fast.any():
            reason = Reason.PERSON_FAST
        elif reason is Reason.NONE and (bodies.reasons or remarks):
            reason = (*bodies.reasons, *remarks)[0]
        reason = self._reasons[robot].update(advised.level, reason, snapshot.captures)
        who = people if people is not None and natural.reason.row.by_distance else None
        by_zones = {}
        if demand.reason in (Reason.ZONE_OCCUPIED, Reason.ZONE_ENTRY_PREDICTED):
            by_zones = self._by_zones(robot, findings.named)
        detail = detail_of(
            self._robots[robot],
            bodies,
            [name for name, by in by_zones.items() if by.reason is demand.reason],
            demand=demand,
            advised=advised,
            reason=reason,
            who=who,
            found=found,
        )
        named = dict.fromkeys(doubt.text for doubt in snapshot.doubts)
        return Advice(
            robot=robot,
            level=advised.level,
            reason=reason,
            latch_id=advised.latch_id,
            separation_m=None if people is None else _wire_m(people.separation_m),
            predicted_separation_m=None if people is None else _wire_m(people.predicted_m),
            time_to_breach_s=self._breach_s(people),
            speed_limit_m_s=advised.limit_m_s,
            body_part=None if who is None else int(self._segment_index[who.segment]),
            robot_link=None if who is None else who.link,
            capture_ns=bodies.capture_ns,
            tool=findings.robots[robot].tool,
            mode=decision.mode,
            detail="; ".join(filter(None, (decision.note, detail, *named)))
            + self._latched(robot, advised),
        )

    def _decide(self, robot: int, demand: Demand, found: RobotFindings, now_ns: int) -> Decision:
        """Return the operating mode, and its replacement for the demand."""
        constants, unseen = self._robots[robot], found.unseen
        beside_unseen = unseen is not None and (
            demand_of(unseen, constants.risk, constants.max_speed_m_s, Reason.OUT_OF_VIEW).level
            is Level.STOP
        )
        situation = Situation(
            asked=found.asked,
            demand=demand,
            is_known=not found.unknown and self.sets.in_force.is_known,
            beside_unseen=beside_unseen,
            not_backing_out=found.not_backing_out,
        )
        return self._modes[robot].decide(situation, now_ns)

    def _demand(
        self,
        robot: int,
        found: RobotFindings,
        bodies: BodyZones,
        named: Sequence[NamedZoneState],
    ) -> tuple[Demand, Finding | None]:
        """Return this tick's demand on a robot, and the finding about people behind it."""
        constants = self._robots[robot]
        demand, people = asked_of(constants, found, bodies)
        if not self.sets.in_force.is_known:
            return Demand.unknown(Reason.SET_UNKNOWN), people
        if found.unknown:
            return demand, people
        by_zones = self._by_zones(robot, named).values()
        return combined([demand, *by_zones], constants.max_speed_m_s), people

    def _by_zones(self, robot: int, named: Sequence[NamedZoneState]) -> dict[str, Demand]:
        """Return the demands of named zones on a robot, by zone; zones that ask nothing have
        none."""
        constants = self._robots[robot]
        demands = {
            state.name: zone_demand(zone.settings, state, constants.name, constants.max_speed_m_s)
            for zone, state in zip(self._named, named, strict=True)
            if self.sets.in_force.asks(state.name)
        }
        return {name: demand for name, demand in demands.items() if demand.reason}

    def _breach_s(self, people: Finding | None) -> float | None:
        if people is None or people.breach_s > self._horizon_s:
            return None
        return people.breach_s

    def _latched(self, robot: int, advised: Advised) -> str:
        """Return what to acknowledge and the causes of a latch, as text; "" if there are none."""
        number = f" {advised.latch_id}" if advised.latch_id else ""
        if not advised.causes:
            unseen = f"; people may be present unseen: check, then acknowledge latch id{number}"
            return unseen if number else ""
        note = f" ({self._notes[robot]})" if self._notes[robot] else ""
        if not number and self._settings.restart == "supervised":
            note += ", which requires that the level would otherwise be clear"
        return f"; latch{number}: {', '.join(advised.causes)}{note}"


def asked_of(
    robot: RobotConstants, found: RobotFindings, bodies: BodyZones
) -> tuple[Demand, Finding | None]:
    """Return the demand from people and unseen space on a robot, and the deciding finding.

    Mode ``predictive`` uses the milder of two demands: from the zones over time, and from the
    separation distance of the standard for people who move as the standard assumes. Each demand
    protects these people. Only the zones protect all others (``Separation``).
    """
    risk, max_speed_m_s = robot.risk, robot.max_speed_m_s
    if found.unknown:
        return combined([Demand.unknown(r) for r in found.unknown], max_speed_m_s), None

    def asked(finding: Finding) -> Demand:
        return demand_of(finding, risk, max_speed_m_s, _reason(finding, bodies))

    people, demand = found.people, Demand.nothing(max_speed_m_s)
    if people is not None:
        demand = asked(people)
        if found.standard is not None:
            by_zones, demand = demand, demand.milder(asked(found.standard))
            if (demand.level, demand.limit_m_s) != (by_zones.level, by_zones.limit_m_s):
                people = found.standard
        if found.contact is not None:
            demand, people = _with_contact(found.contact, robot, demand, people)
    if found.wherever is not None:
        by_reach = demand_of(found.wherever, risk, max_speed_m_s, Reason.ROBOT_STATE_FROZEN)
        demand = by_reach | demand
    if found.unseen is not None:
        demand = demand | demand_of(found.unseen, risk, max_speed_m_s, Reason.OUT_OF_VIEW)
    return demand, people


def _with_contact(
    contact: Finding, robot: RobotConstants, apart: Demand, people: Finding
) -> tuple[Demand, Finding]:
    """Return the milder of two demands and the deciding finding; ``apart`` is without contact.

    If neither permits motion, the finding names the part that may not be touched.
    """
    touching = demand_of(contact, robot.risk, robot.max_speed_m_s, Reason.CONTACT_POSSIBLE)
    touching = touching.at_least(Level.WARN, Reason.CONTACT_POSSIBLE)
    demand = apart.milder(touching)
    if (demand.level, demand.limit_m_s) != (apart.level, apart.limit_m_s):
        return demand, contact
    if demand.level is Level.STOP:
        return demand, replace(
            people,
            person=contact.person,
            segment=contact.segment,
            link=contact.link,
            pair_m=contact.pair_m,
        )
    return demand, people


def _reason(finding: Finding, bodies: BodyZones) -> Reason:
    if bodies.lost[finding.person]:
        return Reason.PERSON_LOST
    if bodies.speeds.unknown[finding.person] and finding.separation_m > NEAR_M:
        return Reason.SPEED_UNKNOWN
    return Reason.PERSON_NEAR if finding.near else Reason.PERSON_APPROACHING


def _wire_m(distance_m: float) -> float:
    """Return a distance for the wire: at least 0, and 0 if not finite."""
    return max(0.0, distance_m) if math.isfinite(distance_m) else 0.0


_LEVELS = {"warn": Level.WARN, "slow": Level.SLOW, "stop": Level.STOP}


def zone_demand(
    zone: NamedZoneSettings, state: NamedZoneState, robot: str, max_speed_m_s: float
) -> Demand:
    """Return the demand of ``zone`` on ``robot`` in this state."""
    asked = not zone.robots or robot in zone.robots
    soon = state.entry_s is not None and state.entry_s <= zone.entry_warning_s
    entering = soon and zone.entry_warning_s > 0
    if zone.level == "none" or not asked or not (state.occupied or entering):
        return Demand.nothing(max_speed_m_s)
    level = _LEVELS[zone.level]
    limit = {
        Level.WARN: max_speed_m_s,
        Level.SLOW: min(zone.speed_limit_m_s, max_speed_m_s),
    }.get(level, 0.0)
    reason = Reason.ZONE_OCCUPIED if state.occupied else Reason.ZONE_ENTRY_PREDICTED
    return Demand(
        level=level, release=level, limit_m_s=limit, release_limit_m_s=limit, reason=reason
    )
