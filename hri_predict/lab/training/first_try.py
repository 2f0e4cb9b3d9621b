"""A network's first call, before its training: each mistake in it is one line."""

import copy
import logging
import math
from contextlib import AbstractContextManager

import numpy as np
import torch
from torch import Tensor

from hri_predict.base.errors import PredictorError
from hri_predict.contracts import registry
from hri_predict.lab.training.windows.samples import SampleSource
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkClass,
    NetworkOptions,
    Shape,
    Target,
)

log = logging.getLogger(__name__)

_WINDOWS = 64  # so many that a loss over some of the joints has at least one of them


def made(network_class: NetworkClass, shape: Shape, options: NetworkOptions, name: str) -> Network:
    """Build the network of the predictor ``name``.

    Raises:
        HriPredictError: it fails, or its ``__init__`` leaves out what every network has.
    """
    package = getattr(network_class, "__module__", "")
    with _calling(name, "its network cannot be built", package):
        network = network_class(shape, options)
    rest = getattr(network, "rest", None)
    if not isinstance(rest, Tensor) or rest.shape != (shape.joints, 3):
        raise PredictorError(
            f"predictor {name}: its network has no rest pose; begin its __init__ with "
            f"super().__init__(shape)"
        )
    if not isinstance(getattr(network, "options", None), NetworkOptions):
        raise PredictorError(
            f"predictor {name}: its network has no options, which weights files store; add "
            f"self.options = options to its __init__"
        )
    return network


def try_network(network: Network, source: SampleSource, name: str) -> None:
    """Call a copy of the network of the predictor ``name`` and its losses once.

    Raises:
        HriPredictError: a call fails or returns anything other than ``Network`` says.
    """
    package = type(network).__module__
    samples = source.batch(np.random.default_rng(0), _WINDOWS)
    with torch.random.fork_rng(devices=[]):
        with _calling(name, "its network cannot be copied", package):
            tried = copy.deepcopy(network)
        window, target = samples.entered(tried)
        with _calling(name, "its network's forward fails", package), torch.no_grad():
            forecast = tried.eval()(window)
        _check_forecast(forecast, window, network.shape, name)
        tried.train()
        with _calling(name, "its network's critic_loss fails", package):
            critic = tried.critic_loss(window, target, 0.0)
        if critic is not None:
            _check_losses({"critic": critic}, name)
        with _calling(name, "its network's losses fail", package):
            losses = tried.losses(window, target, 0.0)
        _check_losses(losses, name)
        with _calling(name, "its network's gradient fails", package):
            trained = forecast.shape[-1] == 3 or _trains_deviation(tried, window, target)
    if not trained:
        log.warning(
            "predictor %s: its network states a deviation, the fourth number of forward, which "
            "none of its losses trains; add deviation_loss(forecast, target) to them",
            name,
        )


def _check_forecast(forecast: object, window: BodyFrames, shape: Shape, name: str) -> None:
    wanted = (len(window.positions), shape.horizon_steps, shape.joints)
    if not isinstance(forecast, Tensor):
        found = _a(forecast)
    elif forecast.shape not in ((*wanted, 3), (*wanted, 4)):
        found = str(tuple(forecast.shape))
    else:
        return
    raise PredictorError(
        f"predictor {name}: forward returns {found}; expected {(*wanted, 3)}: windows, horizon "
        f"steps, joints, x y z (and a fourth number with a deviation)"
    )


def _check_losses(losses: object, name: str) -> None:
    if not isinstance(losses, dict) or not losses:
        raise PredictorError(
            f"predictor {name}: losses returns {losses if losses == {} else _a(losses)}; expected "
            f"a dict of losses by name"
        )
    for key, loss in losses.items():
        if not isinstance(loss, Tensor):
            found = f"is {_a(loss)}; return a tensor of one number"
        elif loss.dim():
            found = f"has the shape {tuple(loss.shape)}; return its mean"
        elif not math.isfinite(number := float(loss.detach())):
            found = f"is {number:g} before the first step; correct it"
        else:
            continue
        raise PredictorError(f"predictor {name}: the loss '{key}' {found}")
    if not any(loss.requires_grad for loss in losses.values()):
        raise PredictorError(
            f"predictor {name}: no loss of {', '.join(losses)} depends on the network's weights; "
            f"compute them from its forecast, without detach or no_grad"
        )


def _a(value: object) -> str:
    return f"a {type(value).__name__}"


def _trains_deviation(network: Network, window: BodyFrames, target: Target) -> bool:
    """Whether the losses depend on the fourth number of a forecast, early or late in a training."""
    seen: list[Tensor] = []
    forward = network.forward

    def watched(window: BodyFrames) -> Tensor:
        forecast = forward(window)
        if forecast.requires_grad:
            forecast.retain_grad()
            seen.append(forecast)
        return forecast

    vars(network)["forward"] = watched  # hooks would miss losses that call forward itself
    for progress in (0.0, 1.0):
        network.loss(window, target, progress).backward()
        if not seen or any(f.grad is not None and bool(f.grad[..., 3].any()) for f in seen):
            return True  # or the losses do not call forward, and nothing is known
    return False


def _calling(name: str, failed: str, package: str) -> AbstractContextManager[None]:
    """Wrap calls of a network that a user wrote in ``package``; see ``registry.calling``."""
    return registry.calling(f"predictor {name}: {failed}", "correct it", package)
