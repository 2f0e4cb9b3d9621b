"""One step of training, on a network of one line."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from hri_predict.base.errors import ConfigError
from hri_predict.lab.training import parts
from hri_predict.lab.training.config import TrainSettings
from hri_predict.lab.training.optimisation import Optimisation, learning_rate_factor
from hri_predict.lab.training.processes import Processes
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Network, Shape, Target


class Line(Network):
    seen: torch.Tensor

    def __init__(self):
        super().__init__(Shape(skeleton=BODY, history_steps=4, horizon_steps=3, rate_hz=25.0))
        self.line = nn.Linear(4, 3)
        self.register_buffer("seen", torch.zeros(()))

    def forward(self, window):
        self.seen += 1
        return self.line(window.positions.movedim(1, -1)).movedim(-1, 1)


def settings(**changes):
    """16 steps in all."""
    base = {"epochs": 4, "windows_per_epoch": 64, "batch": 16, "learning_rate": 0.02}
    return TrainSettings(**(base | changes))


def batch():
    generator = torch.Generator().manual_seed(1)
    past, future = (torch.randn(8, n, 28, 3, generator=generator) for n in (4, 3))
    return BodyFrames(past, past[..., 0] < 9), Target(future, future[..., 0] < 0.5)


def factors_of(chosen):
    """The learning rate's factor at each step."""
    total = chosen.total_steps
    return [learning_rate_factor(n, chosen, n / total) for n in range(total)]


def test_the_average_follows_its_recurrence():
    config = settings(ema_decay=0.5)
    network = Line()
    optimisation = Optimisation(network, config, Processes())
    window, target = batch()
    line = network.line.weight
    expected = line.detach().clone()
    for number in range(6):
        optimisation.step(window, target, 1.0, number, progress=number / 6)
        decay = min(0.5, (1 + number) / (10 + number))
        expected = decay * expected + (1 - decay) * line.detach()
    settled = optimisation.settle()
    assert isinstance(settled, Line)
    torch.testing.assert_close(settled.line.weight.detach(), expected)
    assert float(settled.seen) == 6  # buffers are the newest, not averaged


def test_without_a_decay_nothing_is_averaged():
    network = Line()
    chosen = settings(ema_decay=0)
    assert Optimisation(network, chosen, Processes()).averaged is network


def test_the_learning_rate_rises_then_falls_along_a_cosine():
    chosen = settings(warmup=0.05, epochs=20)  # 80 steps, 4 of them to warm up
    factors = factors_of(chosen)
    assert factors[0] == pytest.approx(0.2)
    assert factors[40] == pytest.approx(0.5)
    assert factors[4:] == sorted(factors[4:], reverse=True)
    assert 0 < factors[-1] < 0.02
    steady = settings(warmup=0, schedule="constant")
    assert factors_of(steady) == [1.0] * 16


def test_steps_fall_by_a_factor_after_so_many_epochs():
    chosen = settings(warmup=0, schedule="steps", decay=0.5, decay_epochs=2)
    assert factors_of(chosen) == [1.0] * 8 + [0.5] * 8


@given(epochs=st.integers(1, 200), share=st.floats(0, 0.05))
def test_a_run_of_any_length_reaches_its_learning_rate(epochs, share):
    chosen = settings(epochs=epochs, warmup=share)
    assert max(factors_of(chosen)) > 0.7  # the shortest run warms up for a fifth of a step


def test_gradients_are_clipped():
    def moved(clip_norm):
        torch.manual_seed(0)
        network = Line()
        chosen = settings(clip_norm=clip_norm, warmup=0)
        optimisation = Optimisation(network, chosen, Processes())
        window, target = batch()
        optimisation.step(window, target, 1.0, 0, progress=0.0)
        return torch.nn.utils.get_total_norm(
            [p.grad for p in network.parameters() if p.grad is not None]
        )

    assert float(moved(1e-3)) == pytest.approx(1e-3, rel=1e-2)
    assert float(moved(1e3)) > 1e-2


def test_bfloat16_is_used_for_products_while_weights_stay_float32():
    def stepped(precision):
        torch.manual_seed(0)
        network = Line()
        window, target = batch()
        loss = Optimisation(network, settings(precision=precision), Processes()).step(
            window, target, 1.0, 0, progress=0.0
        )
        return network, loss

    exact, loss = stepped("float32")
    rounded, near = stepped("bfloat16")
    assert rounded.line.weight.dtype == torch.float32
    assert near != loss
    torch.testing.assert_close(near, loss, rtol=0.01, atol=0)
    torch.testing.assert_close(rounded.line.weight, exact.line.weight, rtol=0.1, atol=0.01)


class WithoutLr(torch.optim.SGD):
    def __init__(self, params):
        super().__init__(params, lr=1.0)


def test_an_optimiser_without_a_fused_form_takes_steps(monkeypatch):
    monkeypatch.setitem(parts.OPTIMISERS, "rms", torch.optim.RMSprop)
    network = Line()
    before = network.line.weight.detach().clone()
    optimisation = Optimisation(network, settings(optimiser="rms"), Processes())
    window, target = batch()
    optimisation.step(window, target, 1.0, 0, progress=0.0)
    assert not torch.equal(network.line.weight, before)


def test_an_optimiser_that_cannot_be_built_is_one_line(monkeypatch):
    monkeypatch.setitem(parts.OPTIMISERS, "odd", WithoutLr)
    with pytest.raises(ConfigError, match=r"^optimiser 'odd' cannot be built: TypeError: .*adamw$"):
        Optimisation(Line(), settings(optimiser="odd"), Processes())
