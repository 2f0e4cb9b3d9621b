"""Builds the network and the training windows that a training configuration names."""

from pathlib import Path

import torch

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.parts import part
from hri_predict.lab.training.windows.samples import SampleSource, SampleSourceClass
from hri_predict.predictors.neural.network import (
    Network,
    NetworkOptions,
    Shape,
    network_class_of,
)
from hri_predict.predictors.neural.weights import load_weights


def open_samples(config: TrainingConfig) -> SampleSource:
    """Open the training and validation windows that ``config`` names.

    Raises:
        ConfigError: a key of ``data`` is wrong, or there is nothing to train on.
        RecordingError: a recording cannot be read.
    """
    made: SampleSourceClass = part("data_sets", config.judgement)
    data = validated(made.settings_model, config.data, "training configuration: data")
    source, rate_hz = made.opened(data, **dict(config.shape)), config.shape.rate_hz
    if source.shape.rate_hz != rate_hz:
        raise ConfigError(
            f"training configuration: shape.rate_hz {rate_hz:g}: data set {config.judgement} has "
            f"{source.shape.rate_hz:g}; leave it out"
        )
    return source


def build_network(config: TrainingConfig, source: SampleSource) -> Network:
    """The network that ``config`` names, seeded, or with its ``initial_weights``.

    Raises:
        ConfigError: the predictor does not exist, it is not a trained one, or an option is wrong.
        PredictorError: the initial weights cannot be read or belong to another network.
    """
    network_class = network_class_of(config.predictor)
    if network_class is None:
        raise ConfigError(
            f"predictor '{config.predictor}' has no network: nothing to train; name a trained one"
        )
    options = validated(
        network_class.options_model, config.options, "training configuration: options"
    )
    torch.manual_seed(config.train.seed)
    network = network_class(source.shape, options)
    network.rest.copy_(source.rest())
    if config.initial_weights is not None:
        _start_from(network, config.initial_weights)
    return network


def _start_from(network: Network, path: Path) -> None:
    """Copy the weights in ``path``, their rest pose included, into ``network``."""
    given = load_weights(path).network
    same_task = _described(given.shape) == _described(network.shape)
    if type(given) is not type(network) or not (
        same_task and _continues(given.options, network.options)
    ):
        raise ConfigError(
            f"initial_weights {path}: have another network, shape or options; train with the "
            f"predictor, shape and options that its card states"
        )
    missing = network.load_state_dict(given.state_dict(), strict=False).missing_keys
    critic = {id(p) for p in network.critic_parameters()}
    grows = any(
        getattr(given.options, k) != getattr(network.options, k) for k in given.options.added
    )
    for name in missing:  # an adversary is not shipped; it starts with fresh weights
        if id(network.get_parameter(name)) not in critic and not grows:
            raise ConfigError(f"initial_weights {path}: lacks '{name}'; train again without it")


def _described(shape: Shape) -> tuple[object, ...]:
    """Return the values that make two shapes equal; unnamed skeletons are rebuilt objects."""
    skeleton = shape.skeleton
    return (
        skeleton.joints,
        skeleton.parents,
        skeleton.left_right_pairs,
        skeleton.parts,
        shape.history_steps,
        shape.horizon_steps,
        shape.rate_hz,
        shape.framed,
    )


def _continues(given: NetworkOptions, ours: NetworkOptions) -> bool:
    """Whether weights trained with ``given`` mean the same in a network with ``ours``."""
    defaults = type(ours)()
    free = {name: getattr(defaults, name) for name in ours.training}
    if all(getattr(given, name) == getattr(defaults, name) for name in ours.added):
        free |= {name: getattr(defaults, name) for name in ours.added}
    return given.model_copy(update=free) == ours.model_copy(update=free)
