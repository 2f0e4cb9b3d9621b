"""SINN's readings side by side give what the readings one after the other give."""

from dataclasses import replace

import pytest
import torch

from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Shape
from hri_predict.predictors.neural.predictor import shipped_weights
from hri_predict.predictors.neural.weights import load_weights
from hri_predict.predictors.sinn.model import SINN, SINNOptions
from hri_predict.predictors.sinn.side_by_side import fits

ROUNDING_M = 2e-5
"""Metres: single precision at 3 m, 2.4e-7, through some forty steps that feed one another."""


def walk(people: int, steps: int, seen: float) -> BodyFrames:
    generator = torch.Generator().manual_seed(people)
    positions = torch.randn(people, steps, 28, 3, generator=generator).mul(0.02).cumsum(1)
    return BodyFrames(
        positions + torch.randn(people, 1, 28, 3, generator=generator) * 0.3,
        torch.rand(people, steps, 28, generator=generator) < seen,
    )


EXACT_M = 1e-9
"""The same in double precision, 2e-15 at ten metres: untrained heads drift that far."""


def agree(network: SINN, window: BodyFrames) -> None:
    whole = network.rest.dtype == torch.float64
    window = BodyFrames(window.positions.to(network.rest.dtype), window.observed)
    with torch.inference_mode():
        plain, found = network(window), network.lean()(window)
    assert found.shape == plain.shape
    assert (plain - plain[:, :1]).abs().max() > 1e-3  # it moves
    torch.testing.assert_close(found, plain, rtol=0, atol=EXACT_M if whole else ROUNDING_M)


@pytest.mark.parametrize("seen", [1.0, 0.6, 0.0])
@pytest.mark.parametrize("people", [1, 2, 5])
def test_the_shipped_weights_give_the_same_forecast(people, seen):
    network = load_weights(shipped_weights("sinn")).network
    assert isinstance(network, SINN)
    agree(network, walk(people, network.shape.history_steps, seen))


@pytest.mark.parametrize(
    ("history", "horizon", "steps"),
    [(6, 10, 5), (12, 10, 5), (12, 9, 4), (5, 30, 3), (25, 60, 5), (7, 2, 5), (3, 8, 1), (2, 4, 1)],
)
@pytest.mark.parametrize(
    "start", [{}, {"start_frames": 7, "gate": True}, {"start_frames": 7, "spread": True}]
)
def test_any_history_horizon_and_number_of_steps(history, horizon, steps, start):
    """Readings may begin among the predicted frames, and anywhere within what was predicted."""
    shape = Shape(skeleton=BODY, history_steps=history, horizon_steps=horizon, rate_hz=25.0)
    agree(stirred(shape, operator_steps=steps, **start), walk(3, history, 0.8))


@pytest.mark.parametrize(
    "options",
    [
        {"representation": "displacement"},
        {"splitting": "none"},
        {"splitting": "joint"},
        {"shared": False},
        {"pose": "direction"},
        {"aggregation": False},
        {"operator_steps": 12},
    ],
)
def test_other_options_are_computed_one_after_the_other(options):
    shape = Shape(skeleton=BODY, history_steps=12, horizon_steps=24, rate_hz=25.0)
    network = stirred(shape, **options)
    assert not fits(network.operator, network.options.representation, 12)
    drawn = walk(2, 12, 0.8)
    window = BodyFrames(drawn.positions.double(), drawn.observed)
    assert torch.equal(network(window), network.lean()(window))


def test_positions_that_have_a_frame_already_are_not_moved():
    shape = Shape(skeleton=BODY, history_steps=12, horizon_steps=10, rate_hz=25.0)
    agree(stirred(replace(shape, framed=True)), walk(2, 12, 0.8))


def test_it_takes_as_many_steps_as_there_are_frames(monkeypatch):
    network = load_weights(shipped_weights("sinn")).network
    assert isinstance(network, SINN)
    steps = []
    from hri_predict.predictors.sinn import side_by_side

    plain = side_by_side._Gates.step

    def counted(self, *arguments):
        steps.append(len(arguments[-1]))
        return plain(self, *arguments)

    monkeypatch.setattr(side_by_side._Gates, "step", counted)
    network.lean()(walk(1, 25, 1.0))
    assert len(steps) == 44  # of 45 frames, the first needs no product with a state
    assert sum(steps) == 5 * 24  # and so does the first of each reading


def stirred(shape: Shape, **options: object) -> SINN:
    """A small network in double precision, with heads that say something."""
    torch.manual_seed(0)
    network = SINN(shape, SINNOptions.model_validate({"hidden": 16, "critic_steps": 10} | options))
    for parameter in network.operator.heads.parameters():
        torch.nn.init.normal_(parameter, std=0.05)
    return network.double().eval().requires_grad_(False)
