"""Every registered predictor keeps its contract, and one that breaks it is caught."""

from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import PredictorError
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Forecast
from hri_predict.library.conformance.checks import run_checks
from hri_predict.library.conformance.predictors import CHECKS, PredictorPart, check_predictor
from hri_predict.predictors.baselines import ZeroVelocity, ZeroVelocitySettings
from hri_predict.predictors.neural.settings import shipped_weights
from hri_predict.run.assemble import predictor_of

DAILY = {"zero_velocity", "constant_velocity", "kalman", "sinn"}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in DAILY else [pytest.mark.long])
        for name in registry.names("predictors")
    ],
)
def test_every_predictor_keeps_its_contract(name):
    cls = registry.load("predictors", name)
    weights = "trajectorycnn" if name == "aggregated" else name
    if "weights" in cls.settings_model.model_fields and not shipped_weights(weights).exists():
        pytest.skip(f"no weights of {weights} are shipped")
    findings = check_predictor(name, cls.settings_model.model_validate({"name": name}))
    assert [f for f in findings if f.verdict != "pass"] == []


class Wrong(ZeroVelocity):
    """Changes what the baseline predicts, or what it is given."""

    def predict(self, history, observed):
        right = super().predict(history, observed)
        return Forecast(self.wrong(right.positions, history, observed), None)

    def wrong(self, positions, history, observed):
        return positions


class Random(Wrong):
    def wrong(self, positions, history, observed):
        return positions + np.random.default_rng().normal(0, 1e-9, positions.shape)


class Counting(Wrong):
    calls = 0

    def wrong(self, positions, history, observed):
        self.calls += 1
        return positions + 1e-9 * self.calls


class ByTheBatch(Wrong):
    def wrong(self, positions, history, observed):
        return positions + 0.001 * len(history)


class Unmasked(Wrong):
    def wrong(self, positions, history, observed):
        return np.repeat(history[:, -1:], positions.shape[1], axis=1)


class NotFinite(Wrong):
    def wrong(self, positions, history, observed):
        seen = observed.any(axis=1)[:, None, :, None]
        return np.where(seen, positions, np.nan)


class Flat(Wrong):
    def wrong(self, positions, history, observed):
        return positions[:, :1]


class TooSure(Wrong):
    def predict(self, history, observed):
        right = super().predict(history, observed)
        return Forecast(right.positions, np.full(right.positions.shape[:3], -0.01))


class Careless(Wrong):
    def wrong(self, positions, history, observed):
        history[:] = 0.0
        return positions


class ReadsAhead(Wrong):
    def wrong(self, positions, history, observed):
        whole = history if history.base is None else history.base
        return positions + (whole.shape[1] - history.shape[1])


class AtItsOwnRate(Wrong):
    def __init__(self, settings):
        super().__init__(settings)
        self.rate_hz = 50.0


@pytest.mark.parametrize(
    ("cls", "check"),
    [
        (Random, "gives the same bytes again"),
        (Counting, "gives the same bytes again"),
        (ByTheBatch, "does not depend on the batch"),
        (Unmasked, "ignores what is not observed"),
        (NotFinite, "is finite whatever is unobserved"),
        (Flat, "gives the right shapes"),
        (TooSure, "gives the right shapes"),
        (Careless, "leaves its input alone"),
        (ReadsAhead, "knows nothing of the future"),
        (AtItsOwnRate, "says what it works on"),
    ],
)
def test_a_predictor_that_breaks_its_contract_is_caught(cls: Any, check: str):
    settings = ZeroVelocitySettings(name="wrong")
    findings = run_checks(CHECKS, PredictorPart(cls, settings, cls(settings)))
    failed = {f.check: f.detail for f in findings if f.verdict == "fail"}
    assert check in failed
    assert failed[check]


def test_a_predictor_that_raises_is_told_how():
    class Raises(Wrong):
        def wrong(self, positions, history, observed):
            raise RuntimeError("out of memory\nand more")

    cls: Any = Raises
    settings = ZeroVelocitySettings(name="wrong")
    findings = run_checks(CHECKS, PredictorPart(cls, settings, cls(settings)))
    shapes = next(f for f in findings if f.check == "gives the right shapes")
    assert (shapes.verdict, shapes.detail) == ("fail", "raised RuntimeError: out of memory")


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("skeleton", "human"),
        ("history_steps", 10**9),
        ("history_steps", -3),
        ("horizon_steps", 5.5),
        ("rate_hz", "fast"),
    ],
)
def test_absurd_attributes_end_the_checks_and_the_node_refuses_them(monkeypatch, attribute, value):
    class Absurd(ZeroVelocity):
        def __init__(self, settings):
            super().__init__(settings)
            setattr(self, attribute, value)

    monkeypatch.setattr(registry, "load", lambda kind, name: Absurd)
    settings = ZeroVelocitySettings(name="zero_velocity")
    findings = check_predictor("zero_velocity", settings)
    assert [f.verdict for f in findings] == ["pass", "fail"]
    assert attribute in findings[1].detail
    with pytest.raises(PredictorError, match=rf"^predictor 'zero_velocity': its {attribute} is"):
        predictor_of(settings)


def test_a_forecast_outside_every_cell_is_caught():
    class Far(Wrong):
        def wrong(self, positions, history, observed):
            return positions + 1e300

    settings = ZeroVelocitySettings(name="zero_velocity")
    far: Any = Far
    found = run_checks(CHECKS, PredictorPart(far, settings, Far(settings)))
    assert [f.check for f in found if f.verdict == "fail"] == ["gives metres"]
