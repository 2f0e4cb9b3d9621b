"""The mixer: what it starts from, its symmetry, and that it learns."""

from typing import Any

import numpy as np
import pytest
import torch

from hri_predict.base.skeleton import make_skeleton
from hri_predict.predictors.mixer import Mixer, MixerOptions, cosine_matrix
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Shape, Target, last_pose, mpjpe

SHAPE = Shape(skeleton=BODY, history_steps=12, horizon_steps=9, rate_hz=25.0)
SMALL: dict[str, Any] = {"width": 16, "blocks": 1}


def network(shape: Shape = SHAPE, **options: Any) -> Mixer:
    torch.manual_seed(0)
    return Mixer(shape, MixerOptions(**options))


def stirred(shape: Shape = SHAPE, **options: Any) -> Mixer:
    """A network whose head says something."""
    net = network(shape, **options)
    torch.nn.init.normal_(net.head.weight, std=0.1)
    return net.eval()


def window(people: int = 3, shape: Shape = SHAPE) -> BodyFrames:
    generator = torch.Generator().manual_seed(1)
    size = (people, shape.history_steps, shape.joints)
    positions = torch.randn(*size, 3, generator=generator)
    return BodyFrames(positions, torch.rand(*size, generator=generator) > 0.1)


def mirrored(positions: torch.Tensor) -> torch.Tensor:
    order = list(range(28))
    for left, right in BODY.left_right_pairs:
        order[left], order[right] = right, left
    return positions[:, :, order] * torch.tensor([1.0, -1.0, 1.0])


def transformed(signal: np.ndarray) -> np.ndarray:
    """DCT-II of rows, by the Fourier transform of each row and its reversal."""
    steps = signal.shape[1]
    spectrum = np.fft.fft(np.concatenate([signal, signal[:, ::-1]], axis=1))[:, :steps]
    turned = 0.5 * (spectrum * np.exp(-0.5j * np.pi * np.arange(steps) / steps)).real
    scale = np.full(steps, np.sqrt(2 / steps))
    scale[0] = np.sqrt(1 / steps)
    return turned * scale


@pytest.mark.parametrize("steps", [2, 12, 25])
def test_the_transform_is_the_orthonormal_cosine_transform(steps: int) -> None:
    signal = np.random.default_rng(0).normal(size=(3, steps))
    mine = torch.tensor(signal) @ cosine_matrix(steps).double()
    # products of float32 cosines: a rounding each, over `steps` terms of magnitude 3
    atol = 3 * steps * float(np.finfo(np.float32).eps)
    np.testing.assert_allclose(mine.numpy(), transformed(signal), atol=atol)


def test_an_untrained_network_stands_still() -> None:
    given = window()
    assert torch.equal(network().eval()(given), last_pose(given).expand(-1, 9, -1, -1))


def test_a_factor_of_one_carries_the_velocity_on() -> None:
    net = network(mirrored=False).eval()
    with torch.no_grad():
        net.head.bias.view(28, 6)[:, 0] = 1.0  # the factor of the velocity over one step
    step = torch.tensor([0.01, -0.02, 0.005])
    positions = torch.arange(12.0)[None, :, None, None] * step + torch.randn(1, 1, 28, 3)
    found = net(BodyFrames(positions, torch.ones(1, 12, 28, dtype=torch.bool)))
    ahead = torch.arange(1.0, 10.0)[None, :, None, None] * step
    torch.testing.assert_close(found, positions[:, -1:] + ahead, rtol=0, atol=1e-5)


def test_left_and_right_are_alike() -> None:
    net, given = stirred(**SMALL), window()
    order = [int(i) for i in net.mirror.order]
    other = BodyFrames(mirrored(given.positions), given.observed[:, :, order])
    forecast = net(given)
    assert (forecast - last_pose(given)).abs().max() > 0.01
    torch.testing.assert_close(net(other), mirrored(forecast), rtol=1e-5, atol=1e-5)


def test_a_body_without_sides_has_no_mirror_image() -> None:
    skeleton = make_skeleton("s", list("abc"), [-1, 0, 0])
    shape = Shape(skeleton=skeleton, history_steps=4, horizon_steps=5, rate_hz=25.0)
    one, other = stirred(shape, **SMALL), stirred(shape, **SMALL, mirrored=False)
    assert torch.equal(one(window(2, shape)), other(window(2, shape)))


def test_short_histories_have_the_velocities_that_there_are() -> None:
    shape = Shape(skeleton=BODY, history_steps=2, horizon_steps=3, rate_hz=25.0)
    assert torch.isfinite(stirred(shape, **SMALL)(window(2, shape))).all()


def test_the_loss_counts_velocities_where_the_future_is_known() -> None:
    net, given = stirred(**SMALL), window()
    future = last_pose(given).expand(-1, 9, -1, -1) + 0.1
    known = torch.ones(3, 9, 28, dtype=torch.bool)
    known[:, 4] = False
    wild = future.clone()
    wild[:, 4] = 100.0
    with torch.no_grad():
        one, other = (net.loss(given, Target(f, known), 0.0) for f in (future, wild))
        plain = mpjpe(net(given), Target(future, known))
    assert torch.equal(one, other)
    assert one > plain


def test_it_learns() -> None:
    net = network(**SMALL, dropout=0.0)
    generator = torch.Generator().manual_seed(3)
    velocity = 0.02 * torch.randn(16, 1, 28, 3, generator=generator)
    steps = torch.arange(-11.0, 10.0)[None, :, None, None]
    track = torch.randn(16, 1, 28, 3, generator=generator) + steps * velocity
    given = BodyFrames(track[:, :12], torch.ones(16, 12, 28, dtype=torch.bool))
    truth = Target(track[:, 12:], torch.ones(16, 9, 28, dtype=torch.bool))
    adam = torch.optim.Adam(net.parameters(), 3e-3)
    before = float(mpjpe(net(given), truth).detach())
    for _ in range(60):
        adam.zero_grad()
        net.loss(given, truth, 0.0).backward()
        adam.step()
    assert float(mpjpe(net(given), truth).detach()) < 0.3 * before
