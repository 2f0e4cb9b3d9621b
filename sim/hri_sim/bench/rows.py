"""A row of the bench: the measured values, and their floor or aim."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure with its spread.

    Attributes:
        part: the measured part, unique within a section.
        unit: unit of all its figures.
        p50, p99, max: median, 99th percentile, largest; a figure without a spread has only ``p50``.
        floor: lower bound on this machine, explained by ``why``; compared with ``p50``.
        aim: desired maximum (minimum, if more is better) of the figure ``aim_of``.
        why: one phrase that explains the floor or the aim.
        more_is_better: true for speeds, for example.
        axis, size, series: place on a line of a plot: people, 4, "sinn".
        drawn: whether a plot shows it; false for growth, which the lines of a plot show anyway.
        note: one more line, such as the reason why there is no figure.
        more: further figures, only for JSON.
    """

    part: str
    unit: str
    p50: float | None = None
    p99: float | None = None
    max: float | None = None
    floor: float | None = None
    aim: float | None = None
    aim_of: str = "p50"
    why: str = ""
    more_is_better: bool = False
    axis: str = ""
    size: float | None = None
    series: str = ""
    drawn: bool = True
    note: str = ""
    more: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Scope:
    """Amount of measurement.

    Attributes:
        seconds: duration of each row that is measured in real time.
        baseline: the predictor whose inference costs next to nothing.
        network: the default predictor, whose inference costs most of a tick.
        predictors: predictors to measure one by one; empty: all with shipped weights.
        people, joint_maps, horizons_s, robots, rates_hz: values that section ``scaling`` goes
            through.
        batches: numbers of people in one forecast.
        wires, age_rates_hz: number of wires, and the rates.
        episodes: approaches of the closed loop; 0: left out.
        cold: whether the start is also measured with an empty cache.
    """

    seconds: float = 10.0
    baseline: str = "constant_velocity"
    network: str = "sinn"
    predictors: tuple[str, ...] = ()
    batches: tuple[int, ...] = (1, 2, 4, 8, 16)
    people: tuple[int, ...] = (1, 2, 4, 8, 16)
    joint_maps: tuple[str, ...] = ("marker_clusters9", "coco17", "body25", "mediapipe33", "cmu38")
    horizons_s: tuple[float, ...] = (0.2, 0.4, 0.8, 1.2)
    robots: tuple[int, ...] = (1, 2, 4)
    rates_hz: tuple[float, ...] = (10.0, 25.0, 50.0, 100.0)
    wires: int = 2
    age_rates_hz: tuple[float, ...] = (25.0, 50.0)
    episodes: int = 400
    cold: bool = True


QUICK = Scope(
    seconds=1.5,
    predictors=("sinn",),
    batches=(1, 4),
    people=(1, 4, 16),
    joint_maps=("coco17", "mediapipe33"),
    horizons_s=(0.4, 1.2),
    robots=(1, 4),
    rates_hz=(25.0, 100.0),
    wires=1,
    age_rates_hz=(25.0,),
    episodes=0,  # the start of its processes alone would take most of a quick run
    cold=False,
)


@dataclass(frozen=True)
class Section:
    """One of the bench's measurements.

    Attributes:
        about: its title.
        rows: yields each row as soon as it is measured.
        detail: measured only where ``--only`` names it.
    """

    about: str
    rows: Callable[[Scope], Iterator[Row]]
    detail: bool = False


def spread(values: Sequence[float] | Floats, digits: int | None = None) -> dict[str, float]:
    """Return the median, the 99th percentile and the maximum, rounded to ``digits``."""
    seen = np.asarray(values, np.float64)
    p50, p99 = np.percentile(seen, (50, 99))
    found = {"p50": float(p50), "p99": float(p99), "max": float(seen.max())}
    return found if digits is None else {key: round(v, digits) for key, v in found.items()}


def measured(part: str, unit: str, values: Sequence[float] | Floats, **beside: Any) -> Row:
    """Return a row of these values; ``beside`` gives its other fields."""
    if not len(values):
        return Row(part=part, unit=unit, note="nothing was measured", **beside)
    figures: dict[str, Any] = beside | spread(values)
    return Row(part=part, unit=unit, **figures)


_UNITS = {"_ms": "ms", "_us": "µs", "_percent": "%", "_m_s": "m/s", "_m3": "m³", "_per_s": "/s"}
"""Suffixes of the keys of figures."""


def rows_of(
    lines: Iterable[Mapping[str, Any]], *names: str, more_is_better: Sequence[str] = ()
) -> Iterator[Row]:
    """Yield a row for each figure in the lines of a command's table.

    Args:
        lines: key -> figure or spread, or a group of them; keys without a unit suffix are left out.
        names: keys that name a line.
        more_is_better: keys for which a larger value is better.
    """
    for line in lines:
        name = ", ".join(f"{line[key]:g} Hz" if key == "rate_hz" else line[key] for key in names)
        if "not_here" in line:
            yield Row(part=name, unit="", note=line["not_here"])
        for key, value in line.items():
            end = next((end for end in _UNITS if key.endswith(end)), None)
            if end is None or value is None:
                continue
            part = f"{name}: {key.removesuffix(end).replace('_', ' ')}"
            groups = value if isinstance(value, Mapping) and "p50" not in value else {"": value}
            for group, found in groups.items():
                figures = found if isinstance(found, Mapping) else {"p50": found}
                whole = f"{part}, {group}" if group else part
                better = key in more_is_better
                yield Row(part=whole, unit=_UNITS[end], more_is_better=better, **figures)
