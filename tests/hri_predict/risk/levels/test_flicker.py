"""Noise does not make advice flicker: an approach, a stay and a departure with 2 cm of it."""

import itertools
from typing import Any

import numpy as np
import pytest

from hri_predict import load_predictor
from hri_predict.protocol.messages import Level
from hri_predict.risk.settings import RiskSettings
from hri_predict.zones.calibration import load_calibration, shipped_calibration
from tests.hri_predict.risk.engine_cell import HISTORY, RATE_HZ, Cell, body

NOISE_M = 0.02
NEAR_M = 0.95
STEP_M = 1.2 / RATE_HZ
PLACES = np.concatenate(
    [
        np.full(100, 4.5),
        np.arange(4.5, NEAR_M, -STEP_M),
        np.full(50, NEAR_M),
        np.arange(NEAR_M, 4.5, STEP_M),
        np.full(60, 4.5),
    ]
)
"""Metres before the robot: comes at a walk, stays at the edge of "too close", goes."""


def story(mode, seed, predictor=None):
    """(level, reason) of every tick, from the first clear one on.

    Without a predictor, zones are uncalibrated and forecasts stand still.
    """
    rng = np.random.default_rng(seed)
    cell, steps = Cell(RiskSettings(mode=mode)), HISTORY
    if predictor is not None:
        calibration = load_calibration(shipped_calibration("sinn"))
        horizon_steps, steps = predictor.horizon_steps, predictor.history_steps
        cell = Cell(RiskSettings(mode=mode), horizon_steps=horizon_steps, calibration=calibration)
    captures = [body(PLACES[0]) + rng.normal(0, NOISE_M, (21, 3)) for _ in range(steps)]
    found = []
    for x in PLACES:
        captures = [*captures[1:], body(x) + rng.normal(0, NOISE_M, (21, 3))]
        seen: dict[str, Any] = {
            "history": np.array(captures)[None],
            "last_positions": captures[-1][None],
        }
        if predictor is not None:
            seen["observed"] = np.ones((1, steps, 21), bool)
            seen["forecast"] = predictor.predict(seen["history"], seen["observed"])
        advice = cell.step(x, **seen)
        found.append((advice.level, advice.reason))
    return list(itertools.dropwhile(lambda told: told[0] is not Level.CLEAR, found))


@pytest.mark.parametrize("mode", ["iso", "predictive"])
@pytest.mark.parametrize("seed", range(2))
def test_each_level_comes_once_each_way_and_a_reason_changes_at_most_twice_a_level(mode, seed):
    check(story(mode, seed))


@pytest.fixture(scope="module")
def sinn():
    return load_predictor("sinn", horizon_s=1.2)


@pytest.mark.long
@pytest.mark.parametrize("mode", ["iso", "predictive"])
@pytest.mark.parametrize("seed", range(2))
def test_so_it_is_with_calibrated_zones_of_a_trained_predictor(mode, seed, sinn):
    check(story(mode, seed, sinn))


def check(told):
    levels = [level for level, _ in itertools.groupby(level.rank for level, _ in told)]
    top = levels.index(max(levels))
    assert levels[top] == Level.STOP.rank
    assert levels[: top + 1] == sorted(set(levels[: top + 1]))
    assert levels[top:] == sorted(set(levels[top:]), reverse=True)
    for _, ticks in itertools.groupby(told, key=lambda each: each[0]):
        reasons = [reason for reason, _ in itertools.groupby(r for _, r in ticks)]
        assert len(reasons) <= 3, reasons
