"""Predictors side by side: their names in tables, their calibrations, one line for a mistake."""

import shlex
import shutil
from pathlib import Path

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.predictors.baselines import ConstantVelocitySettings, ZeroVelocitySettings
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.run import config as configuration
from hri_predict.run.compared_predictors import (
    asked_predictors,
    basis_of,
    demand_use,
    demand_weights,
    fitting,
    with_predictor,
)
from hri_predict.run.zone_basis import ZoneBasis
from hri_predict.zones.calibration import shipped_calibration
from hri_predict.zones.predictor_identity import calibrate_command
from hri_predict.zones.settings import CoverageSettings

CV = ConstantVelocitySettings(name="constant_velocity", rate_hz=25.0, horizon_s=1.2)
ZERO = ZeroVelocitySettings(name="zero_velocity", rate_hz=25.0, horizon_s=1.2)


def labels(*texts):
    return [asked.label for asked in asked_predictors(texts)]


def test_a_name_that_occurs_once_is_its_own_label():
    assert labels("sinn", "mixer=runs/best.safetensors") == ["sinn", "mixer"]


def test_the_same_predictor_with_other_weights_is_told_apart():
    assert labels("sinn", "sinn=runs/best.safetensors") == ["sinn", "sinn=best"]
    twice = labels("sinn=a/best.safetensors", "sinn=b/best.safetensors")
    assert twice == ["sinn=a/best", "sinn=b/best"]


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        (["sinn", "sinn"], "--predictor sinn: given twice"),
        (["sinn=w", "sinn=w"], "--predictor sinn=w: given twice"),
        (["sinn=w", "sinn=./a/../w"], "--predictor sinn=./a/../w: given twice"),
        (["sinn="], "--predictor sinn=: write NAME or NAME=WEIGHTS"),
        (["=w"], "--predictor =w: write NAME or NAME=WEIGHTS"),
    ],
)
def test_a_mistake_is_one_line(texts, told):
    with pytest.raises(ConfigError) as raised:
        asked_predictors(texts)
    assert str(raised.value).startswith(told)
    assert "\n" not in str(raised.value)


def test_a_predictor_without_weights_refuses_them():
    (asked,) = asked_predictors(["kalman=w.safetensors"])
    with pytest.raises(ConfigError, match="does not use weights"):
        demand_weights(asked)


def test_a_calibration_goes_to_the_predictor_that_it_was_made_for(tmp_path):
    own = tmp_path / "mine.json"
    shutil.copy(shipped_calibration("constant_velocity"), own)
    assert fitting([own], CV) == own
    assert fitting([own], ZERO) is None
    demand_use([own], {"constant_velocity": CV, "zero_velocity": ZERO})
    with pytest.raises(ConfigError, match="is of predictor constant_velocity, and fits none of"):
        demand_use([own], {"zero_velocity": ZERO})
    faster = CV.model_copy(update={"span_s": 0.2})
    with pytest.raises(ConfigError, match=r"was made with span_s .* hri-predict calibrate"):
        demand_use([own], {"constant_velocity": faster})


def test_zones_say_what_they_rest_on(tmp_path):
    (asked,) = asked_predictors(["constant_velocity"])
    shipped = basis_of(asked, CV, CoverageSettings(), Path())
    assert shipped.line == (
        "Zones of constant_velocity: calibrated by constant_velocity.calibration.json, shipped."
    )
    own = tmp_path / "mine.json"
    shutil.copy(shipped_calibration("constant_velocity"), own)
    mine = basis_of(asked, CV, CoverageSettings(calibration=str(own)), Path())
    assert mine.line == "Zones of constant_velocity: calibrated by mine.json."
    faster = CV.model_copy(update={"span_s": 0.2})
    none = basis_of(asked, faster, CoverageSettings(), Path())
    assert none.as_json()["calibrated"] is False
    assert none.line.endswith(
        "not calibrated, physical limits only, which reduces the robot's speed; calibrate it on a "
        "folder of your recordings: hri-predict calibrate --predictor constant_velocity --data "
        "recordings"
    )


def test_a_horizon_beyond_that_of_a_calibration_is_part_of_the_command():
    assert calibrate_command("kalman", None, 2.0).endswith("kalman --horizon 2 --data recordings")
    (asked,) = asked_predictors(["constant_velocity"])
    long = CV.model_copy(update={"horizon_s": 2.0, "span_s": 0.2})  # for which none is shipped
    assert "--horizon 2 " in basis_of(asked, long, CoverageSettings(), Path()).line


def test_weights_are_of_the_current_folder_not_of_the_configuration_s():
    demo = configuration.load(configuration.shipped("demo.yaml"))
    settings = with_predictor(demo, "mixer=runs/mixer.safetensors").predictor
    assert isinstance(settings, NeuralSettings)
    assert settings.weights == str(Path("runs/mixer.safetensors").absolute())
    assert settings.horizon_s == demo.predictor.horizon_s


def test_the_command_that_calibrates_own_weights_can_be_pasted():
    weights = Path("my runs/trajectorycnn.safetensors")
    basis = ZoneBasis(
        label="trajectorycnn", name="trajectorycnn", weights=weights, calibration=None, shipped=True
    )
    _, told = basis.line.split("recordings: ")
    words = shlex.split(told)
    assert words[:2] == ["hri-predict", "calibrate"]
    asked = dict(zip(words[2::2], words[3::2], strict=True))
    assert asked == {
        "--predictor": "trajectorycnn", "--weights": str(weights), "--data": "recordings"
    }  # fmt: skip
    assert basis.as_json()["weights"] == "trajectorycnn.safetensors"  # folders are one machine's
