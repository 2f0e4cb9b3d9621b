"""Teachers: whom they teach, what they say, and which weights are refused."""

import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.lab.training import teachers
from hri_predict.lab.training.teachers import Teachers
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    Target,
    last_pose,
)

SHAPE = Shape(skeleton=BODY, history_steps=4, horizon_steps=3, rate_hz=25.0)


class Raised(Network):
    """Says that every joint rises by some metres, and by the height of its first step."""

    def __init__(self, shape, by_m):
        super().__init__(shape)
        self.options, self._by_m = NetworkOptions(), by_m

    def forward(self, window):
        up = torch.tensor([0.0, 0.0, 1.0]) * (self._by_m + window.positions[:, :1, :, 2:])
        return (last_pose(window) + up).repeat(1, self.shape.horizon_steps, 1, 1)


@pytest.fixture
def known(tmp_path, monkeypatch):
    """Return a function that makes teachers of shapes and heights, found by name."""

    def make(*networks):
        found = {}
        for index, network in enumerate(networks):
            path = tmp_path / f"{index}.safetensors"
            path.touch()
            found[path] = network
        monkeypatch.setattr(
            teachers, "load_weights", lambda path: type("Loaded", (), {"network": found[path]})
        )
        return [str(path) for path in found]

    return make


def batch(size=4, steps=4):
    positions = torch.zeros(size, steps, len(BODY.joints), 3)
    positions[..., 2] = 0.1 * torch.arange(steps)[None, :, None]  # rises by 0.1 m a step
    window = BodyFrames(positions, torch.ones(positions.shape[:-1], dtype=torch.bool))
    future = torch.full((size, 3, len(BODY.joints), 3), 9.0)
    return window, Target(future, torch.zeros(future.shape[:-1], dtype=torch.bool))


def test_the_mean_of_the_teachers_replaces_the_truth_of_a_share(known):
    names = known(Raised(SHAPE, 1.0), Raised(SHAPE, 2.0))
    window, target = batch()
    taught = Teachers(names, 0.5, SHAPE).teach(window, target)
    torch.testing.assert_close(taught.positions[:2, ..., 2], torch.full((2, 3, 28), 0.3 + 1.5))
    assert taught.observed[:2].all()  # teachers answer where the truth is unknown
    assert torch.equal(taught.positions[2:], target.positions[2:])
    assert not taught.observed[2:].any()
    assert (target.positions == 9.0).all(), "the truth itself was changed"
    assert taught.spread is not None
    # the teachers differ by 1 m along one of three axes: 0.5 m from their mean, sqrt(0.25 / 3)
    torch.testing.assert_close(taught.spread[:2], torch.full((2, 3, 28), (0.25 / 3) ** 0.5))
    assert taught.spread[2:].isnan().all()


def test_steps_beyond_the_shortest_teacher_are_unknown(known):
    short = Shape(skeleton=BODY, history_steps=4, horizon_steps=2, rate_hz=25.0)
    names = known(Raised(SHAPE, 1.0), Raised(short, 1.0))
    taught = Teachers(names, 1.0, SHAPE).teach(*batch())
    assert taught.observed[:, :2].all()
    assert not taught.observed[:, 2:].any()
    assert taught.spread is not None
    assert taught.spread[:, 2:].isnan().all()


def test_a_teacher_reads_the_newest_steps(known):
    brief = Shape(skeleton=BODY, history_steps=2, horizon_steps=3, rate_hz=25.0)
    taught = Teachers(known(Raised(brief, 0.0)), 1.0, SHAPE).teach(*batch())
    torch.testing.assert_close(taught.positions[..., 2], torch.full((4, 3, 28), 0.3 + 0.2))


def test_without_teachers_the_truth_stays():
    window, target = batch()
    assert Teachers([], 1.0, SHAPE).teach(window, target) is target


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        (Shape(skeleton=BODY, history_steps=4, horizon_steps=3, rate_hz=50.0), "another rate"),
        (Shape(skeleton=BODY, history_steps=9, horizon_steps=3, rate_hz=25.0), "reads 9 steps"),
    ],
)
def test_teachers_of_another_task_are_refused(known, shape, says):
    with pytest.raises(ConfigError, match=says):
        Teachers(known(Raised(shape, 0.0)), 0.5, SHAPE)


def test_a_teacher_without_weights_is_refused():
    with pytest.raises(ConfigError, match=r"no weights 'kalman'; name a weights file"):
        Teachers(["kalman"], 0.5, SHAPE)


def test_teachers_that_ship_are_found_by_name():
    shape = Shape(skeleton=BODY, history_steps=25, horizon_steps=25, rate_hz=25.0)
    window = batch(2, 25)[0]
    target = Target(torch.zeros(2, 25, 28, 3), torch.zeros(2, 25, 28, dtype=torch.bool))
    taught = Teachers(["mixer", "sinn"], 0.5, shape).teach(window, target)
    assert taught.observed[0].all()
    assert torch.isfinite(taught.positions).all()
