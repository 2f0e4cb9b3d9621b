"""A whole node that hears ROS 2 nodes in other processes: no fault of theirs makes it say clear.

The person stands 6 m from the robot, so the healthy cell says clear, and would go on to.
"""

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
pytest.importorskip("rosbags", reason="needs the extra bags")
pytestmark = [pytest.mark.long, pytest.mark.realtime]

PATIENCE_S = 40.0
"""Within this time the healthy cell is found and says clear; then the fault begins."""
ACTS_S = 0.5
"""A fault shows within this time."""
FOUND_S = 4.0
"""A node that starts is found by the others within this time."""


@dataclass
class Levels(View):
    """Keeps the robot's level at each tick.

    Calls ``fault`` once the level has been clear for a second, and stops the node ``after_s``
    later; or, without a fault, stops it ``after_s`` from the start.
    """

    fault: Callable[[], object] | None
    after_s: float
    seen: list[tuple[float, Level]] = field(default_factory=list)  # seconds since the fault
    zero_s: float | None = None
    clear_s: float | None = None

    def bind(self, assembly: assemble.Assembly) -> None:
        """Nothing to bind."""

    def on_tick(self, tick: Tick) -> None:
        now_s = time.monotonic()
        (level,) = [advice.level for advice in tick.advices]
        if self.zero_s is None and self._may_begin(level, now_s):
            self.zero_s = now_s
            if self.fault is not None:
                self.fault()
        if self.zero_s is not None:
            self.seen.append((now_s - self.zero_s, level))
            if now_s - self.zero_s > self.after_s:
                signal.raise_signal(signal.SIGINT)

    def _may_begin(self, level: Level, now_s: float) -> bool:
        if level != Level.CLEAR:
            self.clear_s = None
        elif self.clear_s is None:
            self.clear_s = now_s
        return self.fault is None or (self.clear_s is not None and now_s - self.clear_s > 1.0)

    def between(self, begin_s: float, end_s: float) -> set[Level]:
        found = {level for at_s, level in self.seen if begin_s <= at_s < end_s}
        assert found, "the cell was never clear, or no tick came"
        return found


@pytest.fixture
def watch(domain: int):
    """Runs the node in real time; returns the levels."""

    def ran(
        after_s: float, fault: Callable[[], object] | None = None, away=4.0, of="ros2", **source
    ):
        shipped = configuration.load(configuration.shipped(f"live_{of}.yaml"))
        pose = {"xyz": [away, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
        given = {"domain_id": domain, "room_from_source": pose} | source
        levels = Levels(fault, after_s)
        run(
            shipped.with_source(shipped.source.model_dump() | given),
            Options(factor=1.0, duration_s=PATIENCE_S + after_s, view=levels),
        )
        return levels

    return ran


@pytest.mark.parametrize(
    ("options", "source"),
    [
        ({"frame": "lidar"}, {}),
        ({"joints": 20}, {}),
        ({"clock": "zero"}, {}),
        ({"topic": "/persons"}, {}),
        ({"message": "marker_array"}, {}),
        ({"best_effort": True}, {"reliability": "reliable"}),
        ({"people": 0}, {"sees_room": False}),
        ({"rate": 3}, {}),
    ],
)
def test_a_publisher_that_is_wrong_from_the_start(publish, watch, options, source):
    publish(**options)
    assert Level.CLEAR not in watch(7.0, **source).between(0.0, 7.0)


def test_the_healthy_cell_says_clear(publish, watch):
    publish()
    assert Level.CLEAR in watch(2.0, lambda: None).between(0.0, 2.0)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP])
def test_a_publisher_that_falls_silent(publish, watch, how):
    publisher = publish()
    levels = watch(3.0, lambda: publisher.send_signal(how))
    assert Level.CLEAR not in levels.between(ACTS_S, 3.0)


def test_a_second_publisher_that_sees_nobody(publish, watch):
    publish()
    levels = watch(FOUND_S + 3, lambda: publish(people=0))
    assert Level.CLEAR not in levels.between(FOUND_S, FOUND_S + 3)


@pytest.mark.parametrize(
    ("shift_s", "until_s"), [(-1000.0, 0.8), (-0.25, FOUND_S + 4), (0.25, 0.8), (1000.0, 0.8)]
)
def test_a_publisher_that_is_restarted_with_another_clock(publish, watch, shift_s, until_s):
    """Its silence shows first; then people of another clock must be seen for a while. A clock that
    was set back a little makes all scenes late, and stays so.
    """
    publisher = publish()

    def restart() -> None:
        publisher.kill()
        publish(shift=shift_s)

    levels = watch(FOUND_S + 4, restart)
    assert Level.CLEAR not in levels.between(ACTS_S, until_s)


def test_a_flood_beside_the_robot(publish, watch):
    publish(rate=1500)
    assert Level.CLEAR not in watch(8.0, away=-1.1).between(0.0, 8.0)


TRACKED = "/humans/bodies/tracked"


@pytest.fixture
def bodies(publish, other_messages):
    def start(**options):
        return publish(message="ros4hri", topic=TRACKED, **options)

    return start


@pytest.mark.parametrize(
    "options",
    [{"frame": "lidar"}, {"prefix": "human_"}, {"part": "list"}, {"clock": "zero"}, {"rate": 3}],
)
def test_bodies_that_are_wrong_from_the_start(bodies, watch, options):
    bodies(**options)
    assert Level.CLEAR not in watch(7.0, of="ros4hri").between(0.0, 7.0)


def test_the_healthy_cell_of_bodies_says_clear(bodies, watch):
    bodies()
    assert Level.CLEAR in watch(2.0, lambda: None, of="ros4hri").between(0.0, 2.0)


@pytest.mark.parametrize("part", ["list", "frames"])
def test_a_part_of_ros4hri_that_falls_silent(bodies, watch, part):
    parts = {name: bodies(part=name) for name in ("list", "frames")}
    levels = watch(3.0, lambda: parts[part].send_signal(signal.SIGSTOP), of="ros4hri")
    assert Level.CLEAR not in levels.between(ACTS_S, 3.0)


@pytest.mark.parametrize("options", [{"people": 0}, {"part": "frames", "left": 1.0}])
def test_a_second_publisher_of_bodies(bodies, watch, options):
    bodies()
    levels = watch(FOUND_S + 3, lambda: bodies(**options), of="ros4hri")
    assert Level.CLEAR not in levels.between(FOUND_S, FOUND_S + 3)


def test_a_flood_of_bodies_beside_the_robot(bodies, watch):
    bodies(rate=1500)
    assert Level.CLEAR not in watch(8.0, of="ros4hri", away=-1.1).between(0.0, 8.0)
