"""Standard deviations of a recording's forecasts, from the shipped calibrations."""

from dataclasses import replace

import numpy as np
import pytest

import hri_predict
from hri_predict.base.errors import ConfigError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.recording.recording import recording_of
from hri_predict.zones.radii import Radii
from hri_sim.people.body import Body

RATE_HZ = 30.0
AT_05_S = 11  # the step nearest to half a second


@pytest.fixture
def recording(tmp_path):
    """Person 1 stands, person 2 glides at 1 m/s and shakes by 5 cm; 2 s."""
    body = Body(1.75)
    times = np.arange(60)[:, None, None] / RATE_HZ
    pose = body.joints(body.standing(np.zeros(2), 0.0))
    shaking = np.random.default_rng(0).normal(0, 0.05, (60, 21, 3))
    moving = pose + times * np.array([1.0, 0.0, 0.0]) + shaking
    standing = np.broadcast_to(pose + np.array([0.0, 3.0, 0.0]), moving.shape)
    return recording_of(
        path=tmp_path / "two.csv",
        kind="csv",
        joint_map=load_joint_map("canonical"),
        raw=np.stack([standing, moving], axis=1),
        rate_hz=RATE_HZ,
        ids=[1, 2],
    )


def found_in(recording, **settings):
    predictor = hri_predict.load_predictor("constant_velocity", **settings)
    calibration = hri_predict.load_calibration_of("constant_velocity")
    return list(hri_predict.forecasts(recording, predictor, calibration))


def test_every_forecast_has_a_standard_deviation_that_grows_with_the_horizon(recording):
    for found in found_in(recording):
        assert found.std.shape == found.positions.shape[:3]
        assert np.isfinite(found.std).all()
        assert (found.std > 0).all()
        assert (np.diff(found.std, axis=1) >= 0).all()


def test_whoever_is_hard_to_forecast_has_the_larger_one(recording):
    standing, shaking = found_in(recording)[-1].std[:, AT_05_S].mean(-1)
    assert shaking > 2 * standing


def test_nothing_is_known_beyond_the_calibrated_steps(recording):
    std = found_in(recording, horizon_s=2.0)[-1].std
    calibration = hri_predict.load_calibration_of("constant_velocity")
    assert calibration is not None
    steps = calibration.steps
    assert np.isfinite(std[:, :steps]).all()
    assert np.isinf(std[:, steps:]).all()


def test_nothing_is_known_without_a_calibration(recording):
    predictor = hri_predict.load_predictor("constant_velocity")
    for found in hri_predict.forecasts(recording, predictor):
        assert found.std.shape == found.positions.shape[:3]
        assert np.isinf(found.std).all()


def test_it_is_causal(recording):
    cut = replace(recording, scenes=recording.scenes[:40], arrival_ns=recording.arrival_ns[:40])
    for a, b in zip(found_in(recording)[:40], found_in(cut), strict=True):
        np.testing.assert_array_equal(a.std, b.std)


def test_a_predictors_own_standard_deviation_gives_way_to_a_calibration(recording):
    kalman = hri_predict.load_predictor("kalman")
    calibration = hri_predict.load_calibration_of("kalman")
    own = list(hri_predict.forecasts(recording, kalman))[-1]
    calibrated = list(hri_predict.forecasts(recording, kalman, calibration))[-1]
    assert np.isfinite(own.std).all()
    known = np.isfinite(calibrated.std)
    assert known.any()
    assert (own.std[known] != calibrated.std[known]).any()


def test_other_settings_have_no_calibration_and_other_rates_are_refused(recording):
    assert hri_predict.load_calibration_of("constant_velocity", rate_hz=50) is None
    calibration = hri_predict.load_calibration_of("constant_velocity")
    other = hri_predict.load_predictor("constant_velocity", rate_hz=50)
    with pytest.raises(ConfigError, match="25 steps per second"):
        next(hri_predict.forecasts(recording, other, calibration))


def test_nine_tenths_of_a_normal_distribution_lie_within_the_calibrated_radius(
    recording, monkeypatch
):
    monkeypatch.setattr(Radii, "of", lambda _self, _speed, about: np.ones(about.forecast.shape[:3]))
    std = float(found_in(recording)[-1].std.max())
    errors = np.random.default_rng(0).normal(0.0, std, (100_000, 3))
    within = (np.linalg.norm(errors, axis=-1) <= 1.0).mean()
    assert within == pytest.approx(0.9, abs=0.005)  # five standard errors of a share of 100,000
