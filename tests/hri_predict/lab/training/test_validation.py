"""What validation counts."""

from types import SimpleNamespace

import pytest
import torch

from hri_predict.lab.training.processes import Processes
from hri_predict.lab.training.validation import validate
from hri_predict.lab.training.windows.samples import Samples
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import Network, Shape, last_pose


@pytest.mark.parametrize("numbers", [3, 4])  # the fourth: of a network that states a deviation
def test_validation_is_a_mean_over_actions_of_what_is_known(numbers):
    history = torch.zeros(3, 4, 28, 3)
    future = torch.zeros(3, 3, 28, 3)
    future[0, :, :, 0] = 0.1  # walking: 100 mm
    future[1, 0, :, 0] = 0.4  # standing, known for one step alone: 400 mm
    future[2, :, :, 0] = 9.0  # nothing is known
    known = torch.ones(3, 3, 28, dtype=torch.bool)
    known[1, 1:] = False
    known[2] = False
    batch = Samples(
        history=history,
        observed=torch.ones(3, 4, 28).bool(),
        future=future,
        known=known,
        actions=torch.tensor([0, 1, 1]),
    )

    class Still(Network):
        def forward(self, window):
            ahead = last_pose(window).expand(-1, 3, -1, -1)
            return torch.nn.functional.pad(ahead, (0, numbers - 3), value=-2.0)

    network = Still(
        Shape(skeleton=BODY, history_steps=4, horizon_steps=3, rate_hz=25.0, framed=True)
    )
    source = SimpleNamespace(validation=lambda: [batch, batch], actions=("walking", "standing"))
    found = validate(network, network, source, Processes())
    assert found is not None
    assert found.actions_mm == {"walking": pytest.approx(100), "standing": pytest.approx(400)}
    assert found.mm == pytest.approx(250)
    assert found.at_mm == [pytest.approx(250), pytest.approx(100), pytest.approx(100)]
