"""A calibration belongs to one predictor with its settings, weights and code."""

from dataclasses import replace

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.predictors.baselines import ZeroVelocitySettings
from hri_predict.zones import calibration as module
from hri_predict.zones.calibration import calibration_for, save_text
from hri_predict.zones.predictor_identity import identity
from hri_predict.zones.settings import CoverageSettings

SETTINGS = ZeroVelocitySettings(name="zero_velocity")


@pytest.fixture
def folder(tmp_path, monkeypatch, make_calibration):
    """Where shipped calibrations lie, with one of zero velocity."""
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    values, _ = identity(SETTINGS)
    own = make_calibration(settings=values)
    (tmp_path / "zero_velocity.calibration.json").write_text(save_text(own), encoding="utf-8")
    return tmp_path


OTHERS = [
    (SETTINGS.model_copy(update={"history_s": 0.7}), "was made with history_s 0.5, not 0.7"),
    (SETTINGS.model_copy(update={"rate_hz": 50.0}), "is for 25 steps per second, not 50"),
    (SETTINGS.model_copy(update={"name": "other"}), "is of predictor zero_velocity, not other"),
]


def test_the_shipped_one_is_used_for_its_settings_alone(folder):
    found = calibration_for(SETTINGS, CoverageSettings(), folder)
    assert found is not None
    assert found.predictor == "zero_velocity"
    farther = SETTINGS.model_copy(update={"horizon_s": 0.6})  # the same forecast, cut
    assert calibration_for(farther, CoverageSettings(), folder) is not None
    for other, _ in OTHERS:
        assert calibration_for(other, CoverageSettings(), folder) is None


@pytest.mark.parametrize(("other", "said"), OTHERS, ids=["history", "rate", "name"])
def test_one_that_was_asked_for_is_refused_where_it_does_not_fit(folder, other, said):
    coverage = CoverageSettings(calibration="zero_velocity.calibration.json")
    assert calibration_for(SETTINGS, coverage, folder) is not None
    with pytest.raises(ConfigError) as error:
        calibration_for(other, coverage, folder)
    assert said in str(error.value)
    assert "hri-predict calibrate --predictor" in str(error.value)
    assert "\n" not in str(error.value)


def test_more_threads_are_no_other_predictor(folder, make_calibration):
    class Threaded(ZeroVelocitySettings):
        threads: int = 1

    one = Threaded(**SETTINGS.model_dump())
    values, _ = identity(one)
    own = folder / "zero_velocity.calibration.json"
    own.write_text(save_text(make_calibration(settings=values)), encoding="utf-8")
    two = one.model_copy(update={"threads": 2})
    assert calibration_for(two, CoverageSettings(), folder) is not None


def test_other_weights_are_another_predictor(folder, make_calibration):
    parts = [folder / "one.safetensors", folder / "other.safetensors"]

    class Weighted(ZeroVelocitySettings):
        def files(self):
            return tuple(parts)

    trained = Weighted(**SETTINGS.model_dump())
    assert identity(trained) == identity(SETTINGS)  # there are no such files yet
    for path, content in zip(parts, (b"fir", b"st"), strict=True):
        path.write_bytes(content)
    values, mark = identity(trained)
    assert mark is not None
    assert calibration_for(trained, CoverageSettings(), folder) is None  # it was without weights
    own = folder / "own.json"
    own.write_text(save_text(make_calibration(settings=values, weights=mark)), encoding="utf-8")
    coverage = CoverageSettings(calibration="own.json")
    assert calibration_for(trained, coverage, folder) is not None
    parts[1].write_bytes(b"second")
    with pytest.raises(ConfigError, match="was made with other weights"):
        calibration_for(trained, coverage, folder)


def test_other_code_of_a_third_party_is_another_predictor(folder, make_calibration, monkeypatch):
    coverage = CoverageSettings(calibration="own.json")

    def stored_with(code):
        made = replace(make_calibration(settings=identity(SETTINGS)[0]), code=code)
        (folder / "own.json").write_text(save_text(made), encoding="utf-8")

    monkeypatch.setattr(registry, "code_of", lambda settings: "1a")
    stored_with("1a")
    assert calibration_for(SETTINGS, coverage, folder) is not None
    stored_with(None)  # made by release 0.2
    assert calibration_for(SETTINGS, coverage, folder) is not None
    stored_with("1b")
    with pytest.raises(ConfigError, match=r"other code of predictor zero_velocity; calibrate your"):
        calibration_for(SETTINGS, coverage, folder)


def test_who_ships_none_is_not_calibrated_and_a_broken_one_is_no_secret(folder):
    with pytest.raises(ConfigError, match="cannot be read"):
        calibration_for(SETTINGS, CoverageSettings(calibration="none.json"), folder)
    (folder / "zero_velocity.calibration.json").write_text("{", encoding="utf-8")
    with pytest.raises(ConfigError, match=": not JSON"):
        calibration_for(SETTINGS, CoverageSettings(), folder)
    (folder / "zero_velocity.calibration.json").unlink()
    assert calibration_for(SETTINGS, CoverageSettings(), folder) is None
