"""Short predictions chained to long ones, around any network."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    Target,
    last_pose,
    mpjpe,
    network_class_of,
)
from hri_predict.predictors.neural.weights import LoadedWeights, load_weights, save_weights
from hri_predict.predictors.temporal_aggregation import (
    Aggregated,
    AggregatedOptions,
    AggregatedPredictor,
    AggregatedSettings,
    aggregate,
    forget,
)


class GoesOn(Network):
    """Repeats the mean displacement over its whole window, times a learnt factor."""

    def __init__(self, shape: Shape) -> None:
        super().__init__(shape)
        self.options = NetworkOptions()
        self.factor = nn.Parameter(torch.tensor(0.5))

    def forward(self, window: BodyFrames) -> Tensor:
        mean = window.positions.diff(dim=1).mean(1, keepdim=True)
        count = torch.arange(1, self.shape.horizon_steps + 1).view(1, -1, 1, 1)
        return last_pose(window) + self.factor * count * mean


def window(steps: int = 6, batch: int = 2, seed: int = 0) -> BodyFrames:
    generator = torch.Generator().manual_seed(seed)
    positions = torch.randn(batch, steps, 28, 3, generator=generator)
    return BodyFrames(positions, torch.rand(batch, steps, 28, generator=generator) < 0.7)


def test_forget_unit_drops_the_oldest_and_appends_what_was_predicted():
    before = window(steps=6)
    predicted = torch.randn(2, 2, 28, 3)
    after = forget(before, predicted)
    torch.testing.assert_close(after.positions[:, :4], before.positions[:, 2:], rtol=0, atol=0)
    torch.testing.assert_close(after.positions[:, 4:], predicted, rtol=0, atol=0)
    assert (after.observed[:, :4] == before.observed[:, 2:]).all()
    assert after.observed[:, 4:].all()


def test_what_is_repeated_states_no_deviation():
    """It takes its own forecasts for observed, so what it states beyond is too small."""
    shape = Shape(skeleton=BODY, history_steps=6, horizon_steps=2, rate_hz=25.0)

    class Unsure(GoesOn):
        def forward(self, window: BodyFrames) -> Tensor:
            return nn.functional.pad(super().forward(window), (0, 1), value=-3.0)

    plain, unsure = (
        Aggregated.around(LoadedWeights(inner(shape), "trajectorycnn", {}), 2, 5)(window())
        for inner in (GoesOn, Unsure)
    )
    torch.testing.assert_close(unsure, plain, rtol=0, atol=0)


def test_forget_unit_keeps_the_window_length_if_more_is_predicted_than_it_holds():
    predicted = torch.randn(2, 9, 28, 3)
    after = forget(window(steps=6), predicted)
    torch.testing.assert_close(after.positions, predicted[:, 3:], rtol=0, atol=0)


def test_equals_applying_the_network_by_hand_and_cuts_at_the_horizon():
    inner = GoesOn(Shape(skeleton=BODY, history_steps=6, horizon_steps=2, rate_hz=25.0))
    first = window()
    with torch.no_grad():
        one = inner(first)
        two = inner(forget(first, one))
        three = inner(forget(forget(first, one), two))
        predicted = aggregate(inner, first, 5)
    expected = torch.cat([one, two, three], 1)[:, :5]
    torch.testing.assert_close(predicted, expected, rtol=0, atol=0)


def test_operator_is_applied_no_more_often_than_needed():
    calls = []

    def stay(current: BodyFrames) -> Tensor:
        calls.append(current)
        return last_pose(current).expand(-1, 5, -1, -1)

    assert aggregate(stay, window(), 10).shape == (2, 10, 28, 3)
    assert len(calls) == 2


def wrapped(horizon_steps: int = 4, **options: object) -> Aggregated:
    torch.manual_seed(0)
    given = {"method": "trajectorycnn", "steps": 2, "options": {"channels": 4, "dropout": 0}}
    return Aggregated(
        Shape(skeleton=BODY, history_steps=6, horizon_steps=horizon_steps, rate_hz=25.0),
        AggregatedOptions.model_validate(given | options),
    )


def future(steps: int = 4) -> Target:
    generator = torch.Generator().manual_seed(5)
    seen = torch.rand(2, steps, 28, generator=generator) < 0.8
    return Target(torch.randn(2, steps, 28, 3, generator=generator), seen)


@pytest.mark.parametrize("progress", [0.1, 0.9])
def test_learns_its_own_steps_first_and_then_the_whole(progress):
    whole, past, target = wrapped(), window(), future()
    near = Target(target.positions[:, :2], target.observed[:, :2])
    expected = mpjpe(whole.inner(past), near) if progress < 0.5 else mpjpe(whole(past), target)
    torch.testing.assert_close(whole.loss(past, target, progress), expected)


def _trained() -> list[str]:
    return [name for name in registry.names("predictors") if network_class_of(name) is not None]


@pytest.mark.parametrize("method", [name for name in _trained() if name != "aggregated"])
def test_wraps_every_trained_predictor(method):
    whole = wrapped(method=method, options={})
    past, target = window(), future()
    assert whole(past).shape == (2, 4, 28, 3)
    for progress in (0.0, 0.9):
        whole.zero_grad()
        whole.critic_loss(past, target, progress)
        loss = whole.loss(past, target, progress)
        loss.backward()
        gradients = [p.grad for p in whole.model_parameters() if p.grad is not None]
        assert loss.isfinite()
        assert gradients
        assert all(g.isfinite().all() for g in gradients)


def test_the_adversary_of_the_network_within_learns_while_that_learns_alone():
    whole = wrapped(method="sinn", options={"hidden": 8, "pretraining": 0.5})
    assert list(whole.critic_parameters()) == list(whole.inner.critic_parameters())
    past, target = window(), future()
    assert whole.critic_loss(past, target, 0.4) is not None  # four fifths of the inner training
    assert whole.critic_loss(past, target, 0.1) is None
    assert whole.critic_loss(past, target, 0.9) is None


def test_refuses_a_predictor_without_a_network():
    with pytest.raises(ConfigError, match=r"options\.method 'kalman': no network; name"):
        wrapped(method="kalman")
    with pytest.raises(ConfigError, match="unknown key"):
        wrapped(options={"chanels": 4})


def test_rest_pose_of_the_whole_is_that_of_the_network_within():
    whole = wrapped()
    whole.rest.copy_(torch.randn(28, 3))
    torch.testing.assert_close(whole.inner.rest, whole.rest, rtol=0, atol=0)
    other = wrapped(horizon_steps=9)  # a longer horizon, the same weights
    other.load_state_dict(whole.state_dict())
    torch.testing.assert_close(other.inner.rest, whole.rest, rtol=0, atol=0)
    past = window()
    torch.testing.assert_close(other(past)[:, :4], whole(past), rtol=1e-5, atol=1e-6)


def test_a_horizon_below_its_steps_is_cut():
    whole, past = wrapped(horizon_steps=1), window()
    torch.testing.assert_close(whole(past), whole.inner(past)[:, :1])
    target = future(1)
    torch.testing.assert_close(whole.loss(past, target, 0.0), mpjpe(whole(past), target))


@pytest.fixture
def inner_weights(tmp_path, random_network) -> Path:
    """Weights of a trajectorycnn that predicts 12 steps."""
    path = tmp_path / "inner.safetensors"
    network_class = network_class_of("trajectorycnn")
    save_weights(path, "trajectorycnn", random_network(network_class, 12, channels=4), {})
    return path


def predictor(weights: Path, horizon_s: float = 1.0, **settings: object) -> AggregatedPredictor:
    given = {"name": "aggregated", "weights": str(weights), "horizon_s": horizon_s}
    return AggregatedPredictor(AggregatedSettings.model_validate(given | settings), BODY)


@pytest.mark.parametrize("horizon_s", [0.12, 1.0, 2.0])
def test_repeats_a_predictor_trained_by_itself_as_far_as_asked(inner_weights, horizon_s):
    made = predictor(inner_weights, horizon_s, steps=5)
    assert made.horizon_steps == round(horizon_s * 25)
    past = window(steps=15)
    inner = load_weights(inner_weights).network
    with torch.inference_mode():
        expected = aggregate(lambda w: inner(w)[:, :5], past, made.horizon_steps)
        torch.testing.assert_close(made.network(past), expected)


def test_starts_as_the_inner_predictor_does(inner_weights):
    history = np.random.default_rng(0).normal(0, 0.3, (2, 15, 28, 3))
    seen = np.ones((2, 15, 28), bool)
    settings = {"name": "trajectorycnn", "weights": str(inner_weights), "horizon_s": 0.48}
    cls = registry.load("predictors", "trajectorycnn")
    alone = cls(cls.settings_model(**settings), BODY).predict(history, seen).positions
    found = predictor(inner_weights, steps=7).predict(history, seen).positions
    np.testing.assert_allclose(found[:, :7], alone[:, :7], rtol=0, atol=1e-6)
    assert np.abs(found[:, 7:12] - alone[:, 7:12]).max() > 1e-4


def test_takes_weights_trained_through_the_aggregation(tmp_path, random_network):
    path = tmp_path / "whole.safetensors"
    save_weights(path, "aggregated", random_network(Aggregated, 10, steps=3), {})
    made = predictor(path, 2.0)
    assert isinstance(made.network, Aggregated)
    assert (made.horizon_steps, made.network.options.steps) == (50, 3)
    with pytest.raises(ConfigError, match=r"predictor\.steps 5: .* were trained with 3; leave"):
        predictor(path, steps=5)


def test_wrong_options_of_the_inner_network_are_refused_with_the_file(tmp_path, random_network):
    path = tmp_path / "whole.safetensors"
    save_weights(path, "aggregated", random_network(Aggregated, 10, steps=3), {})
    with safe_open(path, framework="pt") as file:
        described = json.loads(file.metadata()["hri_predict"])
    described["options"]["options"] = {"layers": "x"}
    save_file(load_file(path), path, {"hri_predict": json.dumps(described)})
    with pytest.raises(ConfigError, match=rf"weights {path}: options\.options: layers: unknown"):
        load_weights(path)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"inner": "kalman"}, r"predictor\.inner 'kalman': no network; name a trained"),
        ({"inner": "trajectorycn"}, "unknown predictor 'trajectorycn'; did you mean"),
        ({"inner": "stb"}, "are for 'trajectorycnn'; give the file of 'stb'"),
        ({"steps": 13}, r"predictor\.steps 13: .* predicts 12 steps at a time .* use 12 at most"),
    ],
)
def test_settings_that_cannot_be(inner_weights, settings, message):
    with pytest.raises(ConfigError, match=message):
        predictor(inner_weights, **settings)
