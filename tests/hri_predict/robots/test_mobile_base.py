"""A base that moves: places, speeds, stops, and every way of not knowing where it is."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import BaseMotion
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.terms import travel_m
from hri_predict.robots.model import RobotModel, load_robot
from hri_predict.robots.settings import RobotSettings
from hri_predict.robots.stopping import StoppingTable
from hri_predict.robots.tracker import RobotTracker
from tests.hri_predict.robots.mobile import BASE, NOWHERE, Q, moving, settings_of, standing, state

MS = 1_000_000
MODEL = load_robot(settings_of(), None)
ALONE = load_robot(
    RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1), None
)
places, turns = st.floats(-3.0, 3.0), st.floats(-math.pi, math.pi)
speeds, rates = st.floats(-0.7, 0.7), st.floats(-0.8, 0.8)


def coordinates(x: float, y: float, yaw: float, q: Any = Q) -> Floats:
    return np.array([x, y, yaw, *q])


@given(places, places, turns)
def test_it_is_the_arm_where_the_base_is(x: float, y: float, yaw: float) -> None:
    placed, alone = MODEL.capsules(coordinates(x, y, yaw)), ALONE.capsules(np.array(Q))
    turn = np.array(
        [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
    )
    mount = np.array(BASE["base_from_robot"]["xyz"])
    count = len(ALONE.capsule_names)
    np.testing.assert_allclose(
        placed.a[:count], (alone.a + mount) @ turn.T + np.array([x, y, 0]), atol=1e-12
    )
    body = MODEL.capsule_names.index("base/body")
    expected = turn @ BASE["capsules"][0]["b"] + np.array([x, y, 0])
    np.testing.assert_allclose(placed.b[body], expected, atol=1e-12)
    np.testing.assert_allclose(
        MODEL.base_at(coordinates(x, y, yaw)), turn @ mount + np.array([x, y, 0]), atol=1e-12
    )
    far = np.linalg.norm(placed.a - MODEL.base_at(coordinates(x, y, yaw)), axis=-1) + placed.radius
    assert far.max() <= MODEL.reach_m


@given(speeds, speeds, rates, st.floats(-2.0, 2.0))
def test_its_speed_bounds_every_point_and_is_the_sum(
    vx: float, vy: float, turn: float, shoulder: float
) -> None:
    qd = np.array([vx, vy, turn, shoulder, 0, 0, 0, 0, 0])
    q, step = coordinates(0.5, 0.1, 0.7), 1e-6
    before, after = MODEL.capsules(q - qd * step / 2), MODEL.capsules(q + qd * step / 2)
    fastest = np.linalg.norm(after.a - before.a, axis=-1).max() / step
    speed = float(MODEL.tip_speed(q, qd))
    assert speed >= fastest - 1e-6
    assert MODEL.mobile is not None
    own = float(ALONE.tip_speed(q[3:], qd[3:]))
    assert speed == pytest.approx(own + float(MODEL.mobile.speed(qd)))


@given(st.floats(0.0, 1.5), st.floats(0.0, 1.5))
def test_however_a_speed_is_divided_the_table_covers_the_stop(arm: float, base: float) -> None:
    """Distances add, and the later of the two stands last."""
    assert MODEL.mobile is not None
    time_s, distance_m = MODEL.stopping(arm + base)
    alone_s, alone_m = ALONE.stopping(arm)
    assert distance_m >= alone_m + float(MODEL.mobile.table.distances_m(np.array(base))) - 1e-9
    assert time_s >= max(alone_s, float(MODEL.mobile.table.times_s(np.array(base)))) - 1e-9


@given(st.floats(0.0, 1.5), st.floats(0.0, 1.5), st.floats(0.0, 0.5))
def test_at_no_time_is_it_farther_than_one_speed_says(
    arm: float, base: float, reaction_s: float
) -> None:
    """The way in any direction, as the separation counts it, against both parts' own stops."""
    assert MODEL.mobile is not None
    times = np.linspace(0.0, 3.0, 61)
    stopping_s, stopping_m = MODEL.stopping(arm + base)
    farthest = travel_m(
        times,
        reaction_s=reaction_s,
        speed_m_s=arm + base,
        stopping_s=stopping_s,
        stopping_m=stopping_m,
    )
    of_base = MODEL.mobile.table
    true = arm * path_s(ALONE, arm, times, reaction_s) + base * of_base.travel_s(
        np.array([base]), times, reaction_s, of_base.times_s(np.array([base]))
    )
    assert np.all(true <= farthest + 2e-3)  # what is slower than 1 mm/s stands


def test_the_hold_is_bounded_at_every_speed_below() -> None:
    """A table whose hold falls and rises again."""
    table = StoppingTable(
        np.array([0.2, 0.5, 1.0, 1.5]),
        np.array([0.30, 0.35, 0.40, 1.00]),
        np.array([0.055, 0.10, 0.38, 0.80]),
    )
    below = np.linspace(0.01, 3.0, 600)
    hold = table.hold_s(below, table.times_s(below))
    for i in range(0, len(below), 7):
        assert hold[: i + 1].max() <= table.hold_most_s(below[i]) + 1e-12


@pytest.mark.parametrize("arc", [False, True], ids=["straight", "on an arc"])
@given(
    speeds,
    rates,
    st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6),
    st.floats(0, 0.4),
    st.floats(0.3, 1.0),
)
def test_it_stays_within_what_it_sweeps_until_it_stands(
    arc: bool, v: float, turn: float, arm: list[float], reaction_s: float, scale: float
) -> None:
    """Arm and base brake at the same moment, each as its own table says."""
    q, qd = coordinates(0.5, 0.1, 0.7), np.array([v * math.cos(0.7), v * math.sin(0.7), turn, *arm])
    assert MODEL.mobile is not None
    times = np.linspace(0.0, 2.0, 21)
    held = MODEL.stopping_capsules(
        q, qd, times_s=times, reaction_s=reaction_s, stopping_s=0.0, scale=np.array([scale])
    )
    fine = np.linspace(0.0, 2.0, 401)
    own = float(ALONE.tip_speed(q[3:], qd[3:])) * scale
    of_base = float(MODEL.mobile.speed(qd)) * scale
    u_arm = path_s(ALONE, own, fine, reaction_s)
    u_base = MODEL.mobile.table.travel_s(
        np.array([of_base]), fine, reaction_s, MODEL.mobile.table.times_s(np.array([of_base]))
    )
    true_q = q + scale * np.where(np.arange(9) < 3, u_base[:, None], u_arm[:, None]) * qd
    if arc:  # it drives where it heads
        heading = true_q[:, 2]
        way = scale * v * np.diff(u_base, prepend=0.0)
        true_q[:, 0] = q[0] + np.cumsum(way * np.cos(heading))
        true_q[:, 1] = q[1] + np.cumsum(way * np.sin(heading))
    true = MODEL.capsules(true_q)
    for k in range(1, len(times)):
        within = (fine >= times[k - 1]) & (fine <= times[k])
        one = Capsules(held.a[0, k], held.b[0, k], held.radius[0, k])
        shift = np.maximum(
            np.linalg.norm(true.a[within] - one.a, axis=-1),
            np.linalg.norm(true.b[within] - one.b, axis=-1),
        )
        slack = 1e-9 + 0.005 * abs(v * turn) * arc  # of the sum above
        assert np.all(shift + true.radius[within] <= one.radius + slack)


def path_s(model: RobotModel, speed: float, times: Floats, reaction_s: float) -> Floats:
    stopping_s = np.array([model.stopping(speed)[0]])
    return model.travel_s(np.array([speed]), times, reaction_s, stopping_s)


# --- what the controller says ---


def tracker(**more: Any) -> RobotTracker:
    settings = settings_of(**more)
    return RobotTracker(settings, load_robot(settings, None))


def test_it_is_moved_on_by_its_twist_over_the_states_age() -> None:
    robot = tracker(motion={"kind": "state", "stale_s": 0.2, "delay_s": 0.05})
    robot.update(state(1, moving(1.0, 2.0, 0.5, vx=0.4, vy=-0.2, turn=0.6)), 0)
    now = robot.at(100 * MS)
    assert not now.reasons
    assert now.q is not None
    np.testing.assert_allclose(now.q[:3], [1.06, 1.97, 0.59], atol=1e-12)
    assert robot.model.mobile is not None
    grown = (5.0 + 1.5) * 0.15**2 / 2
    assert now.uncertainty_m == pytest.approx(grown + robot.model.mobile.uncertainty_m)
    assert now.speed_m_s >= math.hypot(0.4, 0.2)


def test_without_a_base_nobody_knows_where_it_is() -> None:
    robot = tracker()
    robot.update(state(1, None), 0)
    assert robot.at(MS).reasons == (Reason.ROBOT_BASE_UNKNOWN,)
    robot.update(state(2, standing()), 2 * MS)
    assert not robot.at(3 * MS).reasons
    robot.update(state(3, None), 4 * MS)
    assert robot.at(5 * MS).reasons == (Reason.ROBOT_BASE_UNKNOWN,)


@pytest.mark.parametrize("what", list(NOWHERE))
def test_an_impossible_base_is_refused(what: str) -> None:
    robot = tracker()
    robot.update(state(1, NOWHERE[what]), 0)
    assert robot.at(MS).reasons == (Reason.ROBOT_STATE_INVALID,)
    assert robot.counters["invalid"] == 1


def test_a_stale_base_is_unknown() -> None:
    robot = tracker()
    robot.update(state(1, standing()), 0)
    assert Reason.ROBOT_STATE_STALE in robot.at(150 * MS).reasons


@pytest.mark.parametrize(
    ("then", "reason"),
    [
        (standing(x_m=0.3), Reason.ROBOT_STATE_JUMPED),
        (standing(yaw_rad=0.4), Reason.ROBOT_STATE_JUMPED),
        (standing(x_m=0.03), None),  # a correction of its localisation
        (standing(yaw_rad=2 * math.pi), None),
    ],
    ids=["jumped", "turned", "corrected", "whole turn"],
)
def test_a_base_that_jumps_is_unknown(then: BaseMotion, reason: Reason | None) -> None:
    robot = tracker()
    robot.update(state(1, standing()), 0)
    robot.update(state(2, then), 20 * MS)
    assert robot.at(25 * MS).reasons == (() if reason is None else (reason,))


def test_a_base_that_drives_but_says_that_it_stands_is_found_out() -> None:
    robot = tracker()
    for i in range(60):
        robot.update(state(i, standing(x_m=0.8 * i * 0.02)), i * 20 * MS)
    assert robot.at(60 * 20 * MS).reasons == (Reason.ROBOT_VELOCITY_WRONG,)


def test_a_base_of_a_robot_that_stands_is_refused() -> None:
    settings = RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1)
    robot = RobotTracker(settings, ALONE)
    robot.update(state(1, standing()), 0)
    assert robot.at(MS).reasons == (Reason.ROBOT_STATE_INVALID,)
    robot.update(state(2, None), 2 * MS)
    assert not robot.at(3 * MS).reasons


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"room_from_robot": {}}, "give either room_from_robot.*quaternion_xyzw: .0, 0, 0.7071"),
        ({"base": {"capsules": []}}, "base.capsules"),
        ({"base": {"uncertainty_m": None}}, "base.uncertainty_m"),
        ({"base": {"max_speed_m_s": 0}}, "base.max_speed_m_s"),
        ({"base": {"kind": "fixed"}}, "base.kind"),
        ({"base": {"speed": 1}}, "base.speed"),
        ({"motion": {"kind": "state", "plan": "pick_and_place"}}, "without plan"),
        ({"motion": {"kind": "standing", "positions": list(Q)}}, "without plan"),
    ],
)
def test_mistakes(more: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        settings_of(**more)
