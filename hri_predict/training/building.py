"""From a training configuration to what it trains and what it is trained on."""

from pathlib import Path

import torch

from hri_predict import registry
from hri_predict.errors import ConfigError
from hri_predict.predictors.body import BODY
from hri_predict.predictors.network import Network, Shape
from hri_predict.predictors.weights import load_weights
from hri_predict.settings import validated
from hri_predict.training.benchmark_samples import BenchmarkData, BenchmarkSamples
from hri_predict.training.config import TrainingConfig
from hri_predict.training.motion import DataSettings, MotionSamples
from hri_predict.training.samples import SampleSource


def open_samples(config: TrainingConfig) -> SampleSource:
    """Open the training and validation windows that ``config`` names.

    Raises:
        ConfigError: a key of ``data`` is wrong, or there is nothing to train on.
        RecordingError: a recording cannot be read.
    """
    where, shape = "training configuration: data", config.shape
    steps = shape.history_steps, shape.horizon_steps
    if config.judgement == "benchmark":
        source = BenchmarkSamples(validated(BenchmarkData, config.data, where), *steps)
        if source.shape.rate_hz != shape.rate_hz:
            raise ConfigError(
                f"training configuration: shape.rate_hz {shape.rate_hz:g}: the benchmark has "
                f"{source.shape.rate_hz:g}; leave it out"
            )
        return source
    settings = validated(DataSettings, config.data, where)
    return MotionSamples(settings, Shape(BODY, *steps, shape.rate_hz))


def build_network(config: TrainingConfig, source: SampleSource) -> Network:
    """The network that ``config`` names, seeded, or with its ``initial_weights``.

    Raises:
        ConfigError: no such predictor, it is not trained, or a wrong option.
        PredictorError: the initial weights cannot be read or are another network's.
    """
    predictor = registry.load("predictors", config.predictor)
    network_class = getattr(predictor, "network_class", None)
    if network_class is None:
        raise ConfigError(f"predictor '{config.predictor}' has no network: nothing to train")
    options = validated(
        network_class.options_model, config.options, "training configuration: options"
    )
    torch.manual_seed(config.train.seed)
    network: Network = network_class(source.shape, options)
    network.rest.copy_(source.rest())
    if config.initial_weights is not None:
        _start_from(network, config.initial_weights)
    return network


def _start_from(network: Network, path: Path) -> None:
    """Copy the weights in ``path``, their rest pose included, into ``network``."""
    given = load_weights(path).network
    ours = (type(network), network.shape, network.options)
    if (type(given), given.shape, given.options) != ours:
        raise ConfigError(
            f"initial_weights {path}: of another network, shape or options; train with the "
            f"predictor, shape and options that its card states"
        )
    missing = network.load_state_dict(given.state_dict(), strict=False).missing_keys
    critic = {id(p) for p in network.critic_parameters()}
    for name in missing:  # an adversary is not shipped, and starts anew
        if id(network.get_parameter(name)) not in critic:
            raise ConfigError(f"initial_weights {path}: lacks '{name}'; train anew without it")
