"""Leaving a set out: it is not calibrated on, and its own figures are those of its recordings."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import JOINTS
from hri_predict.lab.calibration import leaving_out
from hri_predict.lab.calibration.leaving_out import as_json, leave_out, tables
from hri_predict.lab.calibration.scores import score_recordings
from hri_predict.predictors.baselines import ZeroVelocity, ZeroVelocitySettings
from tests.hri_predict.lab.calibration.conftest import recording_of
from tests.hri_predict.short_fit import short_fit

SETTINGS = ZeroVelocitySettings(name="zero_velocity", horizon_s=0.4)
PREDICTOR = ZeroVelocity(SETTINGS)


def walks(action, speeds):
    """Scores of one recording per speed (m/s): everybody glides along x."""
    found = []
    for k, speed in enumerate(speeds):
        along = speed * np.arange(60) / 25.0
        recording = recording_of(along_x(along), 25.0, name=f"{action}_{k}")
        found += score_recordings(PREDICTOR, [recording])
    return [replace(entry, action=action) for entry in found]


def along_x(metres):
    body = np.random.default_rng(1).normal(size=(len(JOINTS), 3))
    return body + np.asarray(metres)[:, None, None] * np.array([1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def found():
    slow = walks("cmu_tools", np.linspace(0.5, 0.6, 5))
    fast = walks("cmu_dance", np.linspace(0.9, 0.95, 5))
    with short_fit():
        return leave_out(
            predictor=PREDICTOR, settings=SETTINGS, scores=slow + fast, judged=slow + fast
        )


@pytest.mark.long
def test_each_set_that_occurs_is_left_out_once(found):
    assert [f.name for f in found] == ["cmu_tools", "cmu_dance"]
    assert [f.calibrated_on for f in found] == [5, 5]
    assert [f.recordings for f in found] == [5, 5]


def test_each_calibration_fits_the_predictor_and_names_no_recording_of_its_set(found):
    for entry in found:
        made = entry.calibration
        assert made.predictor == SETTINGS.name
        assert made.recordings
        assert not any(r.name.startswith(entry.name) for r in made.recordings)


def test_the_errors_are_those_of_the_set(found):
    """Zero velocity is wrong by what the body has gone, and stands still itself."""
    for entry, speed in zip(found, (0.55, 0.925), strict=True):
        assert entry.error_m[9] == pytest.approx(0.4 * speed, abs=1e-6)
        assert entry.standing_m == pytest.approx(entry.error_m)


def test_who_is_faster_than_those_calibrated_is_held_less_often(found):
    slow, fast = (f.coverage[0.9, "joint"].share("joint")[9] for f in found)
    assert slow > fast


def test_tables_and_json_tell_the_same(found):
    shown = tables(found, 25.0)
    assert [row[0] for row in shown[0].rows] == ["cmu_tools (5)", "cmu_dance (5)", "pooled"]
    report = as_json(found)
    assert [entry["set"] for entry in report] == ["cmu_tools", "cmu_dance"]
    share = report[0]["coverage"][0]["share"][2]  # 120 ms
    assert f"{100 * share:.1f}" == shown[0].rows[0][1]


def test_without_a_set_there_is_nothing_to_leave_out():
    walking = walks("walking", [0.5, 0.6])
    with pytest.raises(ConfigError, match="--leave-out: no recording belongs to a set"):
        leave_out(predictor=PREDICTOR, settings=SETTINGS, scores=walking, judged=walking)
    assert "arms" in leaving_out.SETS
