from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor
from hri_predict.predictors.neural.body import BODY, from_canonical
from hri_predict.predictors.neural.body_frame import fill, neighbour_table
from hri_predict.predictors.neural.network import (
    Network,
    NetworkClass,
    Shape,
    network_class_of,
)
from hri_predict.predictors.neural.settings import NeuralSettings, shipped_weights
from hri_predict.predictors.neural.weights import save_weights
from hri_sim.people.body import Body


@pytest.fixture(scope="session")
def standing() -> Floats:
    """(21, 3) canonical joints of somebody who stands at the origin and faces along x."""
    body = Body(1.75)
    return body.joints(body.standing(np.zeros(2), 0.0))


@pytest.fixture(scope="session")
def random_network(standing):
    """Makes a network whose weights are random, none of them zero, and its rest pose standing."""

    def make(network_class: NetworkClass, horizon_steps: int = 25, **options: Any) -> Network:
        shape = Shape(skeleton=BODY, history_steps=15, horizon_steps=horizon_steps, rate_hz=25.0)
        torch.manual_seed(5)
        network = network_class(shape, network_class.options_model(**options))
        with torch.no_grad():
            for parameter in network.parameters():
                parameter.add_(torch.randn(parameter.shape), alpha=0.02)
        middle = standing - (standing[CANONICAL.index("l_hip")] + standing[17]) / 2
        pose, seen = from_canonical(middle[None, None], np.ones((1, 1, 21), bool))
        rest = torch.from_numpy(pose), torch.from_numpy(seen)
        network.rest.copy_(fill(*rest, torch.zeros(28, 3), neighbour_table(BODY))[0, 0])
        return network.eval()

    return make


@pytest.fixture(scope="session")
def weights_of(tmp_path_factory, random_network):
    """The file of weights of a trained predictor: the shipped one, or else random weights."""
    folder = tmp_path_factory.mktemp("weights")

    def find(name: str, shipped: bool = True) -> Path:
        if shipped and shipped_weights(name).exists():
            return shipped_weights(name)
        path = folder / f"{name}.safetensors"
        if not path.exists():
            network_class = network_class_of(name)
            save_weights(path, name, random_network(network_class), {"data": "none: random"})
        return path

    return find


@pytest.fixture(scope="session")
def build(weights_of):
    """Builds a registered predictor: 1 s at 25 Hz, with weights where it needs some."""

    def build(name: str, **settings: Any) -> Predictor:
        cls = registry.load("predictors", name)
        if issubclass(cls.settings_model, NeuralSettings):
            settings = {"weights": str(weights_of(name))} | settings
        settings = {"horizon_s": 1.0, "rate_hz": 25.0} | settings
        predictor: Predictor = cls(cls.settings_model(name=name, **settings))
        return predictor

    return build
