"""Drift: a calibration that does not fit is noticed in minutes, one that fits not in a day."""

import logging
import math
from functools import cache

import numpy as np
import pytest

from hri_predict.protocol.reasons import Reason
from hri_predict.zones.self_check.drift import BLOCK_S, EVIDENCE, SAID_EVERY_S, Drift
from tests.hri_predict.risk.engine_cell import SETTINGS, Cell
from tests.hri_predict.zones.self_check.driving import checker, drive

HZ = 12.5
"""0.08 s apart: below the longest time that counts."""


def feed(drift, shares, start_s=1.0):
    """Captures with these shares of misses of 30 forecasts; (N,) whether it was drifting."""
    found = []
    for tick, share in enumerate(shares):
        drift.add(round((start_s + tick / HZ) * 1e9), 30.0 * share, 30.0)
        found.append(drift.drifting)
    return np.array(found)


def minutes(count):
    return round(60 * count * HZ)


@pytest.mark.parametrize(
    ("level", "share", "at_least", "at_most"),
    [
        (0.99, 1.0, 1.0, 2.0),
        (0.99, 0.5, 1.5, 2.1),
        (0.99, 0.1, 6.0, 7.5),
        (0.99, 0.05, 16.0, 17.5),
        (0.9, 0.3, 7.0, 9.0),
    ],
)
def test_too_many_misses_are_noticed_in_the_time_that_is_stated(level, share, at_least, at_most):
    found = feed(Drift(level), np.full(minutes(at_most), share))
    assert not found[: minutes(at_least)].any()
    assert found[-1]


@pytest.mark.parametrize(("level", "bearable"), [(0.99, 0.02), (0.95, 0.08), (0.9, 0.13)])
def test_what_is_bearable_is_never_drift(level, bearable):
    assert not feed(Drift(level), np.full(minutes(300), bearable)).any()


def test_it_ends_after_the_stated_time_and_does_not_flap():
    drift = Drift(0.99)
    feed(drift, np.full(minutes(10), 1.0))
    worse_and_better = np.tile(np.repeat([0.2, 0.0], minutes(5)), 5)
    assert feed(drift, worse_and_better, start_s=1000.0).all()
    feed(drift, np.full(minutes(10), 1.0), start_s=6000.0)
    found = feed(drift, np.full(minutes(60), 0.01), start_s=9000.0)
    changes = np.flatnonzero(np.diff(found.astype(int)))
    assert found[0]
    assert len(changes) == 1
    assert minutes(46) < changes[0] < minutes(48)
    assert drift.report()["raised"] == 1


@pytest.mark.long
def test_a_good_week_does_not_hide_a_bad_hour():
    drift = Drift(0.99)
    feed(drift, np.zeros(minutes(24 * 60)))
    assert feed(drift, np.full(minutes(8), 0.1), start_s=1e6)[-1]


def test_time_without_people_does_not_count():
    drift = Drift(0.99)
    for tick in range(200):  # a glance every minute: 20 s of people in all
        drift.add(round(60e9 * tick + 1), 30.0, 30.0)
        drift.add(round(60e9 * tick + 2), 0.0, 0.0)
    assert not drift.drifting
    assert BLOCK_S * math.log(EVIDENCE) / math.log1p(4) > 200 * 0.1


@cache
def errors(seed, hours):
    """(N,) errors of a person at work: correlated over a second, of an activity that changes every
    minute by a third."""
    rng = np.random.default_rng(seed)
    count = minutes(60 * hours)
    kept = math.exp(-1 / HZ)
    value = rng.standard_normal(count)
    for k in range(1, count):
        value[k] = kept * value[k - 1] + math.sqrt(1 - kept**2) * value[k]
    activity = np.repeat(np.exp(rng.normal(0, 0.3, hours * 60 + 1)), minutes(1))[:count]
    return np.abs(value) * activity


def shares(error, radius):
    """Of the forecasts of the last second, which one capture after the other judges."""
    missed = (error > radius).astype(float)
    return np.convolve(missed, np.full(12, 1 / 12))[: len(missed)]


@pytest.mark.parametrize("level", [0.9, 0.99])
@pytest.mark.long
def test_a_calibration_that_fits_is_not_accused_in_a_day_and_one_too_small_soon_is(level):
    radius = np.quantile(errors(1, 24), level)
    new = errors(2, 24)
    assert not feed(Drift(level), shares(new, radius)).any()
    for seed in (3, 4):
        assert feed(Drift(level), shares(errors(seed, 1), 0.6 * radius))[: minutes(30)].any()


def test_the_log_says_it_once_an_hour(caplog):
    drift = Drift(0.99)
    with caplog.at_level(logging.WARNING):
        feed(drift, np.full(minutes(150), 0.5))
    assert SAID_EVERY_S == 3600
    assert len(caplog.records) == 3  # after 2, 62 and 122 minutes
    assert "50.0 % of the forecasts missed, 1 % were stated" in caplog.text
    assert "calibrate --onto" in caplog.text


@pytest.mark.long
def test_the_self_check_feeds_it_with_the_radii_as_calibrated():
    # zones are widened at once, so that forecasts hold again; the calibration is no better for it
    check = checker()
    trusts = drive(check, 25 * 120, off=0.15)
    assert trusts[-1].widen.min() > 1.4
    told = check.report()["drift"]
    assert told == {"drifting": True, "raised": 1, "missed": pytest.approx(1.0)}
    good = checker()
    drive(good, 25 * 120, off=0.05)
    assert good.report()["drift"] == {"drifting": False, "raised": 0, "missed": None}


def test_the_engine_names_it_last_and_advises_as_before(monkeypatch):
    cell = Cell(SETTINGS)
    before = cell.settle(6.0)
    check = checker()
    check.drift.drifting = True
    monkeypatch.setattr(cell.engine, "_check", check)
    monkeypatch.setattr(type(cell.engine), "_trust", lambda *_: None)
    after = cell.settle(6.0)
    assert cell.assessment.reasons[-1] is Reason.CALIBRATION_DRIFT
    assert (after.level, after.reason) == (before.level, before.reason)
