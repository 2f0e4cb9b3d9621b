"""Every registered predictor keeps the contract of ``predictors/base.py``.

Causality needs no test of its own here: ``predict`` is given the history and nothing else.
"""

import numpy as np
import pytest

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor, PredictorSettings, checked

DAILY = {"zero_velocity", "constant_velocity", "kalman", "trajectorycnn", "average"}
"""Predictors that the daily tests judge: all without weights, and one network."""


@pytest.fixture(
    scope="module",  # half a second each
    params=[
        pytest.param(name, marks=[] if name in DAILY else [pytest.mark.long])
        for name in registry.names("predictors")
    ],
)
def predictor(request, build) -> Predictor:
    cls = registry.load("predictors", request.param)
    assert issubclass(cls.settings_model, PredictorSettings)
    predictor: Predictor = build(request.param)
    return predictor


@pytest.fixture
def people(standing):
    """Makes people who stand, each at its own place, joints on random walks, with holes."""

    def make(predictor: Predictor, count: int, seen: float = 0.8) -> tuple[Floats, Bools]:
        rng = np.random.default_rng(7)
        shape = (count, predictor.history_steps, len(predictor.skeleton.joints))
        walk = rng.normal(0, 0.02, (*shape, 3)).cumsum(axis=1)
        places = rng.normal(0, 3, (count, 1, 1, 3))
        return standing + walk + places, rng.random(shape) < seen

    return make


def test_is_known_by_name():
    assert {"zero_velocity", "constant_velocity", "kalman"} <= set(registry.names("predictors"))


def test_reaches_the_horizon(predictor):
    assert predictor.horizon_steps / predictor.rate_hz >= 1.0
    assert predictor.history_steps >= 1


@pytest.mark.parametrize("count", [0, 1, 4])
def test_forecast_is_finite_and_in_shape(predictor, people, count):
    forecast = predictor.predict(*people(predictor, count))
    checked(forecast, count, predictor)
    if forecast.std is not None:
        assert (forecast.std > 0).all()


def test_people_nowhere_observed_still_get_a_finite_forecast(predictor, people):
    history, observed = people(predictor, 3)
    observed[1] = False
    checked(predictor.predict(history, observed), 3, predictor)


def test_same_batch_gives_same_bytes_and_is_left_alone(predictor, people):
    history, observed = people(predictor, 4)
    copies = history.copy(), observed.copy()
    first, second = (predictor.predict(history, observed) for _ in range(2))
    assert first.positions.tobytes() == second.positions.tobytes()
    if first.std is not None and second.std is not None:
        assert first.std.tobytes() == second.std.tobytes()
    np.testing.assert_array_equal(history, copies[0])
    np.testing.assert_array_equal(observed, copies[1])


def test_forecast_of_a_person_does_not_depend_on_the_others(predictor, people):
    history, observed = people(predictor, 5)
    together = predictor.predict(history, observed)
    for person in range(5):
        alone = predictor.predict(history[person : person + 1], observed[person : person + 1])
        np.testing.assert_allclose(
            alone.positions[0], together.positions[person], rtol=0, atol=1e-5
        )


def test_values_not_observed_do_not_matter(predictor, people):
    history, observed = people(predictor, 4, seen=0.5)
    garbage = np.where(observed[..., None], history, 1e6)
    np.testing.assert_array_equal(
        predictor.predict(garbage, observed).positions,
        predictor.predict(history, observed).positions,
    )


def test_joints_never_observed_stay_by_their_person(predictor, people):
    history, observed = people(predictor, 3, seen=1.0)
    history = np.repeat(history[:, :1], predictor.history_steps, axis=1)  # everybody stands
    observed[:, :, ::2] = False
    forecast = predictor.predict(history, observed).positions[:, 0]
    seen = history[:, -1, 1::2]
    apart = np.linalg.norm(forecast[:, :, np.newaxis] - seen[:, np.newaxis], axis=-1)
    assert apart.min(axis=2).max() < 0.6  # of somebody observed: a bone, and some motion
