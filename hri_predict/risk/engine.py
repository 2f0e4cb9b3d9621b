"""The risk engine: forecast in, one advice per robot out."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hri_predict.errors import ConfigError, nearest
from hri_predict.predictors.base import Forecast
from hri_predict.protocol.messages import Advice
from hri_predict.reasons import Reason
from hri_predict.risk.areas import FieldOfView, NamedZone, NamedZoneSettings
from hri_predict.risk.calibration import Calibration, Radii
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.human_speed import HumanSpeeds, SnapshotVelocities, measure_people
from hri_predict.risk.levels import Demand, LevelMachine, combined
from hri_predict.risk.nearest_in_time import BodiesInTime
from hri_predict.risk.outlook import Outlook, outlooks
from hri_predict.risk.robot_judge import Judgement, RobotJudge
from hri_predict.risk.robot_tracker import RobotNow, RobotTracker
from hri_predict.risk.self_check import SelfCheck, SelfCheckSettings, Trust
from hri_predict.risk.separation import Finding
from hri_predict.risk.settings import HumanLimits, RiskSettings
from hri_predict.risk.types import Assessment, NamedZoneState
from hri_predict.risk.zones import BodyZones, ZoneBuilder
from hri_predict.settings import Region
from hri_predict.skeleton import Skeleton
from hri_predict.snapshot import PeopleSnapshot

__all__ = ["HumanLimits", "RiskEngine", "RiskSettings"]

MAX_LATCH_ID = 65_000
"""Latch ids wrap here: they are 16 bits on the wire."""
FUTURE_NS = 50_000_000
"""A capture later than now by more than this is a broken clock."""
_OF_PREDICTOR = (Reason.PREDICTOR_FAILED, Reason.PREDICTOR_LATE)


class RiskEngine:
    """Builds zones, judges every robot against them, and remembers levels.

    Args:
        settings: see ``RiskSettings``.
        robots: one tracker per robot, in the configuration's order.
        skeleton: of the forecast.
        absent_parts: parts of the body that are not there.
        named_zones: the user's zones.
        field_of_view: what the sensor sees; ``None``: everything.
        budget: the delays.
        forecast_rate_hz: steps per second of the forecast.
        horizon_steps: H of the forecast.
        calibration: of the predictor, in the modes that use forecasts; ``None``: there is none.

    Raises:
        ConfigError: the delay budget goes past the horizon, a zone names an unknown robot, or no
            segment of the body is left.
    """

    def __init__(
        self,
        settings: RiskSettings,
        robots: Sequence[RobotTracker],
        skeleton: Skeleton,
        absent_parts: Sequence[str],
        named_zones: Sequence[NamedZoneSettings],
        field_of_view: Region | None,
        budget: DelayBudget,
        forecast_rate_hz: float,
        horizon_steps: int,
        calibration: Calibration | None = None,
    ) -> None:
        self._settings = settings
        self._budget = budget
        self._velocities = SnapshotVelocities(forecast_rate_hz)
        self._skeleton = skeleton
        trusted = horizon_steps if calibration is None else min(horizon_steps, calibration.steps)
        self._horizon_s = trusted / forecast_rate_hz
        view = None if field_of_view is None else FieldOfView.of(field_of_view)
        self._judges = tuple(
            RobotJudge(settings, tracker, budget, view, self._horizon_s) for tracker in robots
        )
        _check_zones(named_zones, [judge.name for judge in self._judges])
        needed_s = max((judge.longest_s for judge in self._judges), default=0.0)
        steps = max(horizon_steps, math.ceil(needed_s * forecast_rate_hz - 1e-9))
        radii, self._check = None, None
        if calibration is not None:
            coverage = settings.coverage
            radii = Radii(calibration, coverage, skeleton, horizon_steps)
            self._check = SelfCheck(
                SelfCheckSettings(),
                coverage.level,
                coverage.of,
                forecast_rate_hz,
                horizon_steps,
                calibration.motion_ranges(skeleton),
                self._velocities,
            )
        self._builder = ZoneBuilder(
            skeleton,
            absent_parts,
            settings.limits,
            forecast_rate_hz,
            horizon_steps,
            steps if settings.beyond_horizon else horizon_steps,
            radii,
            self._velocities,
        )
        self._named = tuple(NamedZone(z, settings.person_uncertainty_m) for z in named_zones)
        self._next_latch = 0
        self._machines = tuple(
            LevelMachine(settings, judge.max_speed_m_s, self._latch) for judge in self._judges
        )

    def assess(
        self, snapshot: PeopleSnapshot, forecast: Forecast | None, reasons: Sequence[Reason] = ()
    ) -> Assessment:
        """Judge one tick.

        Args:
            snapshot: people at this tick.
            forecast: of the same people, or ``None``: zones of the physical limits alone.
            reasons: why there is no forecast.

        An exception from here must be taken as a fault: it leaves every robot's memory at
        *unknown*.
        """
        try:
            return self.judge(snapshot, self.zones(snapshot, forecast, reasons))
        except Exception:
            for machine in self._machines:
                machine.reset()
            raise

    def zones(
        self, snapshot: PeopleSnapshot, forecast: Forecast | None, reasons: Sequence[Reason] = ()
    ) -> BodyZones:
        """Where everybody may be: the first half of ``assess``; depends on no robot."""
        if self._settings.mode == "reactive":  # asks for no forecast, so none can be missing
            forecast, reasons = None, [r for r in reasons if r not in _OF_PREDICTOR]
        if forecast is not None and not _is_sound(forecast, snapshot, self._builder.horizon_steps):
            forecast, reasons = None, (*reasons, Reason.PREDICTOR_FAILED)
        trust = self._trust(snapshot)
        bodies = self._builder.build(snapshot, forecast, bool(self._named), trust)
        if trust is None:
            return replace(bodies, reasons=tuple(reasons))
        if self._check is not None and forecast is not None and bodies.claimed is not None:
            self._check.note(snapshot, forecast, bodies.claimed)
        return replace(bodies, reasons=(*reasons, *trust.reasons))

    def judge(self, snapshot: PeopleSnapshot, bodies: BodyZones) -> Assessment:
        """Judge zones: the second half of ``assess``."""
        blind = self._distrust(snapshot)
        named = tuple(
            zone.state(bodies) if not blind else NamedZoneState(zone.settings.name, True, 0.0)
            for zone in self._named
        )
        speeds = measure_people(
            self._velocities.of(snapshot), self._skeleton, self._settings.limits
        )
        nows = [judge.tracker.at(snapshot.now_ns) for judge in self._judges]
        outlook = {} if blind else self._outlooks(nows, bodies)
        advices = tuple(
            self._advise(robot, now, snapshot, bodies, named, blind, speeds, outlook.get(robot))
            for robot, now in enumerate(nows)
        )
        return Assessment(advices, bodies.zones, named, bodies.reasons)

    def self_check(self) -> dict[str, Any] | None:
        """How often past forecasts held, for the run's summary; ``None`` without a calibration."""
        return None if self._check is None else self._check.report()

    def _trust(self, snapshot: PeopleSnapshot) -> Trust | None:
        """What past forecasts say; alone their surprise, where nothing is to be made of it."""
        if self._check is None:
            return None
        trust = self._check.check(snapshot)
        if self._settings.coverage.self_check:
            return trust
        return trust.surprise_alone()

    def acknowledge(self, latch_id: int) -> bool:
        """Release the latched stop ``latch_id`` if its cause has cleared; whether it was."""
        return any(machine.acknowledge(latch_id) for machine in self._machines)

    def _distrust(self, snapshot: PeopleSnapshot) -> tuple[Reason, ...]:
        """Why the scene cannot be trusted; the engine looks for itself where that is cheap."""
        reasons = list(snapshot.reasons)
        age_s = snapshot.age_s
        if age_s is None:
            reasons.append(Reason.NO_INPUT)
        elif age_s > self._budget.stale_s + self._budget.cycle_s:
            reasons.append(Reason.INPUT_STALE)
        newest = [*snapshot.capture_ns[:], snapshot.newest_capture_ns or 0]
        if max(newest) > snapshot.now_ns + FUTURE_NS:
            reasons.append(Reason.CLOCK_JUMP)
        return tuple(dict.fromkeys(reasons))

    def _outlooks(self, nows: Sequence[RobotNow], bodies: BodyZones) -> dict[int, Outlook]:
        """Of the robots that are judged time by time, as far as their motion is known."""
        if not len(bodies.zones.ids):
            return {}
        motions = {
            robot: judge.motion(now, bodies)
            for robot, (judge, now) in enumerate(zip(self._judges, nows, strict=True))
            if judge.in_time and not now.reasons
        }
        known = {robot: motion for robot, motion in motions.items() if motion is not None}
        if not known:
            return {}
        judging = [self._judges[robot].time_by_time(motion) for robot, motion in known.items()]
        found = outlooks(list(known.values()), judging, BodiesInTime(bodies.zones.capsules))
        return dict(zip(known, found, strict=True))

    def _advise(
        self,
        robot: int,
        now: RobotNow,
        snapshot: PeopleSnapshot,
        bodies: BodyZones,
        named: tuple[NamedZoneState, ...],
        blind: tuple[Reason, ...],
        speeds: HumanSpeeds,
        outlook: Outlook | None,
    ) -> Advice:
        judge, machine = self._judges[robot], self._machines[robot]
        judgement = Judgement(Demand.nothing(judge.max_speed_m_s), None, False)
        demands = [Demand.unknown(reason) for reason in (*blind, *now.reasons)]
        if not demands:
            judgement = judge.judge(now, bodies, speeds.beyond_standard_m_s, outlook)
            demands = [judgement.demand] + [
                zone.demand(state, judge.name, judge.max_speed_m_s)
                for zone, state in zip(self._named, named, strict=True)
            ]
        demand = combined(demands, judge.max_speed_m_s)
        advised = machine.update(demand, snapshot.captures, snapshot.now_ns)
        reason = advised.reason
        if reason is Reason.NONE and speeds.fast.any():
            reason = Reason.PERSON_FAST
        elif reason is Reason.NONE and bodies.reasons:
            reason = bodies.reasons[0]
        people = judgement.people
        who = people if people is not None and _decided_by_people(demand) else None
        return Advice(
            robot=robot,
            level=advised.level,
            reason=reason,
            latch_id=advised.latch_id,
            separation_m=_separation(people, lambda f: f.separation_m),
            predicted_separation_m=_separation(people, lambda f: f.predicted_m),
            time_to_breach_s=self._breach_s(people),
            speed_limit_m_s=advised.limit_m_s,
            body_part=None if who is None else int(self._builder.segment_index[who.segment]),
            robot_link=None if who is None else who.link,
            capture_ns=bodies.capture_ns,
            detail=self._detail(robot, bodies, demand, reason, who, named, speeds),
        )

    def _breach_s(self, people: Finding | None) -> float | None:
        if people is None or people.breach_s > self._horizon_s:
            return None
        return people.breach_s

    def _detail(
        self,
        robot: int,
        bodies: BodyZones,
        demand: Demand,
        reason: Reason,
        who: Finding | None,
        named: tuple[NamedZoneState, ...],
        speeds: HumanSpeeds,
    ) -> str:
        """What is the matter and what would clear it, for people."""
        if reason is Reason.NONE:
            return ""
        judge = self._judges[robot]
        parts = [f"{judge.name}: {reason.text}"]
        if demand.reason not in (Reason.NONE, reason):
            parts.append(demand.reason.text)
        if who is not None:
            parts.append(
                f"person {bodies.zones.ids[who.person]}, {bodies.zones.segments[who.segment]},"
                f" {judge.where(who)}"
            )
            if who.slack_m < 0:
                parts.append(f"{-who.slack_m:.2f} m too near at its present speed")
        for i in np.flatnonzero(speeds.fast):
            fast_m_s = f"trunk {speeds.trunk[i]:.1f} m/s, hand {speeds.hand[i]:.1f} m/s"
            parts.append(f"person {bodies.zones.ids[i]} is fast: {fast_m_s}")
        if demand.reason in (Reason.ZONE_OCCUPIED, Reason.ZONE_ENTRY_PREDICTED):
            inside = demand.reason is Reason.ZONE_OCCUPIED
            names = [z.name for z in named if z.occupied == inside and z.entry_s is not None]
            parts.append("zone " + ", ".join(names))
        return f"{'; '.join(parts)}; clears when {reason.clears_when}"

    def _latch(self) -> int:
        self._next_latch = self._next_latch % MAX_LATCH_ID + 1
        return self._next_latch


def _decided_by_people(demand: Demand) -> bool:
    return demand.reason in (Reason.PERSON_NEAR, Reason.PERSON_APPROACHING, Reason.PERSON_LOST)


def _separation(people: Finding | None, field: Callable[[Finding], float]) -> float | None:
    """A distance for the wire: none where nobody is, never below 0."""
    if people is None:
        return None
    distance = field(people)
    return max(0.0, distance) if math.isfinite(distance) else 0.0


def _is_sound(forecast: Forecast, snapshot: PeopleSnapshot, steps: int) -> bool:
    shape = forecast.positions.shape
    people, joints = len(snapshot.ids), snapshot.last_positions.shape[1]
    if shape != (people, steps, joints, 3) or not np.isfinite(forecast.positions).all():
        return False
    std = forecast.std
    return std is None or (std.shape == shape[:3] and bool(np.isfinite(std).all()))


def _check_zones(zones: Sequence[NamedZoneSettings], robots: Sequence[str]) -> None:
    for zone in zones:
        for robot in zone.robots or ():
            if robot not in robots:
                raise ConfigError(
                    f"zones: zone {zone.name} names the unknown robot '{robot}'"
                    f"{nearest(robot, robots)} (known: {', '.join(robots)})"
                )
