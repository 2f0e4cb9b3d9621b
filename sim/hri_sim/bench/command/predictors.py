"""``bench predictors``: how long a forecast takes, at the rate at which the node asks for it."""

import json
import time
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, PredictorError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL
from hri_predict.cli.common import one_of, predictor_settings, progress
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor

_RATE_HZ = 25.0
_HORIZON_S = 1.0
_ENGINES = ("torch", "onnxruntime")


def predictors(
    predictor: Annotated[
        list[str] | None,
        typer.Option(help="Predictor; default: all with shipped weights. Repeatable."),
    ] = None,
    people: Annotated[
        list[int] | None,
        typer.Option(min=1, max=64, help="People at once; default: 1, 4 and 16. Repeatable."),
    ] = None,
    seconds: Annotated[float, typer.Option(help="Seconds to measure each row.")] = 4.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Measure each predictor's forecasts, 25 a second as the node makes them, by engine.

    The engines take turns, so that other programs disturb them alike: compare
    their ratio, and no times from two runs. The floor is what the network's
    products alone would take at the rate of a large product of matrices on one
    core: no program is faster, and a good one takes two or three times as long.

    Example: hri-predict bench predictors --predictor sinn
    """
    if not 1.0 <= seconds <= 600.0:
        raise ConfigError(f"--seconds {seconds:g}: give 1 to 600")
    known = registry.names("predictors")
    for name in predictor or []:
        one_of("--predictor", name, known)
    names = predictor or with_weights()
    sizes = people or [1, 4, 16]
    rows: list[dict[str, Any]] = []
    with progress() as bar:
        task = bar.add_task("forecasting", total=len(names) * len(sizes))
        for some in measure(names, sizes, seconds):
            rows += some
            bar.advance(task)
    if as_json:
        print(json.dumps(rows))
    else:
        Console().print(_table(rows))


def with_weights() -> list[str]:
    """The predictors with shipped weights."""
    return [name for name in registry.names("predictors") if _has_weights(name)]


def measure(
    names: Sequence[str], people: Sequence[int], seconds: float
) -> Iterator[list[dict[str, Any]]]:
    """Yield rows, one for each engine, of each predictor and number of people.

    A row holds ``predictor``, ``engine``, ``people``, ``p50_ms``, ``p99_ms``, ``max_ms``,
    ``forecasts`` (how many were measured), ``differs_mm`` (from torch) and ``floor_ms`` (``None``:
    it has no network).

    Args:
        names: of predictors; they must have shipped weights or need none.
        people: at once.
        seconds: to measure each row.
    """
    from hri_predict.predictors.neural.floor import products_per_second

    rate = products_per_second()
    for name in names:
        yield from _measured(name, people, seconds, rate)


def _floor_ms(predictor: Predictor, people: int, rate: float) -> float | None:
    """Milliseconds of all its networks' products."""
    from hri_predict.predictors.neural.floor import products

    members = getattr(predictor, "members", [predictor])
    networks = [m.network for m in members if hasattr(m, "network")]
    return 1e3 * sum(products(n, people) for n in networks) / rate if networks else None


def _has_weights(name: str) -> bool:
    from hri_predict.predictors.neural.network import network_class_of
    from hri_predict.predictors.neural.settings import shipped_weights

    return network_class_of(name) is not None and shipped_weights(name).is_file()


def _measured(
    name: str, sizes: Sequence[int], seconds: float, rate: float
) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows of each number of people."""
    built = _engines(name)
    for people in sizes:
        each_one = list(built.values())
        seen = _walk(each_one[0].history_steps, people)
        taken = _paced(each_one, *seen, seconds)
        wanted = each_one[0].predict(*seen).positions
        floor_ms = _floor_ms(each_one[0], people, rate)
        rows = []
        for (engine, each), times in zip(built.items(), taken, strict=True):
            found = each.predict(*seen).positions
            rows.append(
                {
                    "predictor": name,
                    "engine": engine,
                    "people": people,
                    "p50_ms": float(np.percentile(times, 50)),
                    "p99_ms": float(np.percentile(times, 99)),
                    "max_ms": float(np.max(times)),
                    "forecasts": len(times),
                    "differs_mm": float(1e3 * np.abs(found - wanted).max()),
                    "floor_ms": floor_ms,
                }
            )
        yield rows


def _engines(name: str) -> dict[str, Predictor]:
    """The predictor by engine, torch first; by the one name "–" if it has no network."""
    base = predictor_settings(name, None, _RATE_HZ, _HORIZON_S)
    cls = registry.load("predictors", name)
    if "engine" not in type(base).model_fields:
        return {"–": cls(base)}
    found = {}
    for engine in _ENGINES:
        settings = validated(type(base), base.model_dump() | {"engine": engine}, "predictor")
        try:
            found[engine] = cls(settings)
        except (ConfigError, PredictorError):
            if engine == _ENGINES[0]:
                raise
    return found


def _walk(steps: int, people: int) -> tuple[Floats, Bools]:
    """Histories of people who move at up to some metres a second."""
    shape = (people, steps, len(CANONICAL.joints), 3)
    rng = np.random.default_rng(people)
    history = 0.01 * rng.standard_normal(shape).cumsum(1) + 0.3 * rng.standard_normal(shape)[:, :1]
    return history, np.ones(shape[:3], dtype=bool)


def _paced(
    built: Sequence[Predictor], history: Floats, observed: Bools, seconds: float
) -> list[list[float]]:
    """Milliseconds of each one's forecasts, a period apart and in turn."""
    taken: list[list[float]] = [[] for _ in built]
    begin = time.perf_counter()
    for number in range(round(seconds * _RATE_HZ) * len(built)):
        time.sleep(max(0.0, begin + number / _RATE_HZ - time.perf_counter()))
        before = time.perf_counter()
        built[number % len(built)].predict(history, observed)
        taken[number % len(built)].append(1e3 * (time.perf_counter() - before))
    return taken


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    table = Table(title="A forecast, 25 a second, milliseconds", title_justify="left")
    table.add_column("predictor")
    table.add_column("engine")
    for name in ("people", "p50", "p99", "max", "floor", "from torch, mm"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            row["predictor"],
            row["engine"],
            str(row["people"]),
            *(f"{row[key]:.1f}" for key in ("p50_ms", "p99_ms", "max_ms")),
            "" if row["floor_ms"] is None else f"{row['floor_ms']:.1f}",
            f"{row['differs_mm']:.1g}",
        )
    return table
