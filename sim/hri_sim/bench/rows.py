"""A row of the bench: what was measured, and the floor or aim that stands beside it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure with its spread.

    Attributes:
        part: the measured part; a section names each of its parts once.
        unit: of all its figures.
        p50, p99, max: median, 99th percentile, largest; a figure without a spread is its ``p50``.
        floor: lower bound on this machine, by ``why``; stands next to ``p50``.
        aim: maximum that it should have (minimum, if more is better); next to the figure
            ``aim_of``.
        why: in one phrase, what the floor or the aim is.
        more_is_better: as with speeds.
        axis, size, series: place on a line of a plot: people, 4, "sinn".
        drawn: whether a plot shows it; the lines of a plot show how they grow by themselves.
        note: one line more, such as why there is no figure.
        more: further figures, for JSON alone.
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
        seconds: for each row that is measured in real time.
        baseline: the predictor whose inference costs next to nothing.
        network: the default predictor, whose inference costs most of a tick.
        predictors: those that are measured one by one; empty: all with shipped weights.
        people, joint_maps, horizons_s, robots, rates_hz: values that scaling goes through.
        batches: numbers of people that forecasts are made for.
        wires, age_rates_hz: number of wires, and the rates.
        episodes: approaches of the closed loop; 0: it is left out.
        cold: whether the start is measured with an empty cache, too.
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
        rows: yields each row when it is measured.
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
    """A row of these values; ``beside`` is the rest of it."""
    if not len(values):
        return Row(part=part, unit=unit, note="nothing was measured", **beside)
    figures: dict[str, Any] = beside | spread(values)
    return Row(part=part, unit=unit, **figures)


_UNITS = {"_ms": "ms", "_us": "µs", "_percent": "%", "_m_s": "m/s", "_m3": "m³", "_per_s": "/s"}
"""Ends of the keys of figures."""


def rows_of(
    lines: Iterable[Mapping[str, Any]], *names: str, more_is_better: Sequence[str] = ()
) -> Iterator[Row]:
    """A row for each figure in the lines of a command's table.

    Args:
        lines: key -> figure, or a spread; or these by group; a key without a unit at its end is
            left out.
        names: keys that name a line.
        more_is_better: keys of speeds and the like.
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
