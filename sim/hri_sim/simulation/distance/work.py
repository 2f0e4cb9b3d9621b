"""Cases of the working distance: one person, one sight, one predictor, all modes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.predictor import Predictor
from hri_predict.contracts.source import SourceSettings
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.compared_predictors import with_predictor
from hri_predict.run.config import Config
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.run.working_distance.measure import (
    FARTHEST_M,
    NEAREST_M,
    WARM_S,
    Measure,
    Situation,
    alone,
    robot_of,
)
from hri_predict.run.working_distance.seen import Seen, watch
from hri_predict.run.working_distance.waterfall import Waterfall, only_seen, waterfall
from hri_predict.zones.body_zones import BodyZones
from hri_sim.simulation.approach import ApproachSettings, ApproachSource, exact, map_of
from hri_sim.simulation.bodies import TrueFuture, foreknown
from hri_sim.simulation.cell import FOREKNOWN, variants, with_risk
from hri_sim.simulation.distance.people import Activity, Sight
from hri_sim.simulation.motion import load_motion

RATE_HZ = 30.0
"""Captures per second, if the cell's source has no rate."""
LEAST_NOISE_M = 0.004
"""Minimum noise of people; without it, a rigidly swaying body is judged to be invented."""
SPACING_M = 0.25
"""Step between the distances of a plotted curve."""
DRAWN = np.arange(-4, 4)
"""Points of a curve around a working distance, in these steps."""


@dataclass(frozen=True, kw_only=True)
class DistancePlan:
    """The cell and how it is measured, for the worker processes.

    Attributes:
        config: path of the configuration.
        robot: name of the robot; ``None``: the first that moves.
        seconds: time to measure each person.
        error_m: position error of each person, as stated by the tracker.
        drawn_noise_m: noise of the cases whose curves are plotted; ``None``: none.
    """

    config: str
    robot: str | None
    seconds: float
    error_m: float = 0.0
    drawn_noise_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class Case:
    """One person as one tracker sees them, under one predictor, in some modes.

    Attributes:
        activity, sight: the person's activity, and the joints that are seen.
        noise_m: white noise on each coordinate, standard deviation.
        predictor: name; ``None``: the cell's own.
        modes: see ``cell.variants``.
    """

    activity: Activity
    sight: Sight
    noise_m: float
    predictor: str | None
    modes: tuple[str, ...]


def joints_seen(case: Case) -> tuple[float, ...]:
    """Return (2 J): shares of time in which the tracker can deliver each joint, and sees it."""
    motion = load_motion(case.activity.motion, RATE_HZ)
    able = map_of([motion], case.sight.tracker, None, case.sight.lacks).mapped
    hidden = np.isin(JOINTS, list(case.sight.hidden))
    kept = 1.0 - case.sight.lost
    return tuple(np.append(able, kept * (able & ~hidden)).tolist())


def cell_of(plan: DistancePlan, predictor: str | None) -> Config:
    """Return the cell with one of the predictors, without parts that do not affect distance."""
    config = configuration.load(Path(plan.config))
    if predictor is not None and predictor != config.predictor.name:
        config = with_predictor(config, predictor)
    return alone(config)


def measure(plan: DistancePlan, case: Case) -> dict[str, Any]:
    """Return the working distance in each mode and the measured speeds, as plain data."""
    person = PlacedPerson(plan, case)
    result: dict[str, Any] = {}
    for mode in case.modes:
        found = person.measure(mode)
        distance_m = found.distance_m()
        if case.noise_m == plan.drawn_noise_m:
            about_m = (FARTHEST_M if distance_m is None else distance_m) + SPACING_M * DRAWN
            for at_m in about_m[(about_m >= NEAREST_M) & (about_m <= FARTHEST_M)]:
                found.limits(float(at_m))
        result[mode] = {
            "distance_m": distance_m,
            "curve": [
                [at_m, float(v.mean()), float(np.quantile(v, 0.1))]
                for at_m, v in sorted(found.known.items())
            ],
        }
    return result


def measure_terms(plan: DistancePlan, case: Case) -> Waterfall:
    """Return the contribution of each term in the case's first mode."""
    return PlacedPerson(plan, case).waterfall(case.modes[0])


class PlacedPerson:
    """A case, ready to be measured in any mode."""

    def __init__(self, plan: DistancePlan, case: Case) -> None:
        self._plan, self._case = plan, case
        self.config = _with_person(cell_of(plan, case.predictor), case, plan.error_m)
        assert isinstance(self.config.source, ApproachSettings)
        self._settings = self.config.source
        self._predictor = _predictor(plan, case.predictor)
        self._robot = robot_of(self.config, plan.robot)
        self._seen: dict[bool, Seen] = {}

    def measure(self, mode: str) -> Measure:
        """Return the measure in one mode."""
        true = mode == FOREKNOWN
        (variant,) = variants(self.config, [mode], ())
        situation = self.situation(with_risk(self.config, variant), whole=true)
        seen = self.seen(whole=true)
        zones = situation.zones(seen)
        if true:
            zones = only_seen(self._predictor.skeleton, seen, self._true_future(seen, zones))
        robots = situation.robots(seen)
        return Measure(situation, seen, zones=zones, robots=robots, middle=self.middle)

    def waterfall(self, mode: str, step: float = 0.01) -> Waterfall:
        """Return the contribution of each term in one mode."""
        (variant,) = variants(self.config, [mode], ())

        def watched(whole: bool, fresh: bool) -> tuple[Situation, Seen]:
            """Return the cell and the person, whole or fresh if requested."""
            config = with_risk(self.config, variant)
            settings = self._settings
            if whole:
                update: dict[str, Any] = {"tracker": None, "lacks": [], "hidden": []}
                settings = settings.model_copy(update=update | {"lost_limbs": 0.0})
            if fresh:
                node = config.node.model_copy(update={"ticks": "capture", "max_rate_hz": None})
                settings = settings.model_copy(update={"min_latency_s": 0.0})
                config = replace(config, node=node)
            config, source = replace(config, source=settings), ApproachSource(settings)
            seen = watch(config, source, self._predictor, self._plan.seconds)
            return Situation.of(config, source, self._predictor, self._robot), seen

        return waterfall(watched, self.middle, step=step)

    def situation(self, config: Config, *, whole: bool) -> Situation:
        """Return the cell with this person's source; ``whole``: all joints, without noise."""
        source = ApproachSource(exact(self._settings) if whole else self._settings)
        return Situation.of(config, source, self._predictor, self._robot)

    def seen(self, *, whole: bool) -> Seen:
        """Return the person, tick by tick."""
        if whole not in self._seen:
            settings = exact(self._settings) if whole else self._settings
            source = ApproachSource(settings)
            self._seen[whole] = watch(self.config, source, self._predictor, self._plan.seconds)
        return self._seen[whole]

    @property
    def middle(self) -> Floats:
        """Return (2,), the person's mean position in the time that is judged, seen or not."""
        motion = load_motion(self._case.activity.motion, self._settings.rate_hz)
        shown: Bools = np.asarray(motion.observed.any(axis=1))  # a tracker loses people
        at_s = motion.capture_ns * 1e-9
        judged: Bools = shown & (at_s >= WARM_S) & (at_s <= self._plan.seconds)
        if not judged.any():
            judged = shown
        place: Floats = np.nanmean(motion.positions[judged, :, :2], axis=1).mean(axis=0)
        return place

    def _true_future(self, seen: Seen, zones: Sequence[BodyZones]) -> list[BodyZones]:
        end_ns = seen.snapshots[-1].now_ns + round(zones[-1].zones.times_s[-1] * 1e9)
        future = TrueFuture(ApproachSource(exact(self._settings)), VIRTUAL_START_NS, end_ns)
        return foreknown(seen.snapshots, zones, future)


@lru_cache(maxsize=2)
def _predictor(plan: DistancePlan, predictor: str | None) -> Predictor:
    return assemble.build_predictor(cell_of(plan, predictor))


def _with_person(config: Config, case: Case, error_m: float) -> Config:
    """Return the cell whose source shows this person at the origin of the room."""
    kept = SourceSettings.model_fields.keys() - {"kind", "room_from_source", "faults"}
    source = config.source.model_dump(include=set(kept)) | {
        "kind": "approach",
        "rate_hz": getattr(config.source, "rate_hz", None) or RATE_HZ,
        "keeps_ids": True,
        "motions": [case.activity.motion],
        "places": [[0.0, 0.0, 0.0]],
        "lead_in_s": 0.0,
        "tracker": case.sight.tracker,
        "lacks": list(case.sight.lacks),
        "hidden": list(case.sight.hidden),
        "lost_limbs": case.sight.lost,
        "error_m": error_m,
        "noise_m": case.noise_m if case.activity.is_recorded else max(case.noise_m, LEAST_NOISE_M),
    }
    people = config.node.people
    absent = sorted({*people.absent_parts, *case.activity.absent})
    node = config.node.model_copy(
        update={"people": people.model_copy(update={"absent_parts": absent})}
    )
    return replace(config, node=node).with_source(source)
