"""The body's own frame, and filling in what was not observed."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.body_frame import body_frame, fill, neighbour_table
from hri_predict.predictors.neural.network import Network, Shape

STEPS, JOINTS = 15, len(BODY.joints)


def windows(count: int = 8, seen: float = 0.7, seed: int = 1) -> tuple[torch.Tensor, torch.Tensor]:
    rng = torch.Generator().manual_seed(seed)
    walk = 0.02 * torch.randn(count, STEPS, JOINTS, 3, generator=rng, dtype=torch.float64)
    place = torch.randn(count, 1, JOINTS, 3, generator=rng, dtype=torch.float64)
    return place + walk.cumsum(1), torch.rand(count, STEPS, JOINTS, generator=rng) < seen


@pytest.fixture
def network() -> Network:
    network = Network(Shape(skeleton=BODY, history_steps=STEPS, horizon_steps=25, rate_hz=25.0))
    network.rest.copy_(torch.randn(JOINTS, 3, generator=torch.Generator().manual_seed(2)))
    return network


def turned(positions: torch.Tensor, yaw: float) -> torch.Tensor:
    c, s = math.cos(yaw), math.sin(yaw)
    matrix = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=positions.dtype)
    return positions @ matrix.T


def test_leaving_undoes_entering():
    positions, observed = windows()
    frame = body_frame(positions, observed, BODY)
    torch.testing.assert_close(frame.leave(frame.enter(positions)), positions)


@settings(max_examples=20)
@given(yaw=st.floats(-3.1, 3.1), x=st.floats(-50, 50), y=st.floats(-50, 50), z=st.floats(-2, 2))
def test_window_does_not_depend_on_where_in_the_room_and_which_way_faced(yaw, x, y, z):
    network = Network(Shape(skeleton=BODY, history_steps=STEPS, horizon_steps=25, rate_hz=25.0))
    positions, observed = windows()
    observed[:, 3, [BODY.index("l_hip"), BODY.index("r_hip")]] = True
    moved = turned(positions, yaw) + torch.tensor([x, y, z], dtype=positions.dtype)
    here, _ = network.enter(positions, observed)
    there, _ = network.enter(moved, observed)
    torch.testing.assert_close(there.positions, here.positions, rtol=0, atol=1e-4)


def test_origin_is_between_the_hips_and_left_is_y():
    positions, observed = windows(seen=1.0)
    entered = body_frame(positions, observed, BODY).enter(positions)[:, -1]
    left, right = entered[:, BODY.index("l_hip")], entered[:, BODY.index("r_hip")]
    torch.testing.assert_close((left + right) / 2, torch.zeros_like(left))
    across = left - right
    torch.testing.assert_close(across[:, 0], torch.zeros_like(across[:, 0]))
    assert (across[:, 1] > 0).all()


def test_without_hips_the_pelvis_and_then_the_centroid_is_the_origin():
    positions, observed = windows(seen=1.0)
    observed[:, :, [BODY.index("l_hip"), BODY.index("r_hip")]] = False
    frame = body_frame(positions, observed, BODY)
    torch.testing.assert_close(frame.origin, positions[:, -1, BODY.index("pelvis")])
    observed[:, :, BODY.index("pelvis")] = False
    frame = body_frame(positions, observed, BODY)
    torch.testing.assert_close(frame.origin, positions[:, -1][:, observed[0, -1]].mean(1))


def test_what_is_not_observed_does_not_matter(network):
    positions, observed = windows(seen=0.5)
    garbage = torch.where(observed[..., None], positions, 1e6)
    one, _ = network.enter(positions, observed)
    other, _ = network.enter(garbage, observed)
    assert torch.equal(one.positions, other.positions)


def test_observed_values_stay_and_everything_is_finite(network):
    positions, observed = windows(seen=0.3)
    observed[0] = False
    observed[1, :, 5:] = False
    window, frame = network.enter(positions, observed)
    assert torch.isfinite(window.positions).all()
    entered = frame.enter(positions)[observed].to(window.positions.dtype)
    assert torch.equal(window.positions[observed], entered)


def test_nobody_observed_stands_in_the_rest_pose(network):
    positions, observed = windows()
    window, _ = network.enter(positions, torch.zeros_like(observed))
    torch.testing.assert_close(window.positions, network.rest.expand_as(window.positions))


def test_joints_on_a_line_are_filled_along_it():
    time = torch.arange(float(STEPS)).view(1, -1, 1, 1)
    line = (time * torch.tensor([1.0, -2.0, 0.5])).expand(1, STEPS, JOINTS, 3)
    observed = torch.ones(1, STEPS, JOINTS, dtype=torch.bool)
    observed[:, 4:7, 3] = False  # between two observations
    observed[:, -2:, 9] = False  # after the last
    observed[:, :3, 12] = False  # before the first: stays there
    observed[:, 8:, 20] = False  # lost for 7 steps: goes on for 3
    clean = torch.where(observed[..., None], line, 0.0)
    filled = fill(clean, observed, torch.zeros(JOINTS, 3), neighbour_table(BODY))
    torch.testing.assert_close(filled[:, :, [3, 9]], line[:, :, [3, 9]])
    torch.testing.assert_close(filled[:, :3, 12], line[:, 3:4, 12].expand(1, 3, 3))
    torch.testing.assert_close(filled[:, :11, 20], line[:, :11, 20])
    torch.testing.assert_close(filled[:, 11:, 20], line[:, 10:11, 20].expand(1, 4, 3))


def test_a_joint_never_seen_keeps_its_offset_in_the_rest_pose(network):
    positions, observed = windows(seen=1.0)
    hand, wrist = BODY.index("l_hand"), BODY.index("l_wrist")
    knuckles = BODY.index("l_knuckles")
    observed[:, :, [hand, knuckles]] = False
    window, _ = network.enter(positions, observed)
    offset = network.rest[hand] - network.rest[wrist]
    torch.testing.assert_close(window.positions[:, :, hand], window.positions[:, :, wrist] + offset)


def test_a_framed_shape_is_left_where_it_is():
    network = Network(
        Shape(skeleton=BODY, history_steps=STEPS, horizon_steps=25, rate_hz=25.0, framed=True)
    )
    positions, observed = windows(seen=1.0)
    window, frame = network.enter(positions, observed)
    torch.testing.assert_close(window.positions, positions.float())
    assert torch.equal(frame.leave(positions), positions)
