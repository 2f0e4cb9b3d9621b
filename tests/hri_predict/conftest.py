from functools import cache

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.base.settings import Pose
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Scene
from hri_predict.contracts.source import SourceSettings
from hri_predict.node.listeners import Tick
from hri_predict.people.people import People
from hri_predict.people.settings import PeopleSettings
from hri_predict.run import assemble
from hri_sim.baseline_demo import baseline_demo
from hri_sim.controllers.cell import MockCell

MS = 1_000_000


@pytest.fixture(scope="session")
def near(tmp_path_factory):
    """A recording: somebody walks up to the robot, 5.6 s on the virtual clock."""
    from tests.hri_predict.explaining.causes import CAUSES, record

    return record(CAUSES["person near"], tmp_path_factory.mktemp("near") / "cell.mcap")


class Room:
    """A source and a people stage on one clock; scenes arrive ``latency`` after capture."""

    rate_hz = 25.0
    steps = 10

    def __init__(
        self, declares_noise=False, source=None, joint_map="canonical", latency=5 * MS, **people
    ):
        # many tests draw joints at random, which stand on no floor
        people = {"posture_unchecked": "bodies of any shape"} | people
        self.people = People(
            settings=PeopleSettings(**people),
            joint_map=load_joint_map(joint_map),
            source_settings=SourceSettings(
                kind="test", room_from_source=Pose(), min_latency_s=latency / 1e9, **(source or {})
            ),
            rate_hz_source=self.rate_hz,
            declares_noise=declares_noise,
            history_steps=self.steps,
            rate_hz_predictor=self.rate_hz,
        )
        self.latency = latency
        self.now = 1_000_000 * MS
        self.sequence = 100

    def see(self, *persons, times=1, sees_room=True, step=1, stamp_error=0):
        for _ in range(times):
            self.now += 40 * MS
            self.sequence += step
            scene = Scene(self.now - self.latency + stamp_error, self.sequence, sees_room, persons)
            self.people.receive(scene, self.now)
        return self.snapshot()

    def snapshot(self, later=0):
        return self.people.snapshot(self.now + later)

    def count(self, name):
        return self.snapshot().counters.get(name, 0)


@pytest.fixture(scope="session")
def make_room() -> type[Room]:
    return Room


@cache
def demo():
    """The demo's configuration, which never changes, read once."""
    return baseline_demo()


class Workcell:
    """The demo's node, links and mock controllers on the virtual clock, stepped by the test."""

    near = [1.9, 0.2]  # a person who stands here is slowed down for, at least

    def __init__(self, *places, config=None, **build):
        config = config.quiet() if config else demo()
        script = [{"do": "wait", "seconds": 60.0}]
        people = [{"start": list(place), "script": script} for place in places]
        self.config = config.with_source(config.source.model_dump() | {"people": people})
        self.clock = VirtualClock(1_000 * MS)
        self.cell = MockCell(
            links=self.config.links,
            robots=self.config.node.robots,
            base_dir=self.config.base_dir,
            clock=self.clock,
        )
        self.ticks: list[Tick] = []
        self.assembly = assemble.build(
            self.config, self.clock, transports=self.cell.transports(), deadline=False, **build
        )
        self.node = self.assembly.node
        self.sees = True  # whether the source delivers
        self.tick_ns = self.clock.now_ns()
        self.assembly.source.open(self.tick_ns)

    def run(self, seconds):
        """Step everything for so long; returns the ticks of that time."""
        before, end_ns = len(self.ticks), self.tick_ns + round(seconds * 1e9)
        while self.tick_ns < end_ns:
            while (beside := self.cell.next_ns() or 0) <= self.tick_ns:
                self.clock.advance_to(beside)
                self._deliver()
                self.cell.step(self.clock.now_ns())
            self.clock.advance_to(self.tick_ns)
            self._deliver()
            self.service()
            self.ticks.append(self.node.tick(self.tick_ns))
            self.service()
            self.tick_ns += 40 * MS
        return self.ticks[before:]

    def service(self):
        for link in self.assembly.links:
            link.service(self.clock.now_ns())

    def _deliver(self):
        while (scene := self.assembly.source.poll(self.clock.now_ns())) is not None:
            if self.sees:
                self.node.receive(scene, self.clock.now_ns())


@pytest.fixture(scope="session")
def make_workcell() -> type[Workcell]:
    return Workcell
