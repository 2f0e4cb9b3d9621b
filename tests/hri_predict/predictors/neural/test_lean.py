"""What engines compute gives what the plain network gives, whoever is seen and however."""

import pytest
import torch

from hri_predict.predictors import auxformer_lean
from hri_predict.predictors.auxformer import AuxFormer
from hri_predict.predictors.auxformer_attention import AuxFormerOptions
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.engine import _probe
from hri_predict.predictors.neural.network import BodyFrames, Network, Shape
from hri_predict.predictors.neural.predictor import shipped_weights
from hri_predict.predictors.neural.weights import load_weights

ROUNDING_M = 1e-5
"""Metres: 2.4e-7, single precision at 3 m, through some forty layers or steps."""
SHIPPED = ["sinn", "trajectorycnn", "stb", "auxformer", "kdformer", "mixer"]


def agree(network: Network, window: BodyFrames, within_m: float = ROUNDING_M) -> None:
    with torch.inference_mode():
        plain, found = network(window), network.lean()(window)
    torch.testing.assert_close(found, plain, rtol=0, atol=within_m)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_weights_forecast_the_same(name):
    network = load_weights(shipped_weights(name)).network
    everybody = _probe(network)
    agree(network, everybody)
    for person in range(len(everybody.observed)):
        only = slice(person, person + 1)
        agree(network, BodyFrames(everybody.positions[only], everybody.observed[only]))


@pytest.mark.parametrize(
    "options",
    [
        {"velocity": True},
        {"scale": "features"},
        {"heads": 1},
        {"heads": 4, "future_stride": 1},
        {"order": "separate"},
        {"observed_attention": False},
        {"layers": 1, "future_stride": 7},
    ],
)
def test_auxformer_with_any_options(options):
    network = auxformer(**options)
    assert isinstance(network.lean(), auxformer_lean._Lean)
    agree(network, _probe_of(network), 1e-9)  # double precision, 2e-15 at 3 m


def test_auxformer_with_too_large_products_is_computed_plainly():
    """An exponential of them would overflow."""
    network = auxformer()
    with torch.no_grad():
        network.full_layers[0].spatial.qkv.weight.mul_(100.0)  # type: ignore[union-attr,operator]
    assert network.lean() == network.forward_filled
    window = _probe_of(network)
    assert network.lean()(window).isfinite().all()


def test_auxformer_s_bound_holds():
    network = auxformer()
    attention = network.full_layers[0].spatial
    assert isinstance(attention, torch.nn.Module)
    features = torch.nn.functional.layer_norm(torch.randn(500, 32, dtype=torch.float64), [32])
    for head in auxformer_lean._heads(attention):  # type: ignore[arg-type]
        scores = (features @ head.query + head.query_bias) @ (features @ head.key).t()
        assert 0 < scores.abs().max() <= auxformer_lean._bound(attention)  # type: ignore[arg-type]


def auxformer(**options: object) -> AuxFormer:
    """A small one in double precision that says something."""
    torch.manual_seed(0)
    shape = Shape(skeleton=BODY, history_steps=6, horizon_steps=9, rate_hz=25.0)
    network = AuxFormer(shape, AuxFormerOptions.model_validate(options))
    torch.nn.init.normal_(network.predict.weight, std=0.1)
    for name, parameter in network.named_parameters():
        if "norm" in name or "bias" in name:
            torch.nn.init.normal_(parameter, mean=0.5, std=0.2)
    network.rest.normal_()
    return network.double().eval().requires_grad_(False)


def _probe_of(network: Network) -> BodyFrames:
    window = _probe(network)
    return BodyFrames(window.positions.double(), window.observed)
