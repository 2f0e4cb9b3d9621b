"""Section ``scaling``: the time of a tick as people, joints, horizons, robots and rate grow.

The cases of one axis take turns in blocks of ticks, at the node's rate in real time, so that caches
are as cold as in the node and other programs disturb all cases equally.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from hri_predict.base.clock import VirtualClock
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.run import assemble
from hri_predict.run.session import VIRTUAL_START_NS
from hri_sim.bench import cell
from hri_sim.bench.rows import Row, Scope, measured

_BLOCKS = 4
_WARM_UP_TICKS = 25  # a second: the people are known, and their histories are full
_LEAST_TICKS = 3  # in a block
_THIRD = 1.0 / 3.0  # time per person at most people over that for one
_WHY_PEOPLE = "aim of 16 over 1: a third of the time per person"
_WHY_POWER = "power: 1 means proportional growth, 0 no growth; between smallest and largest"


@dataclass
class _Case:
    """A node on the virtual clock, ticked in real time.

    Attributes:
        series, size: position in the plot.
        rate_hz: ticks a second.
        taken_ms: durations of the ticks after the warm-up.
    """

    series: str
    size: float
    rate_hz: float
    assembly: assemble.Assembly
    taken_ms: list[float] = field(default_factory=list)
    _tick_ns: int = VIRTUAL_START_NS

    def open(self) -> None:
        """Run as fast as possible until the people are in the room."""
        self.assembly.source.open(self._tick_ns)
        for _ in range(max(_WARM_UP_TICKS, round(self.rate_hz))):
            self._tick()

    def block(self, ticks: int) -> None:
        """Tick once per period."""
        due = time.perf_counter()
        for _ in range(ticks):
            due += 1.0 / self.rate_hz
            time.sleep(max(0.0, due - time.perf_counter()))
            self.taken_ms.append(self._tick())

    def _tick(self) -> float:
        clock, source, node = self.assembly.clock, self.assembly.source, self.assembly.node
        assert isinstance(clock, VirtualClock)
        while (due_ns := source.next_ns()) is not None and due_ns <= self._tick_ns:
            clock.advance_to(max(due_ns, clock.now_ns()))
            while (scene := source.poll(clock.now_ns())) is not None:
                node.receive(scene, clock.now_ns())
        clock.advance_to(self._tick_ns)
        began = time.perf_counter()
        node.tick(self._tick_ns)
        taken_ms = 1e3 * (time.perf_counter() - began)
        self._tick_ns += round(1e9 / self.rate_hz)
        return taken_ms


def rows(scope: Scope) -> Iterator[Row]:
    """Yield the duration of a tick without links, in ms, and its growth."""
    both = (scope.baseline, scope.network)
    yield from _axis(scope, "people", both, [(n, {"people": n}) for n in scope.people])
    joints = [
        (len(load_joint_map(name).source_joints), {"joint_map": name}) for name in scope.joint_maps
    ]
    yield from _axis(scope, "joints", both[:1], sorted(joints, key=lambda case: case[0]))
    horizons = [(round(1e3 * s), {"horizon_s": s}) for s in scope.horizons_s]
    yield from _axis(scope, "horizon, ms", both, horizons)
    yield from _axis(scope, "robots", both[:1], [(n, {"robots": n}) for n in scope.robots])
    rates = [(hz, {"rate_hz": hz}) for hz in scope.rates_hz]
    yield from _axis(scope, "rate, Hz", both[:1], rates)


def _axis(
    scope: Scope,
    axis: str,
    predictors: Sequence[str],
    sizes: Sequence[tuple[float, dict[str, Any]]],
) -> Iterator[Row]:
    """Yield one row for each case, then rows for the growth of the medians."""
    for predictor in predictors:
        cases = [_case(predictor, size, wanted) for size, wanted in sizes]
        for _ in range(_BLOCKS):
            for case in cases:
                ticks = round(0.4 * scope.seconds * case.rate_hz / _BLOCKS)
                case.block(max(_LEAST_TICKS, ticks))
        found = [_row(axis, case) for case in cases]
        for case in cases:
            case.assembly.source.close()
        yield from found
        yield from _growth(axis, predictor, found)


def _case(predictor: str, size: float, wanted: dict[str, Any]) -> _Case:
    config = cell.config(predictor=predictor, **wanted)
    clock = VirtualClock(VIRTUAL_START_NS)
    assembly = assemble.build(config, clock, deadline=False)
    case = _Case(predictor, size, config.node.rate_hz, assembly)
    case.open()
    return case


def _row(axis: str, case: _Case) -> Row:
    part = f"{case.series}, {axis}: {case.size:g}"
    return measured(part, "ms", case.taken_ms, axis=axis, size=float(case.size), series=case.series)


def _growth(axis: str, predictor: str, found: Sequence[Row]) -> Iterator[Row]:
    """Yield the ratio of the last median to the first, and the power by which it grows."""
    if len(found) < 2:
        return
    sizes = [row.size or 1.0 for row in found]
    times = [row.p50 or 1e-9 for row in found]
    aim = None
    if axis == "people" and sizes[0] == 1.0:
        aim = _THIRD * sizes[-1]
    yield Row(
        part=f"{predictor}, {axis}: {sizes[-1]:g} over {sizes[0]:g}",
        unit="x",
        p50=times[-1] / times[0],
        drawn=False,
        aim=aim,
        why=_WHY_PEOPLE if aim else "",
    )
    power = math.log(times[-1] / times[0]) / math.log(sizes[-1] / sizes[0])
    part = f"{predictor}, {axis}: power"
    yield Row(part=part, unit="", p50=power, drawn=False, why=_WHY_POWER)
