"""What touches meant: parts, speeds and clamping, on a robot that is a ball."""

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules
from hri_predict.base.skeleton import CANONICAL
from hri_predict.risk.fixtures import PlaneFixture
from hri_sim.referee import Referee
from hri_sim.simulation.harm import NAMES, Bearable, Harm

MS = 1_000_000
BALL = 0.1
RADIUS = {s.name: s.radius for s in CANONICAL.segments}
WALL = PlaneFixture(kind="plane", name="wall", point=[2.0, 0, 0], normal=[-1.0, 0, 0])


class Ball:
    """A robot that is a ball on the x axis, at its one joint's value."""

    name = "ball"

    def counting(self, tool):
        return self

    def capsules(self, q):
        centre = np.concatenate([q, np.zeros((*q.shape[:-1], 2))], axis=-1)[..., None, :]
        return Capsules(centre, centre, np.full(centre.shape[:-1], BALL))

    def tip_speed(self, q, qd):
        return np.abs(qd[..., 0])


def judged(limits, *, fixtures=(), clamped=0.1):
    """Referee and harm; every part that is not named bears 5 m/s."""
    free = np.array([limits.get(name, 5.0) for name in NAMES])
    harm = Harm({"ball": Bearable(free, np.full(len(NAMES), clamped), fixtures)})
    referee = Referee([Ball()], 0.0, on_contact=harm.note)  # type: ignore[list-item]  # all that it asks
    return referee, harm


def forearm(x):
    positions = np.full((len(CANONICAL.joints), 3), np.nan)
    positions[CANONICAL.index("l_elbow")] = x, -0.2, 0
    positions[CANONICAL.index("l_wrist")] = x, 0.2, 0
    return {1: (positions, np.isfinite(positions).all(axis=1))}


def ball(x, speed):
    return {"ball": (np.array([x]), np.array([speed]))}


TOUCH = RADIUS["l_forearm"] + BALL


def test_a_touch_tells_part_and_speed():
    referee, harm = judged({"l_forearm": 0.6})
    referee.observe(0, forearm(TOUCH - 0.01), ball(0.0, 0.5))
    assert harm.touch_speeds_m_s == {"l_forearm": 0.5}
    assert (harm.touches_beyond, harm.touches_forbidden, harm.clampings) == (0, 0, 0)
    referee.observe(40 * MS, forearm(TOUCH - 0.01), ball(0.0, 0.7))
    assert harm.touch_speeds_m_s == {"l_forearm": pytest.approx(0.7)}
    assert harm.touches_beyond > 0


def test_a_standing_robot_harms_nobody():
    referee, harm = judged({"l_forearm": 0.0})
    referee.observe(0, forearm(TOUCH - 0.01), ball(0.0, 0.0))
    referee.observe(40 * MS, forearm(TOUCH - 0.05), ball(0.0, 0.0))
    assert (harm.touch_speeds_m_s, harm.touches_forbidden) == ({}, 0)


def test_what_bears_nothing_is_forbidden():
    referee, harm = judged({"l_forearm": 0.0})
    referee.observe(0, forearm(TOUCH - 0.01), ball(0.0, 0.02))
    assert harm.touches_forbidden == 1


def test_the_parts_own_speed_counts_in_the_relative_one():
    referee, harm = judged({"l_forearm": 0.6})
    referee.observe(0, forearm(TOUCH + 0.03), ball(0.0, 0.3))
    referee.observe(100 * MS, forearm(TOUCH - 0.02), ball(0.0, 0.3))  # 0.5 m/s towards it
    assert harm.touch_relative_m_s["l_forearm"] == pytest.approx(0.8)
    assert harm.touches_beyond == 0
    assert harm.touches_relative_beyond > 0


@pytest.mark.parametrize(
    ("x", "speed", "clamped"), [(1.88, 0.2, True), (1.88, 0.05, False), (1.0, 0.2, False)]
)
def test_a_part_between_link_and_wall_is_clamped_if_the_robot_is_too_fast(x, speed, clamped):
    referee, harm = judged({}, fixtures=[WALL])
    arm = x + 0.08  # at 1.96 the forearm touches the wall
    referee.observe(0, forearm(arm), ball(arm - TOUCH + 0.01, speed))
    assert (harm.clampings > 0) is clamped


def test_an_instant_counts_once_whatever_the_number_of_people_and_parts():
    (joints, _) = forearm(1.96)[1]
    joints[CANONICAL.index("r_elbow")] = 1.96, -0.2, 0.02
    joints[CANONICAL.index("r_wrist")] = 1.96, 0.2, 0.02
    both = joints, np.isfinite(joints).all(axis=1)
    referee, harm = judged({"l_forearm": 0.0, "r_forearm": 0.0}, fixtures=[WALL])
    referee.observe(0, {1: both, 2: both}, ball(1.96 - TOUCH + 0.01, 0.2))
    assert set(harm.touch_speeds_m_s) == {"l_forearm", "r_forearm"}
    assert (harm.touches_beyond, harm.touches_relative_beyond) == (1, 1)
    assert (harm.touches_forbidden, harm.clampings) == (1, 1)
