"""Ten ways to slow a robot, each done to a real node that records itself."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import baseline_demo
from hri_sim.fault_table.incident import Incident, configured

START_S = 3.5
"""When the trouble begins, seconds after the node's start: the arm moves by then."""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """What is done, and what the answer's first line must say.

    Attributes:
        story: people, faults, settings and lies.
        says: words of the first line.
        marks: the word that no other cause's first line may have.
        never: words that the first line must not have besides.
        at_s: the time asked about, seconds since the recording's beginning.
        view: acts on the running node, in true time.
    """

    story: Incident
    says: Sequence[str]
    marks: Sequence[str] = ()
    never: Sequence[str] = ()
    at_s: float = START_S + 0.7
    view: Callable[[], View] | None = None


class LatePredictor(View):
    """Makes the predictor too slow from ``START_S`` on."""

    def bind(self, assembly: Any) -> None:
        predictor, clock = assembly.prediction.predictor, assembly.clock
        start_ns, predict = clock.now_ns(), assembly.prediction.predictor.predict

        def slow(*arguments: Any) -> Any:
            if clock.now_ns() - start_ns >= START_S * 1e9:
                time.sleep(0.3)
            return predict(*arguments)

        predictor.predict = slow


def _story(duration_s: float = START_S + 1.3, **told: Any) -> Incident:
    there = {"start": [2.9, 0.3], "script": [{"do": "wait", "seconds": 60.0}]}
    return Incident(name="cause", duration_s=duration_s, **{"people": (there,)} | told)


def _both(fault: str) -> tuple[str, ...]:
    return f"drive:{fault}", f"monitor:{fault}"


_CLOSE = {"start": [2.0, 0.2], "script": [{"do": "wait", "seconds": 60.0}]}
_NEARER = _CLOSE | {"start": [1.6, 0.2]}
_COMES = {
    "start": [3.4, 0.1],
    "script": [{"do": "wait", "seconds": 2.5}, {"do": "walk", "to": [1.2, 0.1]}],
}
_BENCH = [[2.5, -0.5], [3.5, -0.5], [3.5, 1.0], [2.5, 1.0]]
CAUSES: dict[str, Cause] = {
    "person near": Cause(
        story=_story(5.6, people=(_COMES,)), at_s=5.0,
        says=("STOP", "person 1's", "m from the"),
    ),
    "person lost": Cause(
        story=_story(faults=("vanish@3.5+9",)), says=("person 1 vanished", "lost"),
    ),
    "stale input": Cause(
        story=_story(faults=("drop@3.5+9",)), says=("UNKNOWN", "newest scene", "old"),
        marks=("scene",),
    ),
    "CRC errors": Cause(
        story=_story(6.0, faults=_both("bit_errors@3.5+9:direction=in,rate=0.05")), at_s=4.8,
        says=("UNKNOWN", "CRC errors", "drive", "monitor"), marks=("CRC",),
    ),
    "latched stop": Cause(
        story=_story(7.0, faults=("vanish@3.5+1",), settings={"risk": {"latch": ["lost"]}}),
        at_s=6.5, says=("latch", "acknowledge", "person 1"), marks=("latch",),
    ),
    "named zone": Cause(
        story=_story(settings={"zones": [{"name": "bench", "polygon": _BENCH, "level": "stop"}]}),
        says=("STOP", "zone 'bench'", "person 1"), marks=("bench",),
    ),
    "robot state stale": Cause(
        story=_story(faults=_both("freeze@3.5+9:direction=in")),
        says=("UNKNOWN", "RobotState", "drive", "monitor"), marks=("silent",),
    ),
    "limit exceeded": Cause(
        story=_story(6.0, people=(_NEARER,), lies=({"kind": "runs"},)), at_s=4.0,
        says=("faster than", "advised"), marks=("faster",),
    ),
    "predictor late": Cause(
        story=_story(people=(_CLOSE,)), view=LatePredictor, says=("the predictor was late",),
        marks=("predictor",),
    ),
    "clock jump": Cause(
        story=_story(faults=("clock_jump@3.5+9:offset_s=-3600",)),
        says=("UNKNOWN", "the source's clock jumped"), marks=("clock",),
    ),
}  # fmt: skip


def record(cause: Cause, path: Path) -> Path:
    """Run the node until it has recorded the cause into ``path``."""
    config = configured(baseline_demo(), cause.story, "predictive")
    view = None if cause.view is None else cause.view()
    factor = None if view is None else 1.0
    run(config, Options(factor=factor, duration_s=cause.story.duration_s, record=path, view=view))
    return path
