"""Loops and arrays agree on where a robot is, how fast it moves, and how it moves on and stops.

They add up in different orders. A position is a sum of some tens of products of at most metres, so
both are within some hundred times 2e-16 of the truth; through phases, which are sums of some
hundred steps of at most seconds, within some hundred times that. 1e-10 is far above both.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.base.settings import Pose
from hri_predict.robots.body import ahead, sweeping
from hri_predict.robots.model import RobotModel, RobotSettings, load_robot
from hri_predict.robots.plan import Plan
from hri_predict.robots.trajectory import load_trajectory
from tests.hri_predict.robots import mobile, nine_joints

ARM = load_robot(
    RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1.0), None
)
MOBILE = load_robot(mobile.settings_of(), None)
NEAR = 1e-10


def near(one, other) -> None:
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=NEAR, atol=NEAR)


@pytest.fixture(scope="module", params=["arm", "on a base", "with rails"])
def model(request, tmp_path_factory) -> RobotModel:
    if request.param == "with rails":
        return nine_joints.model(tmp_path_factory.mktemp("robot"))
    return ARM if request.param == "arm" else MOBILE


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), standing=st.booleans())
def test_places_speeds_and_swept_capsules(model: RobotModel, seed: int, standing: bool):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.0, 1.0, (2, 4, model.dof))
    q[:, 2] = q[:, 1]  # it has come to rest
    rows, geometry, pieces = q.reshape(8, -1), model._geometry, model._pieces
    qd = np.zeros_like(rows) if standing else rng.normal(size=rows.shape)
    near(
        sweeping.moving(geometry, rows, qd),
        sweeping._moving_by_arrays(geometry, rows, qd),
    )
    hung = pieces.arms, pieces.behind, pieces.beyond
    half = rng.uniform(0, 0.1, (2, 4))
    half[:, [0, 2]] = 0.0
    for shape in ((1, 1, model.dof), q.shape):
        path = q, rng.uniform(0, 2, shape), rng.uniform(0, 2, shape), half
        near(
            sweeping.swept(geometry, hung, path),
            sweeping._swept_by_arrays(geometry, hung, path),
        )


def test_what_is_no_number_stays_none():
    q = np.zeros((1, ARM.dof))
    for by in (sweeping.moving, sweeping._moving_by_arrays):
        for bad in (np.nan, np.inf):
            with np.errstate(invalid="ignore"):
                speed = by(ARM._geometry, q, np.full_like(q, bad))[1]
            assert not np.isfinite(speed).any()


PLAN = Plan(load_trajectory("pick_and_place", ARM, None), ARM)
TIMES = np.arange(26) / 25.0


@pytest.mark.parametrize("phases", [ahead.phases, ahead._phases_by_loops])
@given(
    start_s=st.floats(0, 30),
    reaction_s=st.floats(0.01, 0.6),
    most=st.sampled_from([1.0, 1.1]),
    speeds=st.lists(st.floats(0, 2), min_size=1, max_size=3).map(np.array),
    stretch=st.sampled_from([1.0, 1.4]),
    base=st.booleans(),
)
def test_along_a_plan(phases, start_s, reaction_s, most, speeds, stretch, base):
    *arm, _, _, _ = ARM.stopping_tables
    of_base = (np.array([0.5, 1.0]), np.array([0.4, 0.9])) if base else (np.empty(0), np.empty(0))
    tables = *arm, *of_base, stretch
    path = PLAN._closed, PLAN._speed, PLAN._step_s
    asked = path, tables, (start_s, reaction_s, most), (speeds, TIMES)
    one, other = phases(*asked), ahead._phases_by_arrays(*asked)
    near(one, other)
    moves = PLAN.trajectory.moves
    near(ahead.stretches(moves, other[0]), ahead._stretches_by_arrays(moves, other[0]))


def test_bounds_of_a_path_that_passes_many_moves():
    phases_s = np.array([[0.0, 0.1, 5.0, 6.3, 12.9]])
    moves = PLAN.trajectory.moves
    near(ahead._stretches_by_loops(moves, phases_s), ahead._stretches_by_arrays(moves, phases_s))


@pytest.mark.parametrize("straight", [ahead.straight, ahead._straight_by_loops])
@given(
    factors=st.lists(st.floats(0, 3), min_size=1, max_size=3).map(np.array),
    speed_m_s=st.floats(0, 2),
    reaction_s=st.floats(0, 0.6),
    stopping_s=st.sampled_from([0.0, 0.2, 0.7]),
)
def test_straight_on(straight, factors, speed_m_s, reaction_s, stopping_s):
    joints = np.linspace(-1, 1, ARM.dof), np.linspace(2, -1, ARM.dof)
    moves = factors, np.full(len(factors), stopping_s), speed_m_s
    asked = joints, ARM.stopping_tables, moves, (TIMES, reaction_s)
    near(straight(*asked), ahead._straight_by_arrays(*asked))
