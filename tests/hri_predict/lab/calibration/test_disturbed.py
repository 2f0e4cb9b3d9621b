"""The self-check on what is unlike the calibrated: it is seen, and zones do not shrink for it."""

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.conformal import calibrate
from hri_predict.lab.calibration.coverage import Calibrated
from hri_predict.lab.calibration.disturbed import as_json, judge_disturbed, tables
from hri_predict.lab.calibration.scores import score_recordings
from hri_predict.predictors.baselines import ConstantVelocity, ConstantVelocitySettings

BODY = np.random.default_rng(4).normal((0.0, 0.0, 1.0), 0.3, size=(len(JOINTS), 3))


def strolling(seed, frames=90):
    """(F, J, 3) a body that walks at 1 m/s and turns a little, at 25 captures a second."""
    heading = np.random.default_rng(seed).normal(0, 0.05, frames).cumsum()
    ways = np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    return BODY + (ways / 25).cumsum(axis=0)[:, None]


@pytest.fixture(scope="module")
def found(make_recording):
    settings = ConstantVelocitySettings(name="constant_velocity", horizon_s=0.6)
    predictor = ConstantVelocity(settings)
    recordings = [make_recording(strolling(k), name=f"walking_{k}") for k in range(6)]
    scores = score_recordings(predictor, recordings)
    made = calibrate(
        scores=scores[:5],
        predictor="constant_velocity",
        settings={},
        weights=None,
        rate_hz=25.0,
        skeleton=CANONICAL,
    )
    return judge_disturbed(Calibrated(predictor, made), scores[5:])


def by_condition(found, start):
    return next(one for one in found if one.condition.startswith(start))


@pytest.mark.long
def test_what_is_like_the_calibrated_is_left_alone(found):
    plain = by_condition(found, "as recorded")
    assert plain.unlike == 0
    assert plain.with_check == plain.without


@pytest.mark.parametrize("condition", ["body scaled by 0.7", "body scaled by 1.4"])
def test_a_body_of_another_size_is_not_unlike(found, condition):
    scaled = by_condition(found, condition)
    assert scaled.unlike == 0.0
    assert scaled.with_check >= scaled.without


def test_a_moved_camera_is_noticed_at_once(found):
    moved = by_condition(found, "camera shifted by 20 cm")
    assert moved.noticed_s is not None
    assert moved.noticed_s <= 0.08  # two captures
    assert moved.with_check >= moved.without


def test_the_self_check_never_holds_less(found):
    assert len(found) == 6
    for one in found:
        assert one.with_check >= one.without - 1e-9, one.condition


def test_tables_and_json_say_the_same(found):
    (table,) = tables(found)
    assert [row[0] for row in table.rows] == [one["condition"] for one in as_json(found)]
    assert all(0 <= one["unlike"] <= 1 for one in as_json(found))
