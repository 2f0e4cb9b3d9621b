"""A robot that may move and whose states never change is not proven to be where they say."""

from collections.abc import Sequence
from typing import Any

import pytest

from hri_predict.protocol.messages import RobotMode, RobotState
from hri_predict.robots.model import RobotSettings, load_robot
from hri_predict.robots.tracker import RobotTracker
from tests.hri_predict.robots import mobile

PERIOD_NS = 20_000_000
STILL_S = 2.0
AFTER = round(STILL_S * 1e9 / PERIOD_NS) + 2
"""States until it is doubted: the time itself, and the first advice's."""
Q = (0.0, -1.2, 1.5, -1.8, -1.57, 0.0)
STEP = 0.00025
"""Of a position on the wire, rad."""


class Arm:
    """A UR5e that reports and is advised every 20 ms."""

    def __init__(self, still_s: float | None = STILL_S, links: Sequence[str] = ("drive",)) -> None:
        motion = {"kind": "state", "still_s": still_s}
        data = {"name": "arm", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}
        settings = RobotSettings.model_validate({**data, "motion": motion})
        self.tracker = RobotTracker(settings, load_robot(settings, None))
        self.links, self.now_ns, self.counter = links, 10**9, 0

    def go(
        self,
        states: int,
        limit_m_s: float = 1.0,
        q: Sequence[float] = Q,
        qd: Sequence[float] = (0.0,) * 6,
        mode: RobotMode = RobotMode.AUTOMATIC,
    ) -> bool:
        """Whether it is proven after so many states that say the same."""
        for _ in range(states):
            self.now_ns += PERIOD_NS
            self.counter += 1
            said: Any = {"mode": mode, "positions": tuple(q), "velocities": tuple(qd)}
            state = RobotState(robot=0, counter=self.counter, **said)
            for link in self.links:
                self.tracker.update(state, self.now_ns, link)
            proven = self.tracker.at(self.now_ns).proven
            self.tracker.advise(limit_m_s, self.now_ns)
        return proven


def moved(joint: int, by_rad: float) -> list[float]:
    return [q + by_rad * (i == joint) for i, q in enumerate(Q)]


@pytest.mark.parametrize("links", [("drive",), ("drive", "monitor")])
def test_it_is_doubted_after_the_time_and_not_before(links: Sequence[str]) -> None:
    arm = Arm(links=links)
    assert arm.go(AFTER - 5)
    assert not arm.go(5)


def test_what_it_claims_does_not_prove_it() -> None:
    """A velocity that is too small to contradict the place, or another mode."""
    assert not Arm().go(AFTER, qd=(0.009,) * 6)
    assert not Arm().go(AFTER, mode=RobotMode.MANUAL)


@pytest.mark.parametrize("joint", range(6))
def test_any_joint_that_changes_proves_it(joint: int) -> None:
    arm = Arm()
    assert not arm.go(AFTER)
    assert arm.go(1, q=moved(joint, 3 * STEP))
    assert arm.go(AFTER - 5, q=moved(joint, 3 * STEP))  # from then on the time counts again
    assert not arm.go(5, q=moved(joint, 3 * STEP))


def test_noise_of_the_wire_proves_nothing() -> None:
    arm = Arm()
    for k in range(AFTER):
        proven = arm.go(1, q=moved(0, STEP * (k % 3)))
    assert not proven


def test_slow_motion_proves_it() -> None:
    """A tenth of a step of the wire in each state: 0.00125 rad/s."""
    arm = Arm()
    for k in range(3 * AFTER):
        assert arm.go(1, q=moved(0, round(k / 10) * STEP))


def test_time_in_which_it_is_held_does_not_count() -> None:
    arm = Arm()
    assert arm.go(10 * AFTER, limit_m_s=0.0)
    for _ in range(20):  # half of the time, in short spells; each ends with its first stop
        assert arm.go(2)
        assert arm.go(20, limit_m_s=0.0)
    assert not arm.go(AFTER)  # what it was permitted before adds up


def test_without_the_setting_no_robot_is_doubted() -> None:
    assert Arm(still_s=None).go(5 * AFTER)


def test_the_place_of_a_moving_base_counts() -> None:
    settings = mobile.settings_of(motion={"kind": "state", "still_s": STILL_S})
    robot = RobotTracker(settings, load_robot(settings, None))
    for k in range(4 * AFTER):
        now_ns = 10**9 + k * PERIOD_NS
        x_m = 0.0 if k < 2 * AFTER else 0.01 * (k - 2 * AFTER)
        robot.update(mobile.state(k + 1, mobile.standing(x_m=x_m)), now_ns)
        if AFTER < k < 2 * AFTER or k > 2 * AFTER + 1:
            assert robot.at(now_ns).proven is (k > 2 * AFTER)
        robot.advise(1.0, now_ns)
