"""JointStates as RobotStates: names, what is new, what is refused, any bytes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from hri_drivers.links.ros2.codec import Publication
from hri_drivers.links.ros2.joint_states import JOINT_STATE, JointStateReader, JointStatesSettings
from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings
from hri_drivers.wires.ros2_heard import NO_SEQUENCE, Heard
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import RobotMode
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.protocol.wire import StateShape
from hri_predict.robots.settings import RobotSettings

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.protocol.ros.sent import Maker

MAKER = Maker()
MS, S = 10**6, 10**9
UTC = 1_790_000_000 * S
NAMES = ["pan", "lift"]
ONE, OTHER = b"a" * 16, b"b" * 16


def message(at_ns, names=NAMES, position=(1.0, 2.0), velocity=(0.1, 0.2)):
    arrays = {
        "position": np.array(position), "velocity": np.array(velocity), "effort": np.zeros(0),
    }  # fmt: skip
    made = MAKER.store.types[JOINT_STATE](
        header=MAKER.header("base", at_ns), name=list(names), **arrays
    )
    return MAKER.cdr(made, JOINT_STATE)


class Robot:
    """A reader, and a publisher whose states arrive 2 ms after their stamps."""

    def __init__(self, **settings):
        self.counters = ReceiveCounters()
        self.now_ns = UTC
        model = JointStatesSettings.model_validate({"names": NAMES} | settings)
        self.reader = JointStateReader(
            model, 0.02, self.counters, utc_ns=lambda: self.now_ns, monotonic_ns=lambda: self.now_ns
        )

    def hear(self, at_ns=None, *, gid=ONE, late_ns=2 * MS, **content):
        if at_ns is None:
            at_ns = self.now_ns
        self.now_ns = max(self.now_ns, at_ns) + late_ns
        return self.feed(message(at_ns, **content), gid)

    def feed(self, content, gid=ONE):
        return self.reader.read(Heard(0, gid, NO_SEQUENCE, content).packed())


def test_names_say_which_joint_not_the_order():
    state = Robot().hear(
        names=["grip", "lift", "pan"], position=(9.0, 2.0, 1.0), velocity=(9.0, 0.2, 0.1)
    )
    assert (state.positions, state.velocities) == ((1.0, 2.0), (0.1, 0.2))


def test_a_joint_that_is_named_twice_is_refused():
    """Which of its two values holds cannot be known; another joint may be."""
    robot = Robot()
    twice = {"position": (1.0, 2.0, 3.0), "velocity": (0.0, 0.0, 0.0)}
    assert robot.hear(names=["pan", "lift", "pan"], **twice) is None
    assert robot.counters.malformed == 1
    assert robot.reader.refused == "/joint_states: names joint 'pan' twice; correct the publisher"
    assert robot.hear() is not None


@pytest.mark.parametrize(
    ("automatic", "mode"), [(False, RobotMode.UNKNOWN), (True, RobotMode.AUTOMATIC)]
)
def test_the_mode_is_unknown_unless_the_user_says_it(automatic, mode):
    assert Robot(automatic=automatic).hear().mode is mode


def test_the_counter_advances_with_the_stamp_alone():
    robot = Robot()
    counters = [robot.hear(UTC + k * MS, late_ns=0).counter for k in (0, 5, 5, 5, 9)]
    assert counters == [1, 2, 2, 2, 3]


@pytest.mark.parametrize("at_ns", [UTC - S, UTC + S, 5 * S, UTC - 21 * MS])
def test_a_stamp_of_another_clock_or_too_old_is_refused(at_ns):
    robot = Robot()
    assert robot.feed(message(at_ns)) is None
    assert robot.counters.malformed == 1
    assert "delayed, or stamped with another clock" in robot.reader.refused
    assert "\n" not in robot.reader.refused


def test_a_stamp_earlier_than_before_is_refused():
    robot = Robot()
    robot.hear(UTC + 5 * MS, late_ns=0)
    assert robot.hear(UTC + 4 * MS, late_ns=0) is None
    assert robot.reader.refused == "/joint_states: a stamp earlier than the previous one"


def test_when_this_machines_clock_was_set_back_states_go_on():
    robot = Robot()
    before = robot.hear().counter
    robot.now_ns -= 3600 * S
    assert robot.hear().counter == before + 1


def test_two_publishers_of_the_joints_are_both_not_believed():
    robot = Robot()
    robot.hear()
    assert robot.hear(gid=OTHER) is None
    assert robot.hear(gid=ONE) is None
    assert "two publishers of these joints" in robot.reader.refused


def test_other_joints_on_the_topic_are_ignored_whoever_publishes_them():
    robot = Robot()
    robot.hear()
    assert robot.hear(gid=OTHER, names=["grip"], position=[0.0], velocity=[0.0]) is None
    assert robot.counters.ignored == 1
    assert robot.hear() is not None


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"names": ["pan", "elbow"]}, ": no joint 'lift'; correct 'joint_states.names'"),
        ({"names": ["a", "b"]}, ": no joint 'pan'; correct 'joint_states.names'"),
        (
            {"velocity": ()},
            "/joint_states: velocity has 0 values for 2 names; let the",
        ),
        ({"position": (1.0,)}, "/joint_states: position has 1 values for 2 names"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(content, words):
    robot = Robot()
    assert robot.hear(**content) is None
    assert words in robot.reader.refused
    assert robot.counters.malformed == 1


WHOLE = message(UTC)


@given(st.binary(max_size=200), st.integers(0, 150), st.integers(0, 20))
def test_any_bytes_are_refused_or_a_state(noise, at, cut):
    robot = Robot()
    for data in (noise, WHOLE[:at] + noise + WHOLE[at + cut :]):
        state = robot.feed(data)
        assert state is None or len(state.positions) == len(state.velocities) == 2
        robot.reader.read(data)
    heard = robot.counters
    assert heard.received + heard.malformed + heard.ignored == 4


# -- settings -------------------------------------------------------------------------------------


def settings(**data):
    given = {"name": "ros", "full_speed_m_s": 1.0, "joint_states": {"names": NAMES}}
    return Ros2LinkSettings.model_validate(given | data)


def robots(**motion):
    given = {
        "name": "arm", "model": "ur5e", "max_speed_m_s": 1.0,
        "room_from_robot": {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]},
        "motion": {"kind": "state", "delay_s": 0.02} | motion,
    }  # fmt: skip
    return [RobotSettings.model_validate(given)]


def test_the_delay_is_the_robots():
    assert Ros2Link.of_robots(settings(), robots()).joint_states_delay_s == 0.02
    own = Ros2Link.of_robots(settings(joint_states_delay_s=0.01), robots())
    assert own.joint_states_delay_s == 0.01


@pytest.mark.parametrize(
    ("more", "of", "words"),
    [
        ({}, 2 * robots(), "are of one robot, and this link advises 2"),
        ({}, robots(delay_s=0), "need the robot's motion.delay_s"),
        ({"joint_states_delay_s": 0.05}, robots(), "set it to at least 0.05"),
    ],
)
def test_a_robot_that_does_not_fit_is_refused(more, of, words):
    with pytest.raises(LinkError, match=words):
        Ros2Link.of_robots(settings(**more), of)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (StateShape(6, False), "has 2 names, and the robot 6 joints"),
        (StateShape(2, True), "cannot give the pose of a moving base"),
    ],
)
def test_names_are_as_many_as_joints(shape, words):
    with pytest.raises(LinkError, match=words):
        Ros2Link.load(settings(), 25.0, (0,), (shape,))


def test_states_count_in_the_load():
    shape = StateShape(2, False)
    load = Ros2Link.load(settings(), 25.0, (0,), (shape,))
    assert load.details["RobotState"] > 0


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"take": True}, "leave one out"),
        ({"joint_states": {"names": ["a", "a"]}}, "named twice"),
        ({"joint_states": {"names": []}}, "names"),
        ({"joint_states": {}}, "names"),
    ],
)
def test_settings_that_make_no_sense_are_refused(data, words):
    with pytest.raises(ValidationError, match=words):
        settings(**data)


def test_a_listener_does_not_take_states_for_frames():
    receiver = Ros2Link.receiver(settings())
    assert receiver.feed(Publication(b"x" * 60, "joint_states")) == []
    assert receiver.counters.ignored == 1
