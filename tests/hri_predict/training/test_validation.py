"""What validation counts."""

import pytest
import torch

from hri_predict.predictors.body import BODY
from hri_predict.predictors.network import Network, Shape, last_pose
from hri_predict.training.processes import Processes
from hri_predict.training.samples import Samples
from hri_predict.training.validation import validate


def test_validation_is_a_mean_over_actions_of_what_is_known():
    history = torch.zeros(3, 4, 28, 3)
    future = torch.zeros(3, 3, 28, 3)
    future[0, :, :, 0] = 0.1  # walking: 100 mm
    future[1, 0, :, 0] = 0.4  # standing, known for one step alone: 400 mm
    future[2, :, :, 0] = 9.0  # nothing is known
    known = torch.ones(3, 3, 28, dtype=torch.bool)
    known[1, 1:] = False
    known[2] = False
    batch = Samples(history, torch.ones(3, 4, 28).bool(), future, known, torch.tensor([0, 1, 1]))

    class Still(Network):
        def forward(self, window):
            return last_pose(window).expand(-1, 3, -1, -1)

    network = Still(Shape(BODY, 4, 3, 25.0, framed=True))
    found = validate(network, network, [batch, batch], ("walking", "standing"), Processes())
    assert found is not None
    assert found.actions_mm == {"walking": pytest.approx(100), "standing": pytest.approx(400)}
    assert found.mm == pytest.approx(250)
    assert found.at_mm == [pytest.approx(250), pytest.approx(100), pytest.approx(100)]
