"""``calibrate`` names recordings that the predictor's weights were fitted on."""

import json

import numpy as np
import pytest

from hri_predict.cli.calibrate.inputs import Data, warn_of_fitted
from hri_predict.lab.calibration.fitted_on import fitted_on
from hri_predict.predictors.baselines import ConstantVelocitySettings
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import Shape
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.predictors.neural.weights import save_weights
from hri_predict.predictors.trajectorycnn import TrajectoryCNN, TrajectoryCNNOptions
from tests.commands import status_of
from tests.hri_predict.cli.test_calibrate import walking

SHAPE = Shape(skeleton=BODY, history_steps=5, horizon_steps=30, rate_hz=25.0)


@pytest.fixture
def there(tmp_path):
    """Three recordings, of which the first two are given to training."""
    for name in "abc":
        (tmp_path / f"{name}.npz").write_bytes(name.encode() * 9)
    return tmp_path


def weights(folder, judgement="real", **data):
    """Weights whose file states this training."""
    network = TrajectoryCNN(SHAPE, TrajectoryCNNOptions(channels=4, blocks=1))
    card = json.loads(json.dumps({"config": {"judgement": judgement, "data": data}}, default=str))
    save_weights(folder / "w.safetensors", "trajectorycnn", network, card)
    return folder / "w.safetensors"


def names(of, *recordings):
    return [path.name for path in fitted_on([of], recordings)]


def test_recordings_are_known_by_their_content(there):
    made = weights(there, root=there, fit=["[ab].npz"], validation=["c.npz"])
    copy = there / "elsewhere" / "copy.npz"
    copy.parent.mkdir()
    copy.write_bytes((there / "a.npz").read_bytes())
    other = copy.parent / "b.npz"
    other.write_bytes(b"of another day")
    assert names(made, there / "b.npz", there / "c.npz", copy, other) == ["b.npz", "copy.npz"]


def test_a_refit_fits_the_validation_recordings_too(there):
    made = weights(there, root=there, fit=["a.npz"], validation=["c.npz"], refit=True)
    assert names(made, there / "b.npz", there / "c.npz") == ["c.npz"]


def test_recordings_whose_folder_is_gone_are_known_by_name(there):
    made = weights(there, root=there / "gone", fit=["day/a.npz", "*.npz"])
    assert names(made, there / "day" / "a.npz", there / "a.npz", there / "b.npz") == ["a.npz"]


def test_the_data_pack_is_known_by_its_splits(there):
    made = weights(there, root=there / "gone")
    fitted = there / "cmu_mocap" / "train" / "basketball_1.npz"
    assert fitted_on([made], [there / "basketball_1.npz", fitted]) == [fitted]
    assert names(weights(there, judgement="waves", seed=3), fitted) == []


@pytest.mark.parametrize("config", [None, [], {"data": 3}, {"data": {"fit": ["", ".", "/"]}}])
def test_weights_that_do_not_say_it_warn_of_nothing(there, config):
    network = TrajectoryCNN(SHAPE, TrajectoryCNNOptions(channels=4, blocks=1))
    save_weights(there / "w.safetensors", "trajectorycnn", network, {"config": config})
    assert names(there / "w.safetensors", there / "a.npz") == []


def test_they_are_named_in_one_line(there, capsys):
    made = weights(there, root=there, fit=["a.npz", "b.npz"])
    settings = NeuralSettings(name="trajectorycnn", weights=str(made))
    data = Data([there / "a.npz", there / "c.npz"], None, None)
    warn_of_fitted(settings, data, "")
    assert capsys.readouterr().err == (
        "warning: the weights of trajectorycnn were fitted on 1 of these 2 recordings (a.npz): "
        "errors on them are smaller than on others, and so would be the zones; give recordings "
        "that the predictor was not trained on\n"
    )
    warn_of_fitted(settings, data._replace(entries=[there / "c.npz"]), "")
    warn_of_fitted(ConstantVelocitySettings(name="constant_velocity"), data, "")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("more", [[], ["--check"], ["--onto", "shipped"], ["--leave-out"]])
def test_every_way_of_calibrating_warns(tmp_path, capsys, monkeypatch, more):
    walking(tmp_path / "walking_1.npz", 1)
    made = weights(tmp_path, root=tmp_path, fit=["walking_1.npz"])

    class Warned(Exception):
        """What follows takes minutes."""

    def warned(settings, data, default):
        assert np.array_equal(data.entries, [tmp_path / "walking_1.npz"])
        raise Warned

    for place in ("making", "checking", "site"):
        monkeypatch.setattr(f"hri_predict.cli.calibrate.{place}.warn_of_fitted", warned)
    monkeypatch.setattr("hri_predict.cli.calibrate.checking._calibration", lambda *_: None)
    monkeypatch.setattr(
        "hri_predict.cli.calibrate.site._base", lambda *_: (tmp_path / "base.json", None)
    )
    monkeypatch.setattr("hri_predict.cli.calibrate.site.demand_horizon", lambda *_: None)
    words = [
        "--predictor",
        "trajectorycnn",
        "--weights",
        made,
        "--data",
        tmp_path / "walking_1.npz",
    ]
    with pytest.raises(Warned):
        status_of("calibrate", *words, "--out", tmp_path / "out.json", *more)
