"""``calibrate --noise``: a calibration stays, and its zones grow with a tracker's noise."""

import json

import numpy as np
import pytest

from hri_predict.zones.calibration import load_calibration
from tests.hri_predict.cli.test_calibrate import (  # noqa: F401
    CV,
    _short_fit,
    cli,
    folder,
    made,
    walking,
)


@pytest.mark.long
def test_all_but_the_growth_stays(cli, folder, made, tmp_path):  # noqa: F811
    out = tmp_path / "noisy.json"
    options = ["--noise", "--calibration", made, "--out", out, "--json"]
    status, text, _ = cli(*CV, "--data", folder, *options)
    assert status == 0
    said = json.loads(text)
    assert said["file"] == str(out)
    assert set(said["growth"]) == {"joint", "body"}
    before, after = json.loads(made.read_text()), json.loads(out.read_text())
    assert before.pop("noise") is None
    growth = after.pop("noise")
    assert before == after
    assert growth
    found = load_calibration(out).noise
    assert found is not None
    for table in found.table.values():
        assert table.shape == (3, 30)
        assert (np.diff(table, axis=0) >= 0).all()
        assert (np.diff(table, axis=1) >= 0).all()
    again = tmp_path / "again.json"
    assert cli(*CV, "--data", folder, "--noise", "--calibration", out, "--out", again)[0] == 0
    assert again.read_bytes() == out.read_bytes()  # the growth before has no part in it


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--check", "--noise"], "--noise: has no effect with --check"),
        (["--leave-out", "--noise"], "--noise: has no effect with --leave-out"),
        (["--noise", "--onto", "shipped"], "--onto: has no effect with --noise"),
        (["--noise", "--disturb"], "--disturb: has no effect with --noise"),
        (["--noise", "--as-recorded"], "--tracked: has no effect with --noise"),
    ],
)
def test_options_that_would_do_nothing_are_refused(cli, folder, tmp_path, options, said):  # noqa: F811
    status, _, err = cli(*CV, "--data", folder, "--out", tmp_path / "a.json", *options)
    assert status == 2
    assert said in err
    assert not (tmp_path / "a.json").exists()


def test_another_predictors_calibration_is_refused(cli, folder, made, tmp_path):  # noqa: F811
    options = ["--noise", "--calibration", made, "--out", tmp_path / "a.json"]
    status, _, err = cli("--predictor", "zero_velocity", "--data", folder, *options)
    assert status == 2
    assert "constant_velocity" in err


def some_of(folder, place, *seeds):  # noqa: F811
    """A folder with a few of the recordings."""
    place.mkdir()
    for seed in seeds:
        (place / f"walking_{seed}.npz").symlink_to(folder / f"walking_{seed}.npz")
    return place


def test_too_few_recordings_leave_the_file_alone(cli, folder, made, tmp_path):  # noqa: F811
    few, out = some_of(folder, tmp_path / "few", 0, 1, 2), tmp_path / "own.json"
    out.write_bytes(made.read_bytes())
    options = ["--noise", "--calibration", out, "--out", out]
    status, text, err = cli(*CV, "--data", few, *options)
    assert (status, text) == (2, "")
    assert err.splitlines()[-1].startswith("error: --data: too few recordings (3): ")
    assert out.read_bytes() == made.read_bytes()


def test_recordings_that_cannot_be_used_are_named_once(cli, folder, made, tmp_path):  # noqa: F811
    few = some_of(folder, tmp_path / "few", 0, 1, 2)
    walking(few / "short.npz", 9, frames=30)
    options = ["--noise", "--calibration", made, "--out", tmp_path / "a.json"]
    _, _, err = cli(*CV, "--data", few, *options)
    (line,) = [line for line in err.splitlines() if line.startswith("warning")]
    assert "short.npz" in line
    assert line.endswith("; left out")


@pytest.mark.parametrize("horizon", ["0.8", "1.21"])
def test_another_horizon_is_refused(cli, folder, made, tmp_path, monkeypatch, horizon):  # noqa: F811
    monkeypatch.setattr(
        "hri_predict.lab.calibration.noise.scores_seen", lambda *_, **__: pytest.fail("forecast")
    )
    options = ["--noise", "--calibration", made, "--out", tmp_path / "a.json"]
    status, _, err = cli(*CV, "--data", folder, *options, "--horizon", horizon)
    assert status == 2
    (line,) = err.splitlines()
    assert f"--horizon {horizon}: the calibration {made} reaches 1.2 s; give --horizon 1.2" in line
