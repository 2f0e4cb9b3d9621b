"""The planned path: found from the robot's state, and followed and stopped on as foreseen."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RobotError
from hri_predict.base.settings import Pose
from hri_predict.robots.model import StateMotion, load_robot
from hri_predict.robots.plan import OnPlan, Plan
from hri_predict.robots.tracker import RobotTracker
from hri_predict.robots.trajectory import Trajectory, load_trajectory
from tests.arms import arm_settings
from tests.messages import make_state

ROBOT = arm_settings(
    room_from_robot=Pose(xyz=[0.2, 0.1, 0.4]), motion=StateMotion(plan="pick_and_place")
)
MODEL = load_robot(ROBOT, None)
PATH = load_trajectory("pick_and_place", MODEL, None)
PLAN = Plan(PATH, MODEL)
TIMES = np.arange(26) / 25.0

phases = st.floats(0, PATH.duration_s)
levels = st.floats(0.02, 1.0)
reactions = st.floats(0.02, 0.5)


def contained(model, swept, q) -> float:
    """How far any capsule at configurations q (M, N) sticks out of capsules (C,), metres."""
    placed = model.capsules(q)
    worst = -np.inf
    for part in np.linspace(0.0, 1.0, 5):  # points along each axis, against the same of the swept
        point = placed.a + part * (placed.b - placed.a)
        centre = swept.a + part * (swept.b - swept.a)
        out = np.linalg.norm(point - centre, axis=-1) + placed.radius - swept.radius
        worst = max(worst, float(out.max()))
    return worst


def located(q: Floats, qd: Floats, expected_s: float | None) -> OnPlan:
    """Where ``PLAN`` finds a robot that is on it."""
    found = PLAN.locate(q, qd, expected_s)
    assert found is not None
    return found


@given(phases, levels, reactions)
@pytest.mark.long
def test_capsules_contain_the_robot_during_whole_intervals(start, speed, reaction_s):
    swept, _ = PLAN.stopping_capsules(
        OnPlan(start, 1.0), np.array([speed, speed / 3]), TIMES, reaction_s
    )
    for row, v in enumerate((speed, speed / 3)):
        for k in (0, 1, 5, 9, 15, 25):
            dense = np.linspace(TIMES[max(k - 1, 0)], TIMES[k], 9)
            found, _ = PLAN.phases(OnPlan(start, 1.0), np.array([v]), dense, reaction_s)
            q, _ = PATH.at(found[0])
            one = type(swept)(swept.a[row, k], swept.b[row, k], swept.radius[row, k])
            assert contained(MODEL, one, q) <= 1e-9


def test_capsules_hold_where_a_path_bends_sharply_between_short_moves():
    # moves of 30 ms, shorter than an interval of 40 ms: every joint turns back and forth
    turn = 0.02 * np.array([[0, 0, 0, 0, 0, 0], [1, -1, 1, 1, -1, 1], [0, 1, 0, -1, 1, 0]])
    positions = np.array([2.9, -1.0, 1.0, -1.3, -1.57, 0.0]) + turn[[0, 1, 2, 0]]
    path = Trajectory(np.array([0.0, 0.03, 0.06, 0.09]), positions)
    plan = Plan(path, MODEL)
    for start in np.linspace(0, 0.09, 7):
        swept, _ = plan.stopping_capsules(OnPlan(start, 1.0), np.array([0.5]), TIMES[:8], 0.2)
        for k in range(8):
            dense = np.linspace(TIMES[max(k - 1, 0)], TIMES[k], 41)
            q, _ = path.at(plan.phases(OnPlan(start, 1.0), np.array([0.5]), dense, 0.2)[0][0])
            one = type(swept)(swept.a[0, k], swept.b[0, k], swept.radius[0, k])
            assert contained(MODEL, one, q) <= 1e-9


def test_capsules_hold_where_a_step_passes_a_whole_short_move_of_a_path_of_two():
    # from the end of the long move through the short one, back into the long one
    low = np.array([0.0, -1.0, 1.0, -1.3, -1.57, 0.0])
    high = low + np.array([0.045, 0.045, 0.0, 0.0, 0.0, 0.0])
    path = Trajectory(np.array([0.0, 0.55, 0.58]), np.array([low, high, low]))
    plan = Plan(path, MODEL)
    for start in np.linspace(0.5, 0.58, 17):
        here = OnPlan(start, 1.0)
        swept, _ = plan.stopping_capsules(here, np.array([9.0]), TIMES[:3], 0.2)
        for k in range(3):
            dense = np.linspace(TIMES[max(k - 1, 0)], TIMES[k], 41)
            q, _ = path.at(plan.phases(here, np.array([9.0]), dense, 0.2)[0][0])
            one = type(swept)(swept.a[0, k], swept.b[0, k], swept.radius[0, k])
            assert contained(MODEL, one, q) <= 1e-9


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.05, 1.08])
def test_a_robot_that_is_faster_than_its_plan_is_foreseen_as_fast_as_it_is(factor):
    for start in np.linspace(1.4, 2.8, 8):
        q, qd = PATH.at_phase(start, factor)
        found = located(q, qd, None)
        assert found.rate == pytest.approx(factor, rel=1e-6)
        swept, _ = PLAN.stopping_capsules(found, np.array([9.0]), TIMES[:9], 0.32)
        q, _ = PATH.at(start + max(factor, 1.0) * TIMES[:9])
        placed = MODEL.capsules(q)
        for k in range(9):
            one = type(swept)(swept.a[0, k], swept.b[0, k], swept.radius[0, k])
            assert contained(MODEL, one, q[k : k + 1]) <= 1e-6
        assert len(placed.radius)


def test_capsules_are_not_needlessly_wide():
    # at 1 m/s an interval of 40 ms is 40 mm long: half of it, and a fifth more, must do
    swept, _ = PLAN.stopping_capsules(OnPlan(1.6, 1.0), np.array([1.0]), TIMES, 0.4)
    bare = MODEL.capsules(PATH.at(1.6)[0]).radius
    assert (swept.radius - bare).max() < 0.024


@given(phases, levels, reactions)
def test_the_fastest_point_keeps_to_the_speed_and_then_brakes(start, speed, reaction_s):
    fine = np.linspace(0.0, 1.2, 1201)
    found, stands_s = PLAN.phases(OnPlan(start, 1.0), np.array([speed]), fine, reaction_s)
    assert (np.diff(found[0]) >= -1e-12).all()
    rate = np.diff(found[0]) / np.diff(fine)
    assert rate.max() <= 1.0 + 1e-6
    middle = (found[0][1:] + found[0][:-1]) / 2
    tip = MODEL.tip_speed(*PATH.at_phase(middle, rate))
    follows = fine[1:] <= reaction_s
    # the rate is held over 10 ms of the path, on which the speed rises by up to 0.06 m/s
    assert tip[follows].max(initial=0.0) <= speed + 0.03
    after = fine[:-1] >= stands_s[0]
    assert rate[after].max(initial=0.0) == pytest.approx(0.0, abs=1e-9)


def test_braking_takes_the_time_and_the_distance_of_the_table():
    # on the swing from 1.0 to 3.2 s the fastest point is slowly varying about its peak at 2.1 s
    v = float(MODEL.tip_speed(*PATH.at(2.0)))
    time_s, distance_m = MODEL.stopping(v)
    found, stands_s = PLAN.phases(OnPlan(1.9, 1.0), np.array([5.0]), np.array([0.1, 5.0]), 0.1)
    assert stands_s[0] == pytest.approx(0.1 + time_s, rel=1e-3)
    assert found[0, 0] == pytest.approx(2.0, abs=1e-6)
    assert (found[0, 1] - found[0, 0]) * v == pytest.approx(distance_m, rel=1e-3)


def test_a_standing_robot_stays_where_it_is():
    found, stands_s = PLAN.phases(OnPlan(2.0, 0.0), np.array([0.0]), TIMES, 0.3)
    np.testing.assert_allclose(found, 2.0, atol=1e-6)
    assert stands_s[0] == 0.3


@given(st.floats(0, PATH.duration_s), st.floats(0.1, 1.0))
def test_a_state_on_the_path_is_found(phase, rate):
    q, qd = PATH.at_phase(phase, rate)
    found = located(q, qd, phase - 0.02)
    there, _ = PATH.at(found.phase_s)
    np.testing.assert_allclose(there, q, atol=5e-4)
    if np.abs(qd).max() > 0.2:
        assert found.rate == pytest.approx(rate, abs=0.02)
        away = (found.phase_s - phase) % PATH.duration_s
        assert min(away, PATH.duration_s - away) < 0.005


def test_the_direction_of_motion_tells_there_from_back():
    q, qd = PATH.at(0.25)  # down to the pick; at 0.75 the same way up
    assert located(q, qd, None).phase_s == pytest.approx(0.25, abs=1e-3)
    assert located(q, -qd, None).phase_s == pytest.approx(0.75, abs=1e-3)
    # at rest half way it may be either: what it did last decides, and without that it is not known
    still = np.zeros(6)
    assert PLAN.locate(q, still, None) is None
    assert located(q, still, 0.2).phase_s == pytest.approx(0.25, abs=1e-3)
    assert located(q, still, 0.8).phase_s == pytest.approx(0.75, abs=1e-3)


def test_what_is_not_on_the_path_is_not_found():
    q, qd = PATH.at(2.0)
    assert PLAN.locate(q + 0.05 * np.eye(6)[2], qd, 2.0) is None
    assert PLAN.locate(q, qd + 0.2 * np.eye(6)[1], 2.0) is None
    assert PLAN.locate(q, 1.5 * qd, 2.0) is None  # faster than planned
    assert located(q, -qd, 2.0).phase_s == pytest.approx(5.4)  # the way back
    assert PLAN.locate(q * np.nan, qd, 2.0) is None


def test_what_the_joints_are_off_the_path_widens_the_robot():
    q, qd = PATH.at(2.0)
    off = np.array([0, 0.01, 0, 0, 0, 0])
    found = located(q + off, qd, 2.0)
    moved = MODEL.capsules(q + off)
    on = MODEL.capsules(PATH.at(found.phase_s)[0])
    shift = max(np.linalg.norm(moved.a - on.a, axis=-1).max(), 0)
    assert found.off_m >= shift > 0.003
    there, _ = PLAN.stopping_capsules(found, np.array([0.0]), TIMES[:2], 0.3)
    assert (there.radius >= on.radius + shift).all()


def test_a_tracker_finds_its_robot_on_the_plan_and_loses_it():
    tracker = RobotTracker(ROBOT, MODEL)
    now = 10**9
    for i in range(10):
        q, qd = PATH.at(1.5 + 0.02 * i)
        tracker.update(
            make_state(tuple(q), tuple(qd), counter=i),
            now,
        )
        here = tracker.at(now + 5_000_000).on_plan
        assert here is not None
        assert here.phase_s == pytest.approx(1.5 + 0.02 * i + 0.005, abs=1e-3)
        now += 20_000_000
    tracker.update(
        make_state(tuple(q + 0.1), tuple(qd), counter=99),
        now,
    )
    assert tracker.at(now).on_plan is None


def test_a_plan_that_is_too_fast_is_refused():
    slow = ROBOT.model_copy(update={"max_speed_m_s": 0.3})
    with pytest.raises(RobotError, match=r"at 0\.952 m/s, above max_speed_m_s 0\.3; use one whose"):
        RobotTracker(slow, MODEL)
