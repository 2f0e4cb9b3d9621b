"""JointStates of real ROS 2 nodes in other processes, at the link."""

import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.protocol.wire import StateShape
from tests.hri_drivers.links.ros2.programs import Program

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
pytest.importorskip("rosbags", reason="needs the extra bags")
pytestmark = [pytest.mark.long, pytest.mark.realtime]
JOINTS = Path(__file__).with_name("ros_joints.py")
PATIENCE_S = 30.0


class Ear:
    """A link, and the states that it hears."""

    def __init__(self, link: Ros2Link) -> None:
        self.link = link
        self.states: list[RobotState] = []

    def take(self) -> int:
        """The number of states so far."""
        self.states += [r.message for r in self.link.take() if isinstance(r.message, RobotState)]
        return len(self.states)

    def wait(self, reached: Callable[[], Any]) -> None:
        """Wait for what another process does; the limit only ends a test that fails."""
        end_s = time.monotonic() + PATIENCE_S
        while not reached():
            assert time.monotonic() < end_s, (self.link.counters, self.link.last_error)
            time.sleep(0.01)
            self.take()

    def counters(self, seconds: float) -> list[int]:
        """Counters of what comes in this time."""
        time.sleep(seconds)
        before = len(self.states)
        self.take()
        return [state.counter for state in self.states[before:]]


@pytest.fixture
def joints(domain: int) -> Iterator[Callable[..., Program]]:
    started: list[Program] = []

    def start(**options: Any) -> Program:
        words = [f"--{name}={value}" for name, value in options.items()]
        started.append(Program(domain, JOINTS, *words))
        return started[-1]

    yield start
    for each in started:
        if each.process.poll() is None:
            each.end()


@pytest.fixture
def ear(domain: int) -> Iterator[Ear]:
    model = Ros2LinkSettings.model_validate(
        {
            "name": "ros", "full_speed_m_s": 1.0, "domain_id": domain, "joint_states_delay_s": 0.5,
            "joint_states": {"names": ["a", "b", "c"], "automatic": True},
        }
    )  # fmt: skip
    link = Ros2Link(model, MonotonicClock(), shapes=(StateShape(3, False),))
    link.start()
    yield Ear(link)
    link.stop()


def test_states_are_heard_by_the_names_of_their_joints(ear, joints):
    joints()
    ear.wait(lambda: len(ear.states) > 20)
    newest = ear.states[-1]
    assert [round(p, -1) for p in newest.positions] == [10.0, 20.0, 30.0]
    assert newest.mode is RobotMode.AUTOMATIC
    counters = [state.counter for state in ear.states]
    assert counters == sorted(set(counters))


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_publisher_that_falls_silent_gives_no_state(ear, joints, how):
    robot = joints()
    ear.wait(lambda: len(ear.states) > 5)
    robot.process.send_signal(how)
    ear.counters(0.5)
    assert ear.counters(0.5) == []


def test_a_publisher_that_repeats_its_last_state_repeats_its_counter(ear, joints):
    joints(freeze=3.0)
    ear.wait(lambda: len(ear.states) > 5)
    ear.wait(lambda: ear.states[-1].counter == ear.states[-2].counter)
    assert len(set(ear.counters(0.3))) <= 1  # and, older than the delay, nothing
    ear.wait(lambda: "delayed, or stamped with another clock" in (ear.link.last_error or ""))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"names": "a,b,grip"}, "/joint_states: no joint 'c'"),
        ({"names": "x,y,z"}, "/joint_states: no joint 'a'"),
        ({"shift": -5}, "delayed, or stamped with another clock"),
        ({"shift": 5}, "delayed, or stamped with another clock"),
    ],
)
def test_what_cannot_be_used_is_said_and_gives_no_state(ear, joints, options, words):
    joints(**options)
    ear.wait(lambda: words in (ear.link.last_error or ""))
    assert ear.counters(0.2) == []
    assert ear.states == []


def test_two_publishers_give_no_state(ear, joints):
    joints()
    ear.wait(lambda: len(ear.states) > 5)
    joints(shift=0.001)
    words = ("two publishers of these joints", "several publishers")  # of Kilted, of Jazzy
    ear.wait(lambda: any(said in ear.link._codec.refused for said in words))
    ear.counters(0.2)
    assert ear.counters(0.5) == []


def test_of_a_flood_every_state_that_counts_is_new(ear, joints):
    joints(rate=5000)
    ear.wait(lambda: len(ear.states) > 500)
    counters = [state.counter for state in ear.states]
    assert counters == sorted(set(counters))
