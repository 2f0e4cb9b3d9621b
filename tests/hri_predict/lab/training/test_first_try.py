"""Mistakes in a user's network are one line each, before the training begins."""

import copy
import logging

import pytest
import torch

from hri_predict.base.errors import HriPredictError, PredictorError
from hri_predict.lab.training import runs
from hri_predict.lab.training.first_try import made, try_network
from hri_predict.predictors.neural.network import Network, deviation_loss, mpjpe
from tests.hri_predict.lab.training.small_run import (
    SHAPE,
    Options,
    Small,
    Walkers,
    make_config,
)


class Forgetful(Small):
    def __init__(self, shape, options):
        self.options = options
        torch.nn.Module.__init__(self)


class WithoutOptions(Small):
    def __init__(self, shape, options):
        super().__init__(shape, options)
        del self.options


class Failing(Small):
    def __init__(self, shape, options):
        raise KeyError("width")


@pytest.mark.parametrize(
    ("network", "said"),
    [
        (Forgetful, r"has no rest pose; begin its __init__ with super\(\).__init__\(shape\)"),
        (WithoutOptions, "has no options, .*; add self.options = options to its __init__"),
        (Failing, r"cannot be built: KeyError: 'width' \(in .*test_first_try.py:\d+\); correct it"),
    ],
)
def test_a_network_that_is_built_wrongly(network, said):
    with pytest.raises(HriPredictError, match=f"^predictor mine: its network {said}$"):
        made(network, SHAPE, Options(), "mine")


class Short(Small):
    def forward(self, window):
        return super().forward(window)[:, :-1]


class NoTensor(Small):
    def forward(self, window):
        return None


class Joints(Small):
    def forward(self, window):
        return super().forward(window)[:, :, :25]


class Wrong(Small):
    def forward(self, window):
        return window.positions @ torch.ones(5)


class OfLosses(Small):
    """Its losses are what a subclass says."""

    def found(self, ahead, target):
        raise NotImplementedError

    def losses(self, window, target, progress):
        return self.found(self(window), target)


class Float(OfLosses):
    def found(self, ahead, target):
        return {"position": mpjpe(ahead, target), "other": 1.0}


class Unreduced(OfLosses):
    def found(self, ahead, target):
        return {"position": (ahead - target.positions).norm(dim=-1)}


class Nan(OfLosses):
    def found(self, ahead, target):
        return {"position": mpjpe(ahead, target) * float("nan")}


class Bare(OfLosses):
    def found(self, ahead, target):
        return mpjpe(ahead, target)


class Detached(OfLosses):
    def found(self, ahead, target):
        return {"position": mpjpe(ahead.detach(), target)}


class Raising(OfLosses):
    def found(self, ahead, target):
        raise ValueError("of two\nlines")


EXPECTED = r"; expected \(64, 3, 28, 3\): windows, horizon steps, joints, x y z"


@pytest.mark.parametrize(
    ("network", "said"),
    [
        (Short, rf"forward returns \(64, 2, 28, 3\){EXPECTED}"),
        (Joints, rf"forward returns \(64, 3, 25, 3\){EXPECTED}"),
        (NoTensor, f"forward returns a NoneType{EXPECTED}"),
        (Wrong, r"its network's forward fails: RuntimeError: .* \(in .*test_first_try.py:\d+\);"),
        (Float, "the loss 'other' is a float; return a tensor of one number$"),
        (Unreduced, r"the loss 'position' has the shape \(64, 3, 28\); return its mean$"),
        (Nan, "the loss 'position' is nan before the first step"),
        (Bare, "losses returns a Tensor; expected a dict of losses by name"),
        (Detached, "no loss of position depends on the network's weights"),
        (Raising, r"its network's losses fail: ValueError: of two \(in .*test_first_try.py:\d+\);"),
    ],
)
def test_a_network_that_computes_something_else(network, said):
    with pytest.raises(HriPredictError, match=f"^predictor mine: {said}") as error:
        try_network(network(SHAPE, Options()), Walkers(), "mine")
    assert "\n" not in str(error.value)


class Unsure(Small):
    def forward(self, window):
        ahead = super().forward(window)
        return torch.cat([ahead, ahead[..., :1]], -1)


class Sure(Unsure):
    losses = Network.losses


class SureAtLast(Unsure):
    def losses(self, window, target, progress):
        ahead = self.forward(window)
        return {"p": mpjpe(ahead, target), "d": (progress > 0.5) * deviation_loss(ahead, target)}


@pytest.mark.parametrize(("network", "warns"), [(Unsure, 1), (Sure, 0), (SureAtLast, 0)])
def test_a_deviation_that_no_loss_trains_is_told(network, warns, caplog):
    with caplog.at_level(logging.WARNING):
        try_network(network(SHAPE, Options()), Walkers(), "mine")
    assert len(caplog.messages) == warns
    if warns:
        assert "none of its losses trains; add deviation_loss(" in caplog.messages[0]


def test_a_right_network_is_left_as_it_is():
    network = Small(SHAPE, Options(dropout=0.5, critic=True))
    before = copy.deepcopy(network.state_dict())
    drawn = torch.get_rng_state()
    try_network(network, Walkers(), "mine")
    assert torch.equal(torch.get_rng_state(), drawn)
    assert all(torch.equal(before[k], v) for k, v in network.state_dict().items())
    assert all(parameter.grad is None for parameter in network.parameters())


def test_a_run_begins_with_the_try(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "open_samples", lambda _: Walkers())
    monkeypatch.setattr(runs, "build_network", lambda *_: Short(SHAPE, Options()))
    with pytest.raises(PredictorError, match="forward returns"):
        runs.trained(make_config(tmp_path / "run"), resume=False)
    assert list((tmp_path / "run").iterdir()) == []
