"""The start of a forecast: filtered by a line's slope before training, with an open gate."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import HriPredictError
from hri_predict.base.settings import validated
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Shape
from hri_predict.predictors.sinn.model import SINN, SINNOptions
from hri_predict.predictors.sinn.start import Start, gated, least_squares_slope

SHAPE = Shape(skeleton=BODY, history_steps=12, horizon_steps=10, rate_hz=25.0)


def window(positions: torch.Tensor) -> BodyFrames:
    return BodyFrames(positions, torch.ones(positions.shape[:3], dtype=torch.bool))


@given(st.integers(2, 25))
def test_the_weights_are_a_fitted_lines_slope(frames):
    weights = least_squares_slope(frames).double()
    assert float(weights.sum()) == pytest.approx(1.0, abs=1e-6)  # 24 floats of 6e-8
    generator = torch.Generator().manual_seed(frames)
    values = torch.randn(frames, generator=generator, dtype=torch.float64)
    time = torch.arange(frames, dtype=torch.float64) - (frames - 1) / 2
    slope = (time * values).sum() / time.square().sum()
    assert float((weights * values.diff()).sum()) == pytest.approx(float(slope), abs=1e-5)


def test_untrained_it_starts_at_the_last_pose_with_the_lines_velocity():
    start = Start(28, 7, 8, gate=True)
    step = torch.randn(2, 1, 28, 3) * 0.03
    line = window(torch.randn(2, 1, 28, 3) + step * torch.arange(12).view(1, -1, 1, 1))
    started = start(line, 25.0)
    last = started.last
    torch.testing.assert_close(last, line.positions[:, -1:])
    # differences of positions of 3 m in 32-bit floats, times 25: 2e-7 x 3 x 25, times ten
    torch.testing.assert_close(started.velocity, step * 25, rtol=0, atol=2e-4)
    assert started.gate is not None
    moved = gated(last, last + 1.0, started.gate) - last
    torch.testing.assert_close(moved, torch.full_like(moved, 0.982), rtol=0, atol=1e-3)


def test_white_noise_moves_the_untrained_velocity_a_third_as_much():
    noise = 0.02 * torch.randn(200, 12, 28, 3, generator=torch.Generator().manual_seed(1))
    velocity = Start(28, 7, 8, gate=False)(window(noise), 25.0).velocity
    # a slope over 7 frames: sigma / sqrt(28); a difference of two: sigma sqrt(2)
    assert float(velocity.detach().std() / 25) == pytest.approx(0.02 / 28**0.5, rel=0.05)


def test_filters_do_not_depend_on_where_or_how_a_person_stands():
    start = Start(28, 7, 8, gate=True)
    torch.manual_seed(2)
    torch.nn.init.normal_(start.head.weight, std=0.3)
    walk = torch.randn(2, 12, 28, 3).cumsum(1) * 0.02
    turn = torch.linalg.qr(torch.randn(3, 3))[0]
    there = start(window(walk), 25.0)
    elsewhere = start(window(walk @ turn + 2.0), 25.0)
    # 32-bit floats at 3 m: 2e-7 m, times 25 for velocities, times a network's few operations
    torch.testing.assert_close(elsewhere.last, there.last @ turn + 2.0, rtol=0, atol=1e-4)
    torch.testing.assert_close(elsewhere.velocity, there.velocity @ turn, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(elsewhere.gate, there.gate, rtol=1e-2, atol=1e-3)


def test_a_shut_gate_stands_still():
    last = torch.randn(2, 1, 28, 3)
    shut = torch.full((2, 28, 2), -40.0)
    ahead = gated(last, last + torch.randn(2, 10, 28, 3), shut)
    torch.testing.assert_close(ahead, last.expand_as(ahead))


def test_every_part_of_the_start_learns():
    network = SINN(SHAPE, SINNOptions(hidden=16, critic_steps=10, start_frames=7, gate=True))
    torch.nn.init.normal_(network.start.head.weight, std=0.1)  # type: ignore[union-attr]
    walk = window(torch.randn(3, 12, 28, 3).cumsum(1) * 0.02)
    network(walk).square().sum().backward()
    assert network.start is not None
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in network.start.parameters())


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"start_frames": 1}, "one frame has no velocity"),
        ({"start_frames": 7, "representation": "position"}, "positions have no first velocity"),
        ({"gate": True}, "set start_frames"),
        ({"spread": True}, "set start_frames"),
    ],
)
def test_options_that_contradict_are_refused_in_one_line(options, says):
    with pytest.raises(HriPredictError, match=says) as error:
        validated(SINNOptions, options, "options")
    assert "\n" not in str(error.value)
