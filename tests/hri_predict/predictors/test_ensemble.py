"""The average of several predictors' forecasts."""

import threading
import time

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError, PredictorError
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Forecast
from hri_predict.predictors import ensemble
from hri_predict.predictors.ensemble import AveragePredictor, AverageSettings
from hri_predict.predictors.kalman import ConstantAccelerationKalman
from hri_predict.predictors.neural.settings import shipped_weights
from hri_predict.run.config import predictor_settings

BASELINES = ("zero_velocity", "constant_velocity", "kalman")


def average(*members, **settings):
    return AveragePredictor(AverageSettings(name="average", members=members, **settings))


def alone(name, **settings):
    return registry.load("predictors", name)(predictor_settings({"name": name, **settings}, "test"))


@pytest.fixture
def people():
    rng = np.random.default_rng(0)
    history = rng.normal(0, 0.02, (2, 25, 21, 3)).cumsum(axis=1)
    return history, rng.random((2, 25, 21)) > 0.2


def test_it_is_the_mean_of_what_each_says_of_its_own_history(people):
    history, observed = people
    found = average(*BASELINES)
    assert found.history_steps == max(alone(n).history_steps for n in BASELINES)
    own = slice(25 - found.history_steps, None)
    said, variances = [], []
    for name in BASELINES:
        member = alone(name)
        last = slice(25 - member.history_steps, None)
        its = member.predict(history[:, last], observed[:, last])
        said.append(its.positions)
        variances.append(0.0 * its.positions[..., 0] if its.std is None else its.std**2)
    forecast = found.predict(history[:, own], observed[:, own])
    # a sum of three and a division: an epsilon each, of magnitudes up to 3 m
    np.testing.assert_allclose(forecast.positions, np.mean(said, axis=0), atol=1e-14)
    assert forecast.std is not None
    variance = np.mean(variances, axis=0) + np.var(said, axis=0).mean(-1)
    np.testing.assert_allclose(forecast.std, np.sqrt(variance), rtol=1e-9)


def test_its_deviation_is_that_of_the_mixture(people):
    """The same as that of numbers drawn from both members' distributions."""

    class Sure(ConstantAccelerationKalman):
        def predict(self, history, observed):
            found = super().predict(history, observed)
            assert found.std is not None
            return Forecast(found.positions + np.array([0.3, 0.0, 0.0]), 0.5 * found.std)

    found, kalman = average("zero_velocity", "kalman"), alone("kalman")
    sure = Sure(kalman._settings)
    found.members, found.history_steps = [kalman, sure], kalman.history_steps
    history, observed = (each[:, -kalman.history_steps :] for each in people)
    forecast = found.predict(history, observed)
    std = kalman.predict(history, observed).std
    offset = np.array([-0.15, 0.15])[:, None, None]
    rng = np.random.default_rng(1)
    for step in (0, 24):
        own = np.array([1.0, 0.5])[:, None, None] * std[0, step, 3]
        drawn = rng.normal(0.0, own, (2, 100_000, 3))
        drawn[..., :1] += offset
        # a standard error of 600 000 numbers is 0.1 %
        assert forecast.std[0, step, 3] == pytest.approx(np.sqrt((drawn**2).mean()), rel=0.01)


def test_a_member_that_fails_leaves_no_other_computing(people):
    failed = threading.Event()
    ended = []

    class Fails(ConstantAccelerationKalman):
        def predict(self, history, observed):
            failed.set()
            raise PredictorError("no forecast")

    class Waits(ConstantAccelerationKalman):
        def predict(self, history, observed):
            assert failed.wait(10)
            time.sleep(0.1)  # still computing when the other has failed
            ended.append(True)
            return super().predict(history, observed)

    found, settings = average("zero_velocity", "kalman"), alone("kalman")._settings
    found.members, found.history_steps = [Fails(settings), Waits(settings)], 25
    with pytest.raises(PredictorError, match="no forecast"):
        found.predict(*people)
    assert ended == [True]


def test_it_reaches_as_far_as_all_its_members():
    found = average("zero_velocity", "trajectorycnn", horizon_s=1.2)
    reach = alone("trajectorycnn", horizon_s=1.2).horizon_steps
    assert found.horizon_steps == reach < alone("zero_velocity", horizon_s=1.2).horizon_steps


def test_all_weights_decide_which_calibration_is_its_own():
    settings = AverageSettings(name="average", members=("sinn", "stb", "kalman"))
    assert settings.files() == (shipped_weights("sinn"), shipped_weights("stb"))


@pytest.mark.parametrize(
    ("members", "said"),
    [
        (["sinn"], "members"),
        (["sinn", "sinn"], "names a predictor twice; name each once"),
        (["average", "sinn"], "an average cannot be a member; name its members instead"),
        (["sinn", "nobody"], "nobody"),
    ],
)
def test_mistakes_are_one_line(members, said):
    with pytest.raises(ConfigError) as error:
        alone("average", members=members)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_member_at_another_rate_is_refused(monkeypatch):
    made = ensemble._member

    def another(settings, skeleton):
        member = made(settings, skeleton)
        if settings.name == "kalman":
            member.rate_hz = 50.0
        return member

    monkeypatch.setattr(ensemble, "_member", another)
    with pytest.raises(ConfigError, match="kalman predicts at 50 Hz, not at 25; take it out"):
        average("zero_velocity", "kalman")
