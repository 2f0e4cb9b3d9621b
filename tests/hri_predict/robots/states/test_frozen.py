"""A controller that repeats an old place is found; one whose robot stands is believed."""

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.robots.states.frozen import BASE_HELD_S
from hri_predict.robots.tracker import RobotNow, RobotTracker
from hri_predict.robots.trajectory import load_trajectory
from tests.hri_predict.robots import mobile
from tests.messages import make_state

MS = 1_000_000
PERIOD_S = 0.02
FROZEN = Reason.ROBOT_STATE_FROZEN
SETTINGS = RobotSettings.model_validate(
    {"name": "arm", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}
)
MODEL = load_robot(SETTINGS, None)
PATH = load_trajectory("pick_and_place", MODEL, None)


class Arm:
    """A UR5e on its way, reported as on the wire."""

    def __init__(self, phase_s: float = 1.2, rate: float = 1.0) -> None:
        self.tracker = RobotTracker(SETTINGS, MODEL)
        self.phase_s, self.rate, self.before = phase_s, rate, rate
        self.now_ns, self.counter = 10**9, 0
        self.true: tuple[Any, Any]

    def send(self, lie: Any = None, jitter_ns: int = 0) -> RobotNow:
        """One state, and where the robot is at its receipt."""
        self.now_ns += round(PERIOD_S * 1e9)
        self.phase_s += (self.rate + self.before) / 2 * PERIOD_S
        self.before = self.rate
        self.true = PATH.at_phase(self.phase_s, self.rate)
        q, qd = self.true if lie is None else lie(*self.true)
        q, qd = np.round(np.asarray(q) * 4000) / 4000, np.round(np.asarray(qd) * 1000) / 1000
        self.counter += 1
        state = make_state(tuple(q.tolist()), tuple(qd.tolist()), counter=self.counter)
        self.tracker.update(state, self.now_ns + jitter_ns)
        return self.tracker.at(self.now_ns + jitter_ns)

    def settle(self, seconds: float = 1.0) -> "Arm":
        for _ in range(round(seconds / PERIOD_S)):
            assert self.send().reasons == ()
        return self

    def tip_m_s(self) -> float:
        return float(MODEL.tip_speed(*self.true))


def held(arm: Arm, velocities: str) -> Any:
    first = arm.true
    return {
        "old": lambda _q, _qd: first,
        "true": lambda _q, qd: (first[0], qd),
        "none": lambda _q, qd: (first[0], 0 * qd),
    }[velocities]


@settings(max_examples=10)
@given(st.floats(0, 6.4), st.floats(0.05, 1), st.sampled_from(["old", "true"]))
@example(2.625, 0.9375, "true")  # it arrives while its place is held
@example(5.8125, 0.96875, "true")
def test_a_place_that_is_held_in_motion_is_old_at_once_and_unknown_when_stale(
    phase_s: float, rate: float, velocities: str
) -> None:
    arm = Arm(phase_s, rate).settle()
    lie, fastest = held(arm, velocities), float(np.abs(arm.true[1]).max())
    if fastest < 0.1:  # rad/s; a slower one takes longer to show
        return
    held_ns = arm.now_ns
    for k in range(1, 5):
        if float(np.abs(arm.true[1]).max()) < 0.1:
            return
        now = arm.send(lie)
        if now.reasons:  # its velocities gave it away
            assert now.reasons in [(Reason.ROBOT_VELOCITY_WRONG,), (FROZEN,)]
            return
        # its age is that of the place
        assert now.uncertainty_m >= 5.0 * ((k - 1) * PERIOD_S) ** 2 / 2
    while FROZEN not in arm.send(lie).reasons:
        assert arm.now_ns - held_ns <= 0.14e9  # RobotState is stale at 0.1 s
        if float(np.abs(arm.true[1]).max()) < 0.1:
            return
    for _ in range(20):  # wherever it goes, or stands, the place is none of its own
        assert FROZEN in arm.send(lie).reasons


def test_it_is_carried_on_from_where_it_was_measured() -> None:
    arm = Arm(2.0).settle(0.4)
    lie = held(arm, "old")
    now = [arm.send(lie) for _ in range(3)][-1]
    assert now.q is not None
    # 0.0005 rad of rounding, and what its speed changed by in 60 ms
    np.testing.assert_allclose(now.q, arm.true[0], atol=0.005)


def test_one_joint_is_enough() -> None:
    arm = Arm(2.0).settle(0.5)
    first = arm.true[0][0]
    lies = [arm.send(lambda q, qd: (np.concatenate([[first], q[1:]]), qd)) for _ in range(8)]
    assert FROZEN in lies[-1].reasons


def test_noise_of_an_encoder_does_not_hide_it() -> None:
    arm, rng = Arm(2.0).settle(0.5), np.random.default_rng(1)
    first = arm.true
    lie = lambda _q, _qd: (first[0] + rng.choice([0, 0.00025], 6), first[1])  # noqa: E731
    assert FROZEN in [arm.send(lie) for _ in range(8)][-1].reasons


@settings(max_examples=10)
@given(st.floats(0, 6.4))
def test_a_stop_from_speed_within_one_state_is_not_believed(phase_s: float) -> None:
    arm = Arm(phase_s)
    arm.settle()
    lie, speed = held(arm, "none"), arm.tip_m_s()
    now = arm.send(lie)
    if speed > 0.3:
        assert now.reasons == (FROZEN,)
        for _ in range(100):  # 2 s: it does not become true by being repeated
            now = arm.send(lie)
        assert now.reasons == (FROZEN,)
        arm.rate = 0.0
        assert FROZEN not in arm.send(lambda q, qd: (q + 0.001, qd)).reasons
    elif speed < 0.1:
        assert now.reasons == ()


def test_a_controller_that_is_started_again_is_believed() -> None:
    arm = Arm(2.0).settle()
    lie = held(arm, "none")
    assert arm.send(lie).reasons == (FROZEN,)
    arm.counter += 5000
    assert arm.send(lie).reasons == ()
    assert arm.tracker.counters["frozen"] == 1


def test_a_robot_that_stands_for_long_is_believed() -> None:
    """Its encoders report the same bits again and again."""
    arm = Arm(rate=0.0)
    for _ in range(1500):  # 30 s
        assert arm.send().reasons == ()
    assert arm.tracker.counters["frozen"] == 0


@settings(max_examples=10)
@given(st.floats(0, 6.4), st.floats(1.0, 8.0))
def test_a_robot_that_brakes_or_starts_is_believed(phase_s: float, rate_per_s2: float) -> None:
    """Along its path, up to twice as hard as it is configured to accelerate."""
    arm = Arm(phase_s).settle(0.6)
    for sign in (-1.0, 1.0):
        for _ in range(60):
            arm.rate = float(np.clip(arm.rate + sign * rate_per_s2 * PERIOD_S, 0.0, 1.0))
            assert FROZEN not in arm.send().reasons


@pytest.mark.parametrize("hold", [2, 4])
def test_a_controller_that_measures_more_slowly_than_it_sends_is_believed(hold: int) -> None:
    """Every second or fourth state is new, 40 or 80 ms."""
    arm = Arm()
    arm.settle(0.2)
    last = arm.true
    for k in range(300):
        if k % hold == 0:
            last = PATH.at_phase(arm.phase_s + PERIOD_S, 1.0)
        fixed = last
        assert FROZEN not in arm.send(lambda _q, _qd, fixed=fixed: fixed).reasons


def amr(phase: list[float], hold: int, drives: float, counter: int = 100) -> list[RobotNow]:
    """A vehicle that drives at 0.5 m/s; its place is measured every ``hold`` states."""
    robot = RobotTracker(mobile.settings_of(), load_robot(mobile.settings_of(), None))
    found, now_ns, x, seen = [], 10**9, 0.0, 0.0
    for k, v in enumerate(phase):
        now_ns, x = now_ns + 20 * MS, x + v * PERIOD_S
        seen = x if k % hold == 0 and k < counter else seen
        said = v if k < counter else drives
        robot.update(mobile.state(k + 1, mobile.moving(x_m=round(seen, 3), vx=said)), now_ns)
        found.append(robot.at(now_ns))
    return found


def test_a_vehicle_whose_place_freezes_while_it_drives_is_found() -> None:
    found = amr([0.5] * 140, 1, drives=0.5)
    late = round(BASE_HELD_S / PERIOD_S) + 2
    assert all(FROZEN not in now.reasons for now in found[:100])
    assert all(FROZEN in now.reasons for now in found[100 + late :])
    assert found[104].uncertainty_m > found[99].uncertainty_m + 0.02  # meanwhile its zone grows


def test_a_vehicle_that_stands_at_once_is_not_believed() -> None:
    assert FROZEN in amr([0.5] * 140, 1, drives=0.0)[101].reasons


def test_a_vehicle_whose_localisation_is_slow_is_believed() -> None:
    assert all(FROZEN not in now.reasons for now in amr([0.5] * 200, 5, drives=0.5, counter=999))
