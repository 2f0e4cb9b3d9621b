"""Section ``predictors`` and ``bench predictors``: the duration of a forecast.

The section also measures forecasts in a hot loop, the start-up time, and memory.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Annotated, Any

import numpy as np
import typer

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, LinkError, PredictorError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.cli.common import JsonOption, one_of, predictor_settings, progress
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor
from hri_predict.predictors.ensemble import AverageSettings
from hri_predict.run.assemble import LATE_FRACTION
from hri_predict.run.rates import MAX_TICKS_HZ
from hri_predict.run.too_slow import LEAST_HZ
from hri_sim.bench.rows import Row, Scope, measured, spread
from hri_sim.bench.table import Columns, demand, report
from hri_sim.fault_table.soak import resident_mib
from hri_sim.wires.child import child

_RATE_HZ = 25.0
_HORIZON_S = 1.0
_OTHERS = ("average", "constant_velocity")
"""The default predictor and the cheapest that moves people; neither has weights of its own."""
_ENGINES = ("torch", "onnxruntime")
_LEAST = 5  # forecasts in a hot loop
_FLOOR = (
    "floor: the network's operations divided by the rate that this core reaches in a large "
    "matrix product"
)
_COLUMNS: Columns = {
    "predictor": "{predictor}",
    "engine": "{engine}",
    "people": "{people}",
    "p50": "{p50_ms:.1f}",
    "p99": "{p99_ms:.1f}",
    "max": "{max_ms:.1f}",
    "floor": lambda row: "" if row["floor_ms"] is None else f"{row['floor_ms']:.1f}",
    "fits rate_hz": lambda row: f"to {row['fits_hz']}" if row["fits_hz"] else "none",
    "from torch, mm": "{differs_mm:.1g}",
}


def predictors(
    predictor: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Predictor; default: all with shipped weights, {', '.join(_OTHERS)}. Repeatable."
        ),
    ] = None,
    people: Annotated[
        list[int] | None,
        typer.Option(
            min=1, max=64, help="Number of people at once; default: 1, 4 and 16. Repeatable."
        ),
    ] = None,
    seconds: Annotated[float, typer.Option(help="Seconds to measure each row.")] = 4.0,
    as_json: JsonOption = False,
) -> None:
    """Measure each predictor's forecasts, 25 a second as the node makes them, by engine.

    A forecast may take half a cycle of the node. "fits rate_hz" is the highest rate at which 99 %
    of them are in time; run it on the node's machine, with everything else that runs there.

    The engines take turns, so that other programs disturb them equally: compare ratios, never times
    from two runs. The floor is the time of the network's matrix products alone, at the rate that
    one core reaches in a large product: no program is faster, and a good one takes two or three
    times as long.

    Example: hri-predict bench predictors --predictor sinn
    """
    demand("--seconds", seconds, 1.0, 600.0)
    known = registry.names("predictors")
    for name in predictor or []:
        one_of("--predictor", name, known)
    names = predictor or [*with_weights(), *_OTHERS]
    sizes = people or [1, 4, 16]
    rows: list[dict[str, Any]] = []
    with progress() as bar:
        task = bar.add_task("forecasting", total=len(names) * len(sizes))
        for some in measure(names, sizes, seconds):
            rows += some
            bar.advance(task)
    report(rows, as_json, "A forecast, 25 a second, milliseconds", _COLUMNS, texts=("engine",))
    if not as_json:
        print("\n".join(_verdicts(rows)))


def fits_hz(p99_ms: float) -> int:
    """Return the highest rate of a node that waits for such forecasts; 0: none that is allowed."""
    most = int(min(LATE_FRACTION * 1e3 / p99_ms, MAX_TICKS_HZ))
    return most if most >= LEAST_HZ else 0


def _verdicts(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line for each number of people: what fits at the default rate."""
    limit_ms = LATE_FRACTION * 1e3 / _RATE_HZ
    for people in dict.fromkeys(row["people"] for row in rows):
        fit = [
            _named(row["predictor"], row["engine"])
            for row in rows
            if row["people"] == people and row["p99_ms"] <= limit_ms
        ]
        yield (
            f"{_people(people)}: within {limit_ms:g} ms (p99), half a cycle at rate_hz "
            f"{_RATE_HZ:g}: {', '.join(fit) or 'none'}"
        )


def with_weights() -> list[str]:
    """The predictors with shipped weights."""
    return [name for name in registry.names("predictors") if _has_weights(name)]


def measure(
    names: Sequence[str], people: Sequence[int], seconds: float
) -> Iterator[list[dict[str, Any]]]:
    """Yield rows, one for each engine, of each predictor and number of people.

    A row holds ``predictor``, ``engine``, ``people``, ``p50_ms``, ``p99_ms``, ``max_ms``,
    ``forecasts`` (number measured), ``differs_mm`` (difference from torch), ``floor_ms``
    (``None``: no network) and ``fits_hz``, see there.

    Args:
        names: predictors, which must have shipped weights or need none.
        people: numbers of people at once.
        seconds: time to measure each row.
    """
    from hri_predict.predictors.neural.floor import products_per_second

    rate = products_per_second()
    for name in names:
        built = _engines(name)
        engines = list(built.values())
        for count in people:
            seen = _walk(engines[0].history_steps, count)
            taken = _paced(engines, *seen, seconds)
            wanted = engines[0].predict(*seen).positions
            yield [
                {
                    "predictor": name,
                    "engine": engine,
                    "people": count,
                    **{f"{key}_ms": ms for key, ms in spread(times).items()},
                    "forecasts": len(times),
                    "differs_mm": float(1e3 * np.abs(each.predict(*seen).positions - wanted).max()),
                    "floor_ms": _floor_ms(name, engines[0], count, rate),
                    "fits_hz": fits_hz(float(np.percentile(times, 99))),
                }
                for (engine, each), times in zip(built.items(), taken, strict=True)
            ]


def _floor_ms(name: str, predictor: Predictor, people: int, rate: float) -> float | None:
    """Return the time for the products of all the predictor's networks at this rate, in ms."""
    from hri_predict.predictors.neural.floor import products

    settings = predictor_settings(name, None, _RATE_HZ, _HORIZON_S)
    members = [predictor]
    if isinstance(settings, AverageSettings):
        members = [registry.load("predictors", each.name)(each) for each in settings.of_members()]
    networks = [m.network for m in members if hasattr(m, "network")]
    return 1e3 * sum(products(n, people) for n in networks) / rate if networks else None


def _has_weights(name: str) -> bool:
    from hri_predict.predictors.neural.network import network_class_of
    from hri_predict.predictors.neural.settings import shipped_weights

    return network_class_of(name) is not None and shipped_weights(name).is_file()


def _engines(name: str, wanted: Sequence[str] = _ENGINES) -> dict[str, Predictor]:
    """Return the predictor by engine, in the order of ``wanted``; under the single name "–" if the
    predictor has no network.

    An engine that is not installed is left out; the first must be installed.
    """
    base = predictor_settings(name, None, _RATE_HZ, _HORIZON_S)
    cls = registry.load("predictors", name)
    if "engine" not in type(base).model_fields:
        return {"–": cls(base)}
    found = {}
    for engine in wanted:
        settings = validated(type(base), base.model_dump() | {"engine": engine}, "predictor")
        try:
            found[engine] = cls(settings)
        except (ConfigError, PredictorError):
            if engine == wanted[0]:
                raise
    return found


def _walk(steps: int, people: int) -> tuple[Floats, Bools]:
    """Return histories of people who move at up to a few metres a second."""
    shape = (people, steps, len(CANONICAL.joints), 3)
    rng = np.random.default_rng(people)
    history = 0.01 * rng.standard_normal(shape).cumsum(1) + 0.3 * rng.standard_normal(shape)[:, :1]
    return history, np.ones(shape[:3], dtype=bool)


def _paced(
    built: Sequence[Predictor], history: Floats, observed: Bools, seconds: float
) -> list[list[float]]:
    """Return the durations of each predictor's forecasts, in ms, made in turn, one period apart."""
    taken: list[list[float]] = [[] for _ in built]
    begin = time.perf_counter()
    for number in range(round(seconds * _RATE_HZ) * len(built)):
        time.sleep(max(0.0, begin + number / _RATE_HZ - time.perf_counter()))
        before = time.perf_counter()
        built[number % len(built)].predict(history, observed)
        taken[number % len(built)].append(1e3 * (time.perf_counter() - before))
    return taken


def rows(scope: Scope) -> Iterator[Row]:
    """Yield the duration of a forecast in ms, hot and at 25 Hz, by engine and number of people."""
    for name in (scope.baseline, *(scope.predictors or with_weights())):
        floors: dict[int, float] = {}
        for paced in measure([name], scope.batches, max(1.0, 0.3 * scope.seconds)):
            for row in paced:
                floors[row["people"]] = row.get("floor_ms") or 0.0
                yield _paced_row(row)
        engines = _engines(name)
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


def _paced_row(row: dict[str, Any]) -> Row:
    """Return the row of ``bench predictors``."""
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
    """Return the durations of forecasts in a hot loop, in ms; the engines take turns."""
    taken: dict[str, list[float]] = {engine: [] for engine in engines}
    history, observed = _walk(next(iter(engines.values())).history_steps, people)
    end = time.perf_counter() + 0.1 * seconds * len(engines)
    while time.perf_counter() < end or len(next(iter(taken.values()))) < _LEAST:
        for engine, predictor in engines.items():
            began = time.perf_counter()
            predictor.predict(history, observed)
            taken[engine].append(1e3 * (time.perf_counter() - began))
    return taken


def _fresh(name: str, engine: str) -> Iterator[Row]:
    """Measure start-up time and memory in a separate process."""
    who, began = _named(name, engine), time.perf_counter()
    try:
        with child(one_forecast, name, engine) as process:
            told = process.receive()
    except LinkError as error:
        yield Row(part=f"{who}, start", unit="s", note=str(error))
        return
    seconds = time.perf_counter() - began
    yield Row(part=f"{who}, start to a forecast", unit="s", p50=seconds)
    yield Row(
        part=f"{who}, resident",
        unit="MiB",
        p50=told["resident_mib"],
        floor=told["before_mib"],
        why="floor of resident: the command line with numpy, before the predictor is loaded",
    )


def one_forecast(_: Connection, name: str, engine: str) -> dict[str, float]:
    """Load a predictor, forecast for one person, and report the memory; for ``child``."""
    before = resident_mib()
    predictor = _engines(name, (engine,))[engine]
    predictor.predict(*_walk(predictor.history_steps, 1))
    return {"before_mib": before, "resident_mib": resident_mib()}
