"""``bench trackers``: the effect of a tracker's joints and noise on productivity.

People walk up to the demo's moving robot and away, observed by each tracker with each kind of
noise. The whole node runs on the virtual clock, in modes predictive and iso.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
import typer

from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.base.settings import validated
from hri_predict.cli.common import JsonOption
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.settings import RiskSettings
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.config import Config
from hri_predict.run.session import Options, View, run
from hri_sim.bench.rows import Row, Scope, rows_of
from hri_sim.bench.table import measure, report
from hri_sim.people.procedural import ProceduralSource
from hri_sim.people.script import PersonSettings, Timeline
from hri_sim.referee import body_capsules

TRACKERS = ("coco17", "mediapipe33", "azure_kinect32", "zed34")
NOISES: dict[str, dict[str, float]] = {
    "none": {},
    "white 2 cm": {"noise_m": 0.02},
    "correlated 2 cm": {"wander_m": 0.02, "wander_s": 0.3},
    "stamps late by 0 to 30 ms": {"stamp_jitter_s": 0.03},
}
MODES = ("predictive", "iso")
_UNUSED: dict[str, Any] = {"name": "zero_velocity", "horizon_s": 1.2}
"""Mode iso judges the current distance without a forecast, so the cheapest predictor is enough."""

_ENTER_S = 4.0  # by then the robot runs at full speed
_FAR_M = 5.0  # walks begin and end here, where the robot need not slow down
_NEAR_M = (1.0, 2.4)  # from the base's axis to the middle of the body, at the nearest
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_SPEED_M_S = (0.8, 1.5)
_HEIGHT_M = (1.5, 1.95)
_WAIT_S = (0.5, 2.0)


_COLUMNS = {
    "tracker": "{tracker}",
    "noise": "{noise}",
    "unlike %": "{unlike_percent:.1f}",
    "widened %": "{widened_percent:.1f}",
    "predictive m/s": "{predictive_m_s:.3f}",
    "iso m/s": "{iso_m_s:.3f}",
    "ratio": "{ratio:.2f}",
    "clear too close": "{clear_too_near}",
    "contacts": "{contacts}",
}


def trackers(
    only: Annotated[
        str | None, typer.Option(help="Measure only trackers and noises whose name contains this.")
    ] = None,
    walks: Annotated[int, typer.Option(min=1, max=1000, help="Walks in each case and mode.")] = 4,
    predictor: Annotated[str, typer.Option(help="Name of the predictor to measure.")] = "sinn",
    as_json: JsonOption = False,
) -> None:
    """Let people walk up to a robot and away, seen by several trackers with several kinds of noise.

    The whole node runs on the virtual clock, in modes predictive and iso. Exit status 1 if a robot
    was advised "clear" too close to a person, or touched a person while it moved.

    Example: hri-predict bench trackers --only "coco17 none" --walks 1
    """
    chosen = cases(only)
    if not chosen:
        names = ", ".join(f"{tracker} {noise}" for tracker, noise in cases(None))
        raise ConfigError(f"--only {only}: no case contains this in its name; cases: {names}")
    measured = measure(walked(chosen, walks, predictor), len(chosen), "trackers")
    title = "People who walk up to a robot and away"
    report(measured, as_json, title, _COLUMNS, texts=("noise",))
    if any(row["clear_too_near"] or row["contacts"] for row in measured):
        raise typer.Exit(1)


def rows(scope: Scope) -> Iterator[Row]:
    """Yield rows for each tracker and kind of noise, from one walk; a quick run uses no noise."""
    found = walked(cases(None if scope.episodes else "none"), 1, scope.network)
    return rows_of(found, "tracker", "noise", more_is_better=("predictive_m_s", "iso_m_s"))


def cases(only: str | None = None) -> list[tuple[str, str]]:
    """Return each pair of tracker and noise; with ``only``, the pairs whose name contains it."""
    pairs = [(tracker, noise) for tracker in TRACKERS for noise in NOISES]
    return [p for p in pairs if only is None or only.lower() in f"{p[0]} {p[1]}".lower()]


def walk(seed: int) -> dict[str, Any]:
    """Return a person for ``source.people`` who walks up to the robot, waits, and walks away."""
    rng = np.random.default_rng(seed)
    toward = rng.uniform(-math.pi, math.pi)
    away = toward + rng.uniform(-0.8, 0.8)
    # spread evenly over the seeds, so that a few walks show all distances
    near = _NEAR_M[0] + (0.5 + seed * _GOLDEN) % 1.0 * (_NEAR_M[1] - _NEAR_M[0])
    speed = rng.uniform(*_SPEED_M_S)
    return {
        "height_m": round(float(rng.uniform(*_HEIGHT_M)), 3),
        "start": _at(toward, _FAR_M),
        "enter_s": _ENTER_S,
        "repeat": False,
        "script": [
            {"do": "walk", "to": _at(toward, near), "speed_m_s": round(float(speed), 3)},
            {"do": "wait", "seconds": round(float(rng.uniform(*_WAIT_S)), 3)},
            {"do": "walk", "to": _at(away, _FAR_M), "speed_m_s": round(float(speed), 3)},
        ],
    }


def _at(angle: float, distance_m: float) -> list[float]:
    return [round(distance_m * math.cos(angle), 3), round(distance_m * math.sin(angle), 3)]


def walked(
    chosen: Sequence[tuple[str, str]], walks: int, predictor: str
) -> Iterator[dict[str, Any]]:
    """Yield the figures of each tracker and kind of noise; see ``measured``."""
    base = configuration.load(configuration.shipped("demo.yaml")).quiet()
    base = base.with_predictor(predictor, horizon_s=1.2)
    for tracker, noise in chosen:
        yield measured(base, tracker, noise, walks)


def measured(base: Config, tracker: str, noise: str, walks: int) -> dict[str, Any]:
    """Return the figures of one tracker with one kind of noise, over all ticks with a person in the
    room.

    Shares are in percent of the ticks in mode predictive. ``ratio`` is the mean speed limit of
    predictive over that of iso. ``clear_too_near`` counts ticks of both modes with the level
    *clear* while a person's true body was within the robot's reach of its base, and
    ``nearest_clear_m`` is the smallest distance from that reach at which the level was *clear*.
    """
    seen: dict[str, list[_Counts]] = {mode: [] for mode in MODES}
    for mode in MODES:
        for seed in range(walks):
            seen[mode].append(
                _walked(_configured(base, tracker=tracker, noise=noise, mode=mode, seed=seed))
            )
    total = {mode: _Counts.total(counts) for mode, counts in seen.items()}
    own, iso, both = total["predictive"], total["iso"], _Counts.total(list(total.values()))
    return {
        "tracker": tracker,
        "noise": noise,
        "walks": walks,
        "ticks": own.ticks,
        "unlike_percent": round(100.0 * own.unlike / own.ticks, 2),
        "widened_percent": round(100.0 * own.widened / own.ticks, 2),
        "predictive_m_s": round(own.limit_m_s / own.ticks, 4),
        "iso_m_s": round(iso.limit_m_s / iso.ticks, 4),
        "ratio": round(own.limit_m_s / own.ticks / (iso.limit_m_s / iso.ticks), 3),
        "clear_too_near": both.clear_too_near,
        "nearest_clear_m": round(min(own.nearest_clear_m, iso.nearest_clear_m), 3),
        "contacts": both.contacts,
    }


def _configured(base: Config, *, tracker: str, noise: str, mode: str, seed: int) -> Config:
    person = walk(seed)
    timeline = Timeline(validated(PersonSettings, person, "walk"), "walk", left_first=True)
    source = {
        "kind": "procedural",
        "rate_hz": 30.0,
        "seed": seed,
        "joint_map": tracker,
        "duration_s": _ENTER_S + timeline.cycle_s,
        "people": [person],
    }
    config = base.with_source(source | NOISES[noise])
    risk = validated(RiskSettings, config.node.risk.model_dump() | {"mode": mode}, "risk")
    people = config.node.people.model_copy(update={"exits": []})
    config = replace(config, node=config.node.model_copy(update={"risk": risk, "people": people}))
    return config.with_predictor(**_UNUSED) if mode == "iso" else config


def _walked(config: Config) -> "_Counts":
    watch = _Watch()
    summary = run(config, Options(factor=None, view=watch))
    watch.counts.contacts = summary.contacts or 0
    return watch.counts


@dataclass(slots=True)
class _Counts:
    """Counts over the ticks with a person in the room."""

    ticks: int = 0
    unlike: int = 0
    widened: int = 0
    limit_m_s: float = 0.0
    clear_too_near: int = 0
    nearest_clear_m: float = math.inf
    contacts: int = 0

    @classmethod
    def total(cls, counts: Sequence["_Counts"]) -> "_Counts":
        sums = {f.name: sum(getattr(each, f.name) for each in counts) for f in fields(cls)}
        return cls(**sums | {"nearest_clear_m": min(each.nearest_clear_m for each in counts)})


class _Watch(View):
    """Compares the advice of each tick with the person's true position."""

    def __init__(self) -> None:
        self.counts = _Counts()

    def bind(self, assembly: assemble.Assembly) -> None:
        source, (robot,) = assembly.source, assembly.robots
        assert isinstance(source, ProceduralSource)
        self._truth, self._reach_m = source.truth, robot.reach_m
        assert robot.base is not None  # it stands
        self._base = Capsules(robot.base, robot.base, np.zeros(()))

    def on_tick(self, tick: Tick) -> None:
        people = self._truth(tick.now_ns)
        if not people or tick.assessment is None:
            return
        counts, advice = self.counts, tick.advices[0]
        counts.ticks += 1
        counts.unlike += Reason.MOTION_UNLIKE in tick.assessment.reasons
        counts.widened += Reason.ZONES_WIDENED in tick.assessment.reasons
        counts.limit_m_s += advice.speed_limit_m_s or 0.0
        if advice.level is Level.CLEAR:
            bodies, counting = body_capsules(*map(np.stack, zip(*people.values(), strict=True)))
            distance = np.where(counting, capsule_distance(bodies, self._base), np.inf)
            beyond_m = float(distance.min()) - self._reach_m
            counts.clear_too_near += beyond_m < 0
            counts.nearest_clear_m = min(counts.nearest_clear_m, beyond_m)
