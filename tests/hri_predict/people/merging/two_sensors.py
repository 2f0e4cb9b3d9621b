"""Two simulated trackers of one room, of different rate, latency and noise; a node with them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Tick
from hri_predict.people.merging.settings import MergedSettings
from hri_predict.people.merging.source import MergedSource
from hri_predict.people.settings import Exit
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Level
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource

CELL = configuration.load(configuration.shipped("two_sensors.yaml")).quiet()
CELL = CELL.with_node(people=CELL.node.people.model_copy(update={"exits": [
    Exit(polygon=[[2.8, 1.8], [4.4, 1.8], [4.4, 3.4], [2.8, 3.4]])
]}))  # fmt: skip
"""A robot that stands at the origin; one exit."""
WALK: list[dict[str, Any]] = [
    {
        "start": [3.3, 2.4],
        "enter_s": 0.5,
        "script": [
            {"do": "walk", "to": [0.9, 0.6], "speed_m_s": 1.4},
            {"do": "wait", "seconds": 0.5},
            {"do": "walk", "to": [4.9, 3.6], "speed_m_s": 1.4},
            {"do": "leave", "seconds": 4.0},
        ],
    }
]
"""A person who comes in, stays beside the robot from about 3 s to 6 s, and leaves."""
START_NS = 1_000_000_000
FRONT: dict[str, Any] = {
    "kind": "procedural", "rate_hz": 30, "latency_s": 0.03, "min_latency_s": 0.03, "noise_m": 0.005,
}  # fmt: skip
BACK: dict[str, Any] = {
    "kind": "procedural", "rate_hz": 25, "latency_s": 0.06, "min_latency_s": 0.06, "noise_m": 0.008,
}  # fmt: skip


def standing(*places: tuple[float, float]) -> list[dict[str, Any]]:
    """The scripts of people who stand where they are."""
    wait = [{"do": "wait", "seconds": 60.0}]
    return [{"start": list(place), "script": wait} for place in places]


def merged(
    front: dict[str, Any] | None = None,
    back: dict[str, Any] | None = None,
    people: list[dict[str, Any]] | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """The ``source:`` block of both trackers; what is given is added to theirs."""
    script = {"people": WALK if people is None else people}
    sensors = {"front": FRONT | script | (front or {}), "back": BACK | script | (back or {})}
    return {"kind": "merged", "sensors": sensors} | settings


def scenes(source: dict[str, Any], seconds: float) -> Iterator[tuple[int, Scene]]:
    """The merged scenes of the first seconds, and when each came."""
    merging = MergedSource(MergedSettings.model_validate(source))
    merging.open(START_NS)
    now_ns = START_NS
    while (due_ns := merging.next_ns()) is not None and now_ns < START_NS + seconds * 1e9:
        now_ns = max(now_ns + 1, due_ns)
        while (scene := merging.poll(now_ns)) is not None:
            yield now_ns, scene


@dataclass
class Watch(View):
    """Keeps every tick between the start and the end."""

    ticks: list[Tick] = field(default_factory=list)
    stamps: set[int] = field(default_factory=set)

    def on_scene(self, scene: Scene, receipt_ns: int) -> None:
        self.stamps.add(scene.stamp_ns)

    def on_tick(self, tick: Tick) -> None:
        if tick.snapshot is not None:
            self.ticks.append(tick)

    def levels(self, from_s: float = 0.0, to_s: float = np.inf) -> set[Level]:
        """The robot's levels between two times of the run."""
        return {t.advices[0].level for t in self.between(from_s, to_s)}

    def between(self, from_s: float, to_s: float = np.inf) -> list[Tick]:
        zero_ns = self.ticks[0].now_ns
        return [t for t in self.ticks if from_s <= (t.now_ns - zero_ns) * 1e-9 <= to_s]


def people_of(tick: Tick) -> PeopleSnapshot:
    """The people at a tick that ``Watch`` kept."""
    assert tick.snapshot is not None
    return tick.snapshot


def node_with(source: dict[str, Any], seconds: float) -> Watch:
    """Run the whole node with these sensors on the virtual clock."""
    watch = Watch()
    run(CELL.with_source(source), Options(factor=None, duration_s=seconds, view=watch))
    return watch


def nearest_m(watch: Watch, people: list[dict[str, Any]] | None = None) -> list[tuple[Tick, float]]:
    """Each tick, and how near any true joint is to the axis of the robot's base; inf if no person
    is there."""
    script = {"kind": "procedural", "people": WALK if people is None else people}
    truth = ProceduralSource(ProceduralSettings.model_validate(script))
    zero_ns = watch.ticks[0].now_ns
    truth.open(zero_ns)
    found = []
    for tick in watch.ticks:
        bodies = [joints for joints, _ in truth.truth(tick.now_ns).values()]
        apart = [float(np.hypot(*body[:, :2].T).min()) for body in bodies]
        found.append((tick, min(apart, default=np.inf)))
    return found
