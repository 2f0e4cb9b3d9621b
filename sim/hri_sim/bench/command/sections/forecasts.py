"""Section ``predictors``: forecasts by predictor and engine, hot and paced; memory and start."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor
from hri_sim.bench.command import predictors as bench
from hri_sim.bench.command.report.rows import Row, Scope, measured

_LEAST = 5  # forecasts
_FLOOR = "floor: the network's operations over the rate that this core reaches in a large product"


def rows(scope: Scope) -> Iterator[Row]:
    """Milliseconds of a forecast, in a hot loop and 25 a second, by engine and people."""
    known = registry.names("predictors")
    names = scope.predictors or tuple(name for name in known if bench._has_weights(name))
    for name in (scope.baseline, *names):
        floors: dict[int, float] = {}
        for paced in bench.measure([name], scope.batches, max(1.0, 0.3 * scope.seconds)):
            for row in paced:
                floors[row["people"]] = row.get("floor_ms") or 0.0
                yield _paced(row)
        engines = bench._engines(name)
        for people in scope.batches:
            for engine, times in _hot(engines, people, scope.seconds).items():
                part = f"{_named(name, engine)}, {_people(people)}, hot"
                floor = floors.get(people) or None
                yield measured(part, "ms", times, floor=floor, why=_FLOOR if floor else "")
        for engine in engines:
            yield from _fresh(name, engine)


def _people(count: int) -> str:
    return "1 person" if count == 1 else f"{count} people"


def _named(predictor: str, engine: str) -> str:
    return predictor if engine == "–" else f"{predictor} {engine}"


def _paced(row: dict[str, Any]) -> Row:
    """The row of ``bench predictors``."""
    who = _named(row["predictor"], row["engine"])
    return Row(
        part=f"{who}, {_people(row['people'])}, 25 Hz",
        unit="ms",
        p50=row["p50_ms"],
        p99=row["p99_ms"],
        max=row["max_ms"],
        floor=row.get("floor_ms"),
        why=_FLOOR if row.get("floor_ms") else "",
        axis="people, 25 forecasts a second",
        size=row["people"],
        series=who,
        note=_difference(row["differs_mm"]),
        more={"differs_mm": row["differs_mm"]},
    )


def _difference(mm: float) -> str:
    return f"differs from torch by {mm:.1g} mm" if mm > 0.01 else ""


def _hot(engines: dict[str, Predictor], people: int, seconds: float) -> dict[str, list[float]]:
    """Milliseconds of forecasts made again and again; the engines take turns."""
    taken: dict[str, list[float]] = {engine: [] for engine in engines}
    history, observed = bench._walk(next(iter(engines.values())).history_steps, people)
    end = time.perf_counter() + 0.1 * seconds * len(engines)
    while time.perf_counter() < end or len(next(iter(taken.values()))) < _LEAST:
        for engine, predictor in engines.items():
            began = time.perf_counter()
            predictor.predict(history, observed)
            taken[engine].append(1e3 * (time.perf_counter() - began))
    return taken


def _fresh(name: str, engine: str) -> Iterator[Row]:
    """Start and memory in a process of its own."""
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "hri_sim.bench.command.sections.fresh", name, engine],
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - began
    who = _named(name, engine)
    if done.returncode:
        said: Sequence[str] = done.stderr.strip().splitlines()[-1:] or ["nothing"]
        yield Row(part=f"{who}, start", unit="s", note=f"the process ended: {said[0]}")
        return
    told = json.loads(done.stdout)
    yield Row(part=f"{who}, start to a forecast", unit="s", p50=seconds)
    yield Row(
        part=f"{who}, resident",
        unit="MiB",
        p50=told["resident_mib"],
        floor=told["before_mib"],
        why="floor of resident: the command line with numpy, before the predictor is loaded",
    )
