"""Trackers err as the configuration says, and only in what the node would get."""

import numpy as np
import pytest

from hri_predict.lab.training.windows.trackers import (
    CONVENTIONS,
    FASTEST_HZ,
    TrackerSettings,
    draw_lost,
    draw_noise,
    draw_periods,
    hide_by_convention,
)
from hri_predict.predictors.neural.body import BODY

QUIET = TrackerSettings(rate=0, dropped=0, noise=0, convention=0)
COUNT, CAPTURES, JOINTS = 400, 60, len(BODY.joints)
TIMES = np.tile(np.arange(1 - CAPTURES, 1) / 60, (COUNT, 1))


def only(**changes: float) -> TrackerSettings:
    return QUIET.model_copy(update=changes)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_rates_lie_between_the_slowest_and_sixty_hertz(rng):
    rates = 1 / draw_periods(only(rate=1.0), rng, np.full(4000, 1 / 120))
    assert 8 <= rates.min() < 8.1
    assert 59 < rates.max() <= 60.001
    assert (rates < np.sqrt(8 * 60)).mean() == pytest.approx(0.5, abs=0.04)  # log-uniform; 5 sigma


def test_no_rate_is_higher_than_the_recordings(rng):
    rates = 1 / draw_periods(only(rate=0.5), rng, np.full(4000, 1 / 30))
    assert rates.max() <= 30.001
    assert (draw_periods(QUIET, rng, np.full(4, 1 / 120)) == 1 / FASTEST_HZ).all()


def test_the_newest_capture_is_never_lost(rng):
    lost = draw_lost(only(dropped=1.0, dropped_most=0.9), rng, COUNT, CAPTURES)
    assert not lost[:, -1].any()
    assert 0.35 < lost[:, :-1].mean() < 0.55  # 0.45; windows differ: sigma 0.26 / sqrt(400)
    assert not draw_lost(QUIET, rng, COUNT, CAPTURES).any()


def test_noise_is_as_large_as_stated_and_white_or_correlated(rng):
    white = draw_noise(only(noise=1.0, correlated=0.0), rng, TIMES, JOINTS)
    slow = draw_noise(only(noise=1.0, correlated=1.0), rng, TIMES, JOINTS)
    for noise in (white, slow):
        assert noise.std() == pytest.approx(0.03 / np.sqrt(3), rel=0.1)  # of a uniform sigma
        assert noise.std((1, 2, 3)).max() < 0.034

    def neighbours(noise: np.ndarray) -> float:
        return float((noise[:, 1:] * noise[:, :-1]).mean() / np.square(noise).mean())

    assert abs(neighbours(white)) < 0.01
    # constants of 0.05 to 0.5 s at 60 Hz: e^(-1/3) = 0.72 to 0.97
    assert 0.75 < neighbours(slow) < 0.97
    assert not draw_noise(QUIET, rng, TIMES, JOINTS).any()


def test_a_convention_leaves_what_its_joint_map_delivers(rng):
    observed = np.ones((COUNT, 5, JOINTS), bool)
    hide_by_convention(only(convention=1.0), rng, observed)
    kinds = np.unique(observed[:, 0], axis=0)
    assert 1 < len(kinds) <= len(CONVENTIONS)
    assert not observed[:, :, BODY.index("pelvis")].any()  # no joint map delivers it
    assert observed[:, :, BODY.index("l_wrist")].all()
    hand = observed[:, :, BODY.index("l_hand")]
    assert hand.any()
    assert not hand.all()
