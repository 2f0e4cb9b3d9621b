"""Section ``speed``: replay speed relative to real time, and simulated approaches per minute."""

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hri_predict.node.listeners import Tick
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.bench.rows import Row, Scope
from hri_sim.simulation.request import SimulationRequest

_SCRIPTS = 24  # procedural motions, as `hri-predict simulate --data procedural` has
_TIMES_REAL = {"baseline": 200.0, "network": 20.0}
_APPROACHES = 200.0  # a minute: 2,000 in ten
_REPLAY = "replay: node time over wall time between its first and last tick, with the demo's cell"
_SIMULATE = "simulate: including the start of its processes, one on each core"


class _Stopwatch(View):
    """Wall and node time of the first and the last tick."""

    def __init__(self) -> None:
        self.ticks: list[tuple[float, int]] = []

    def on_tick(self, tick: Tick) -> None:
        """Note the tick."""
        now = (time.perf_counter(), tick.now_ns)
        self.ticks = [*self.ticks[:1], now]

    @property
    def times_real(self) -> float:
        """Return node time over wall time."""
        (wall, node_ns), (wall_end, node_end_ns) = self.ticks[0], self.ticks[-1]
        return (node_end_ns - node_ns) * 1e-9 / (wall_end - wall)


def rows(scope: Scope) -> Iterator[Row]:
    """Yield each speed with a baseline and with a network."""
    for kind, predictor in (("baseline", scope.baseline), ("network", scope.network)):
        yield Row(
            part=f"replay --speed max, {predictor}",
            unit="x",
            p50=_replay(predictor, 4.0 + 2.0 * scope.seconds),
            aim=_TIMES_REAL[kind],
            more_is_better=True,
            why=_REPLAY,
        )
    for predictor in (scope.baseline, scope.network) if scope.episodes else ():
        yield Row(
            part=f"simulate, {predictor}",
            unit="/min",
            p50=_approaches(predictor, scope.episodes),
            aim=_APPROACHES,
            more_is_better=True,
            why=_SIMULATE,
        )


def _replay(predictor: str, seconds: float) -> float:
    """Record the demo, and replay it as ``hri-predict replay --speed max`` does."""
    demo = configuration.load(configuration.shipped("demo.yaml")).quiet()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "demo.mcap"
        plain = demo.with_predictor("zero_velocity")
        run(plain, Options(factor=None, duration_s=seconds, record=path))
        source: dict[str, Any] = {
            "kind": "recording",
            "path": str(path),
            "room_from_source": demo.source.room_from_source.model_dump(),
        }
        watch = _Stopwatch()
        replayed = demo.with_source(source).with_predictor(predictor)
        run(replayed, Options(factor=None, until_exhausted=True, view=watch))
    return watch.times_real


def _approaches(predictor: str, episodes: int) -> float:
    """Return approaches per minute, simulated as by ``hri-predict simulate --data procedural``."""
    request = SimulationRequest(
        config=configuration.find(Path("simulate.yaml")),
        predictors=(predictor,),
        modes=("predictive",),
        motions=tuple(f"procedural:{seed}" for seed in range(_SCRIPTS)),
        episodes=episodes,
        seed=0,
        people=1,
        jobs=len(os.sched_getaffinity(0)),
    )
    began = time.perf_counter()
    from hri_sim import simulation

    simulation.run(request, lambda _done, _total: None)
    return 60.0 * episodes / (time.perf_counter() - began)
