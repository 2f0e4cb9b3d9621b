"""The risk engine: computes one advice per robot from a forecast."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Region
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts.predictor import Forecast, problem_in
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.reason_row import Kind
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import (
    FieldOfView,
    NamedZone,
    NamedZoneSettings,
    check_zones,
    floor_distance,
)
from hri_predict.risk.contact.judges import contact_judges
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.levels.advice import Levels
from hri_predict.risk.levels.grounds import grounds_of
from hri_predict.risk.levels.modes import REASONS, admitted
from hri_predict.risk.levels.near_miss import near_misses
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import Findings, Separation
from hri_predict.risk.sets import check_sets
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.types import Assessment
from hri_predict.risk.warm_up_people import made_up_ticks
from hri_predict.robots.model import StateMotion
from hri_predict.robots.obedience import Obedience
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.zones.body_zones import BodyZones, ZoneBuilder
from hri_predict.zones.calibration import Calibration
from hri_predict.zones.human_speed import Velocities, velocities_in
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants, Trust

FUTURE_NS = 50_000_000
"""Maximum time by which a capture may be in the future before the clock is considered broken."""
STRETCH_STEP = 1.1
"""Step in which the stretch of a late stop is revised; each revision recomputes a table."""


class RiskEngine:
    """The risk stage: computes zones, then separation, then levels.

    Four parts have memory of earlier ticks: the self-check, which runs before the zones and rates
    the reliability of forecasts; the robots' trackers; the check whether robots follow their
    advice; and one level machine per robot. Zones and separation are pure functions.

    Attributes:
        new_levels: creates a new levels stage with the same settings and no memory.

    Args:
        settings: see ``RiskSettings``.
        robots: one tracker per robot, in the configuration's order.
        skeleton: the forecast's skeleton.
        absent_parts: missing parts of the body.
        named_zones: the user's zones.
        field_of_view: space that the sensor sees; ``None``: everything.
        budget: the delay budget.
        forecast_rate_hz: steps per second of the forecast.
        horizon_steps: H of the forecast.
        calibration: calibration of the predictor, in modes that use forecasts; ``None``: not
            calibrated.
        doors: exits and entrances, by configuration key.
        obeyed: whether this advice controls the robots, so that their obedience can be checked.
            False in shadow mode, and for recorded robot motion.
        floor_m: height of the floor.
        last_latch_id: see ``LatchIds``.
        base_dir: base of relative paths in ``settings``.

    Raises:
        ConfigError: the delay budget exceeds the horizon, a zone names an unknown robot, no segment
            of the body is left, or a door is too close to a robot.
    """

    def __init__(
        self,
        *,
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
        doors: Mapping[str, Region] | None = None,
        obeyed: bool = False,
        floor_m: float = 0.0,
        last_latch_id: int | None = None,
        base_dir: Path | None = None,
    ) -> None:
        self._settings = settings
        self._budget = budget
        self._trackers = robots
        self._rate_hz, self._horizon_steps = forecast_rate_hz, horizon_steps
        trusted = horizon_steps if calibration is None else min(horizon_steps, calibration.steps)
        horizon_s = trusted / forecast_rate_hz
        constants = [RobotConstants.of(each, settings, budget, horizon_s) for each in robots]
        self._constants = constants
        self._obedience = {
            i: _obedience(r) for i, r in enumerate(constants) if obeyed and r.is_reported
        }
        for robot in constants:
            _check_modes(robot, settings)
        check_zones(named_zones, [robot.name for robot in constants])
        speeds = [robot.max_speed_m_s for robot in constants]
        least = settings.min_speed_m_s
        check_sets(settings.sets, named_zones, min_speed_m_s=least, max_speeds_m_s=speeds)
        for key, door in (doors or {}).items():
            _check_door(key, door, constants)
        zone = partial(NamedZone, stale_s=budget.stale_s)
        named = [zone(each, settings.person_uncertainty_m) for each in named_zones]
        longest_s = max((robot.longest_s for robot in constants), default=0.0)
        steps = max(horizon_steps, math.ceil(longest_s * forecast_rate_hz - 1e-9))
        self._joints = len(skeleton.joints)
        self._new_check = partial(
            _self_check, settings, calibration, skeleton, (forecast_rate_hz, horizon_steps)
        )
        self._check = self._new_check()
        self._builder = ZoneBuilder(
            skeleton=skeleton,
            absent_parts=absent_parts,
            limits=settings.limits,
            rate_hz=forecast_rate_hz,
            horizon_steps=horizon_steps,
            steps=steps if settings.beyond_horizon else horizon_steps,
            radii=None
            if calibration is None
            else Radii(calibration, settings.coverage, skeleton, horizon_steps),
            with_paths=bool(named),
            margins_m=settings.region_margins_m,
        )
        self._separation = Separation(
            settings=settings,
            robots=constants,
            named=named,
            view=None if field_of_view is None else FieldOfView.of(field_of_view, floor_m),
            times_s=self._builder.times_s,
            horizon_s=horizon_s,
            contact=contact_judges(
                settings=settings,
                robots=constants,
                segments=[skeleton.segments[i] for i in self._builder.segment_index],
                floor_m=floor_m,
                base_dir=base_dir,
            ),
        )
        self.new_levels = partial(
            Levels,
            settings=settings,
            robots=constants,
            named=named,
            horizon_s=horizon_s,
            segment_index=self._builder.segment_index,
            last_latch_id=last_latch_id,
        )
        self._levels = self.new_levels()

    def warm_up(self) -> None:
        """Compile every loop before the first tick: takes a second with cached code, many without.

        Leaves no memory.
        """
        kept, self._check = self._check, self._new_check()
        try:
            for tick in made_up_ticks(self._joints, self._horizon_steps, self._rate_hz):
                self.zones(*tick)
        finally:
            self._check = kept
        self._separation.warm_up()

    def assess(
        self, snapshot: PeopleSnapshot, forecast: Forecast | None, reasons: Sequence[Reason] = ()
    ) -> Assessment:
        """Assess one tick.

        The caller must treat an exception as a fault; every robot's level is then *unknown*.

        Args:
            snapshot: people at this tick.
            forecast: forecast for the same people; ``None``: zones use only physical limits.
            reasons: reasons for a missing forecast.
        """
        try:
            bodies = self.zones(snapshot, forecast, reasons)
            findings = self.separation(bodies, self.robots(snapshot.now_ns))
            return self.levels(snapshot, bodies, findings)
        except BaseException:
            self._levels.reset()
            raise

    def zones(
        self, snapshot: PeopleSnapshot, forecast: Forecast | None, reasons: Sequence[Reason] = ()
    ) -> BodyZones:
        """First step: compute where people may be, without robots; arguments as for ``assess``."""
        if self._settings.mode == "reactive":  # asks for no forecast, so none can be missing
            forecast, reasons = None, [r for r in reasons if r.row.kind is not Kind.PREDICTOR]
        if forecast is not None and problem_in(forecast, self._shape(snapshot)):
            forecast, reasons = None, (*reasons, Reason.PREDICTOR_FAILED)
        velocities = velocities_in(snapshot, self._rate_hz)
        trust = self._trust(snapshot, velocities)
        bodies = self._builder.build(snapshot, forecast, trust=trust, velocities=velocities)
        if self._check is not None and forecast is not None and bodies.claimed is not None:
            self._check.note(snapshot, forecast, bodies.claimed)
        return replace(
            bodies,
            reasons=(*reasons, *(trust.reasons if trust is not None else ())),
            untrusted=self._untrusted(snapshot),
        )

    def robots(self, now_ns: int) -> list[RobotNow]:
        """Return each robot's state at ``now_ns``; check whether it follows its advice."""
        robots = [admitted(t.at(now_ns), t.settings.modes) for t in self._trackers]
        for robot, obedience in self._obedience.items():
            if robots[robot].reasons:
                obedience.forget()
                continue
            obedience.see(robots[robot].speed_m_s, now_ns)
            model = self._trackers[robot].model
            obedience.warn(model.name)
            if obedience.stretch > model.stretch:
                model.stretch = obedience.stretch * STRETCH_STEP
                self._constants[robot] = self._constants[robot].revised()
                self._separation.revised(robot)
        return robots

    def separation(self, bodies: BodyZones, robots: Sequence[RobotNow]) -> Findings:
        """Second step: compute the distances between bodies and robots; see ``Separation``."""
        return self._separation(bodies, robots)

    def levels(self, snapshot: PeopleSnapshot, bodies: BodyZones, findings: Findings) -> Assessment:
        """Third step: compute the advice for each robot; see ``Levels``."""
        now_ns = snapshot.now_ns
        remarks = [self._remarks(robot, now_ns) for robot in range(len(self._trackers))]
        advices = self._levels(snapshot, bodies, findings, remarks)
        for tracker, advice in zip(self._trackers, advices, strict=True):
            tracker.advise(advice.speed_limit_m_s or 0.0, now_ns)
        for robot, obedience in self._obedience.items():
            obedience.advise(advices[robot].speed_limit_m_s or 0.0, now_ns)
        lies = [r for found in findings.robots for r in found.unknown if r.row.contradicts]
        drift = [Reason.CALIBRATION_DRIFT] if self._is_drifting else []
        modes = [REASONS[a.mode] for a in advices if a.mode in REASONS]
        said = [*bodies.reasons, *lies, *(r for each in remarks for r in each), *modes, *drift]
        reasons = dict.fromkeys([*self._levels.sets.reasons, *said])
        near = near_misses(findings, bodies)
        grounds = partial(
            grounds_of, tuple(self._constants), findings.robots, bodies, self._settings
        )
        return Assessment(
            *(advices, bodies.zones, findings.named, tuple(reasons), near, grounds),
            set_in_force=self._levels.sets.shown,
        )

    def _remarks(self, robot: int, now_ns: int) -> tuple[Reason, ...]:
        """Return a robot's deviations from its advice."""
        obedience = self._obedience.get(robot)
        if obedience is None:
            return ()
        said = [
            (Reason.ROBOT_TOO_FAST, obedience.is_too_fast(now_ns)),
            (Reason.ROBOT_STOPS_LATE, obedience.stretch > 1.0),
        ]
        return tuple(reason for reason, holds in said if holds)

    @property
    def robot_counters(self) -> dict[str, int]:
        """Return the counts of faults in the states and motion of all robots."""
        counts: Counter[str] = Counter()
        for tracker in self._trackers:
            states = {f"robot_states_{n}": c for n, c in tracker.counters.items()}
            counts.update(states)
        del counts["robot_states_accepted"]
        for obedience in self._obedience.values():
            counts["robot_too_fast"] += obedience.too_fast
            counts["robot_stops_late"] += obedience.late_stops
        counts.update({f"mode_{n}": c for n, c in self._levels.mode_counters.items()})
        return dict(counts)

    def acknowledge(self, latch_id: int, down_ns: int = 0) -> bool:
        """See ``Levels.acknowledge``."""
        return self._levels.acknowledge(latch_id, down_ns)

    def choose_set(self, link: str, number: int, at_ns: int) -> None:
        """See ``SetChooser.choose``."""
        self._levels.sets.choose(link, number, at_ns)

    def remember(self) -> dict[str, Any]:
        """Return the state to be kept over a restart of the node: the latches."""
        return self._levels.remember()

    def recall(self, data: Mapping[str, Any], _since_s: Callable[[], float]) -> None:
        """Restore the result of ``remember`` from an earlier run; see ``Levels.recall``."""
        self._levels.recall(data)

    def distrust(self, why: str) -> None:
        """Reject the state of an earlier run; see ``Levels.distrust``."""
        self._levels.distrust(why)

    def self_check(self) -> dict[str, Any] | None:
        """Return the coverage of past forecasts; ``None`` without a calibration."""
        return None if self._check is None else self._check.report()

    @property
    def _is_drifting(self) -> bool:
        return self._check is not None and self._check.drift.drifting

    def _trust(self, snapshot: PeopleSnapshot, velocities: Velocities) -> Trust | None:
        """Return the result for past forecasts; only the residual if the self-check is off."""
        if self._check is None:
            return None
        trust = self._check.check(snapshot, velocities)
        return trust if self._settings.coverage.self_check else trust.residual_alone()

    def _untrusted(self, snapshot: PeopleSnapshot) -> tuple[Reason, ...]:
        """Return the reasons to distrust the scene; the engine repeats only the cheap checks."""
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

    def _shape(self, snapshot: PeopleSnapshot) -> tuple[int, int, int, int]:
        """The shape of a forecast's positions."""
        return len(snapshot.ids), self._horizon_steps, snapshot.last_positions.shape[1], 3


def _self_check(
    settings: RiskSettings,
    calibration: Calibration | None,
    skeleton: Skeleton,
    steps: tuple[float, int],
) -> SelfCheck | None:
    if calibration is None:
        return None
    return SelfCheck(
        SelfCheckConstants(),
        level=settings.coverage.level,
        of=settings.coverage.of,
        rate_hz=steps[0],
        horizon_steps=steps[1],
        ranges=calibration.motion_ranges(skeleton),
    )


def _obedience(robot: RobotConstants) -> Obedience:
    motion = robot.robot.motion
    seen_s = motion.delay_s + motion.stale_s if isinstance(motion, StateMotion) else 0.0
    return Obedience(robot.until_braking_s + seen_s, robot.curve.at, robot.max_speed_m_s)


def _check_modes(robot: RobotConstants, risk: RiskSettings) -> None:
    """Refuse an operating mode with a speed limit so low that it means stop."""
    modes = robot.robot.modes
    for key in modes.allowed:
        speed_m_s = getattr(modes, key).speed_m_s
        if speed_m_s is not None and speed_m_s < risk.min_speed_m_s:
            raise ConfigError(
                f"robots: {robot.name}: modes.{key}.speed_m_s {speed_m_s:g} is below "
                f"risk.min_speed_m_s {risk.min_speed_m_s:g}, which means stop; raise the speed, or "
                "lower risk.min_speed_m_s"
            )


def _check_door(key: str, door: Region, robots: Sequence[RobotConstants]) -> None:
    """Refuse a door where a robot could touch a person treated as absent."""
    for robot in robots:
        if robot.model.base is None:
            raise ConfigError(
                f"{key}: the base of robot {robot.name} moves, so its distance from the door is "
                "not fixed, and it could touch a person who leaves or enters; remove the door: a "
                "person who vanishes there then stays lost until an Acknowledge"
            )
        distance_m = floor_distance(door, robot.model.base)
        margin_m = max(robot.risk.region_margins_m.values(), default=0.0)
        reach_m, needed_m = robot.model.reach_m, robot.needed_m() + margin_m
        if distance_m < reach_m + needed_m:
            raise ConfigError(
                f"{key}: {reach_m + needed_m - distance_m:.2f} m too close to robot {robot.name}: "
                f"it is {distance_m:.2f} m from the base, and must be farther than the robot's "
                f"reach of {reach_m:.2f} m and the separation distance of {needed_m:.2f} m; move "
                "the door, or make it smaller"
            )
