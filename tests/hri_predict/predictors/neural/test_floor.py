"""The floor of a network's time: products counted by hand, and a rate that is one core's."""

import torch
from torch import nn

from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.floor import products, products_per_second
from hri_predict.predictors.neural.network import Network, NetworkOptions, Shape
from hri_predict.predictors.neural.predictor import shipped_weights
from hri_predict.predictors.neural.weights import load_weights


class OneProduct(Network):
    """(T x 28 x 3) to (H x 28 x 3) by one matrix."""

    def __init__(self):
        super().__init__(Shape(skeleton=BODY, history_steps=5, horizon_steps=2, rate_hz=25.0))
        self.options = NetworkOptions()
        self.matrix = nn.Linear(5 * 84, 2 * 84)

    def forward(self, window):
        return self.matrix(window.positions.flatten(1)).view(-1, 2, 28, 3)


def test_each_pair_of_a_multiplication_and_an_addition_counts_once():
    assert products(OneProduct(), 1) == 420 * 168
    assert products(OneProduct(), 7) == 7 * 420 * 168


def test_sinn_multiplies_each_state_once():
    network = load_weights(shipped_weights("sinn")).network
    states = 5 * 24 * 3 * 256 * 768  # five readings' frames but their first, three directions
    inputs = 2 * (25 + 5 * 5) * 768 * (5 * 28 + 3 * 28)
    assert states < products(network, 1) < states + inputs


def test_a_core_multiplies_at_a_rate_between_an_old_one_s_and_what_none_reaches():
    threads = torch.get_num_threads()
    assert 1e8 < products_per_second() < 1e13
    assert torch.get_num_threads() == threads
