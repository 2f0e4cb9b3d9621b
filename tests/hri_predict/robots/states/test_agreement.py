"""Several controllers of one robot, and a state and a trajectory, must agree."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.robots.states.plausibility import HELD_S
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.robots.trajectory import load_trajectory
from tests.hri_predict.robots import mobile

CONTRADICT = Reason.ROBOT_STATES_CONTRADICT
ARM = {"name": "arm", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}
SETTINGS = RobotSettings.model_validate(ARM)
MODEL = load_robot(SETTINGS, None)
PATH = load_trajectory("pick_and_place", MODEL, None)
TICK_NS = 40_000_000


class Pair:
    """Two controllers of one arm on its way; their states come at different times."""

    def __init__(self, motion: Any = None, rate: float = 1.0, late_s: float = 0.0) -> None:
        self.settings = SETTINGS
        if motion is not None:
            self.settings = RobotSettings.model_validate({**ARM, "motion": motion})
        self.tracker = RobotTracker(self.settings, MODEL)
        self.start_ns = self.now_ns = 10**9
        self.counter, self.rate, self.late_s = 0, rate, late_s
        self.phase_s = 1.2

    def _send(self, link: str, at_ns: int, lie: Any) -> None:
        phase_s = self.phase_s + self.rate * (at_ns - self.now_ns) * 1e-9
        if link == "can":
            phase_s -= self.rate * self.late_s
        q, qd = PATH.at_phase(phase_s, self.rate)
        if lie is not None:
            q, qd = lie(q, qd)
        state = RobotState(
            robot=0,
            mode=RobotMode.AUTOMATIC,
            counter=self.counter % 65536,
            positions=tuple((np.round(q * 4000) / 4000).tolist()),
            velocities=tuple((np.round(qd * 1000) / 1000).tolist()),
        )
        self.tracker.update(state, at_ns, link)

    def tick(self, lie: Any = None, link: str = "can") -> RobotNow:
        """40 ms: two states of each controller."""
        for k in range(2):
            self.counter += 1
            at_ns = self.now_ns + k * TICK_NS // 2
            self._send("serial", at_ns + 2_000_000, lie if link == "serial" else None)
            self._send("can", at_ns + 11_000_000, lie if link == "can" else None)
        self.now_ns += TICK_NS
        self.phase_s += self.rate * TICK_NS * 1e-9
        return self.tracker.at(self.now_ns)


def turned(angle: float) -> Any:
    return lambda q, qd: (q + np.array([angle, 0, 0, 0, 0, 0]), qd)


@pytest.mark.parametrize("late_s", [0.0, 0.03])
@settings(max_examples=5)
@given(st.floats(0.0, 1.0))
def test_controllers_that_report_the_same_robot_agree(late_s: float, rate: float) -> None:
    pair = Pair(rate=rate, late_s=late_s)
    for _ in range(200):  # more than a cycle
        assert pair.tick().reasons == ()
    assert pair.tracker.counters["contradicted"] == 0


@settings(max_examples=10)
@given(st.floats(0.15, 2.5), st.sampled_from([-1, 1]), st.sampled_from(["serial", "can"]))
def test_controllers_that_put_it_apart_are_not_believed(angle: float, sign: int, link: str) -> None:
    pair = Pair(rate=0.5)
    lie = turned(sign * angle)
    for _ in range(100):
        now = pair.tick(lie, link)
        assert now.q is None
        assert now.reasons
    assert now.reasons == (CONTRADICT,)


def test_a_contradiction_counts_for_some_seconds_and_passes() -> None:
    pair = Pair(rate=0.0)
    assert pair.tick(turned(0.3)).reasons == (CONTRADICT,)
    held = [pair.tick().reasons for _ in range(math.ceil(HELD_S * 1e9 / TICK_NS) + 1)]
    assert held[0]  # the jump back is seen, too
    assert held[-1] == ()


def test_a_small_difference_enlarges_the_robot() -> None:
    alone, pair = Pair(rate=0.0), Pair(rate=0.0)
    apart = [pair.tick(turned(0.015)) for _ in range(10)][-1]
    same = [alone.tick() for _ in range(10)][-1]
    assert apart.reasons == ()
    assert apart.uncertainty_m > same.uncertainty_m + 0.01  # 0.015 rad at 0.7 m and more


def test_a_controller_that_says_it_stands_does_not_make_it_slow() -> None:
    """Until it is found out, the faster one counts."""
    pair = Pair()
    for _ in range(5):
        pair.tick()
    first = PATH.at_phase(pair.phase_s, 1.0)[0]
    now = pair.tick(lambda _q, qd: (first, 0 * qd))
    true = float(MODEL.tip_speed(*PATH.at_phase(pair.phase_s, 1.0)))
    assert now.q is None or now.speed_m_s > 0.8 * true


def test_a_controller_whose_states_are_refused_is_not_outvoted() -> None:
    pair = Pair(rate=0.0)
    pair.tick()
    wrong = lambda q, qd: (q + 20.0, qd)  # noqa: E731
    for _ in range(10):
        assert pair.tick(wrong, "serial").reasons == (Reason.ROBOT_STATE_INVALID,)


def test_a_silent_controller_is_not_compared() -> None:
    pair = Pair(rate=0.2)
    pair.tick()
    pair._send("gone", pair.now_ns, turned(0.6))
    found = [pair.tick().reasons for _ in range(100)]
    assert found[0] == (CONTRADICT,)
    assert found[-1] == ()


def test_a_full_turn_of_a_vehicle_is_no_contradiction() -> None:
    robot = RobotTracker(mobile.settings_of(), load_robot(mobile.settings_of(), None))
    robot.update(mobile.state(1, mobile.standing(yaw_rad=math.pi - 0.001)), 10**9, "a")
    robot.update(mobile.state(1, mobile.standing(yaw_rad=0.001 - math.pi)), 10**9, "b")
    assert robot.at(10**9).reasons == ()
    robot.update(mobile.state(2, mobile.standing(x_m=0.5)), 10**9 + 1, "c")
    assert robot.at(10**9 + 2).reasons == (CONTRADICT,)


FILE = {"kind": "trajectory", "file": "pick_and_place", "start_s": 1.2}


def test_a_robot_that_is_where_its_file_says_is_believed() -> None:
    pair = Pair(FILE)
    pair.tracker.at(pair.start_ns)
    for _ in range(200):
        assert pair.tick().reasons == ()


@pytest.mark.parametrize("rate", [0.0, 0.5])
def test_a_robot_that_obeys_is_not_where_its_file_says(rate: float) -> None:
    pair = Pair(FILE, rate=rate)
    pair.tracker.at(pair.start_ns)
    found = [pair.tick() for _ in range(100)]
    assert all(now.reasons == (CONTRADICT,) for now in found[10:])
    assert found[-1].q is None


def test_a_robot_that_is_said_to_stand_and_moves_is_unknown() -> None:
    q = PATH.at(1.2)[0].tolist()
    pair = Pair({"kind": "standing", "positions": q}, rate=0.0)
    assert pair.tick().reasons == ()
    pair.rate = 1.0
    assert [pair.tick() for _ in range(20)][-1].reasons == (CONTRADICT,)


@pytest.mark.parametrize(
    "motion", [FILE, {"kind": "standing", "positions": PATH.at(1.2)[0].tolist()}]
)
def test_a_robot_whose_states_are_refused_is_not_where_its_file_says(motion: Any) -> None:
    """Its controller says something impossible, so nobody knows where it is."""
    pair = Pair(motion, rate=0.0 if motion is not FILE else 1.0)
    pair.tracker.at(pair.start_ns)
    assert pair.tick().reasons == ()
    fast = pair.tick(lambda q, qd: (q, qd + 50.0))
    assert fast.reasons == (Reason.ROBOT_STATE_INVALID,)
    assert fast.q is None


def test_a_trajectory_without_any_state_is_believed() -> None:
    tracker = Pair(FILE).tracker
    assert tracker.at(10**9).reasons == ()
