"""``hri-predict evaluate``: tables, files, JSON, and one clear line for every mistake."""

import csv
import json
import os
from functools import partial

import numpy as np
import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import files, recordings
from hri_predict.lab.datasets.cmu_benchmark import MEAN_OVER
from hri_predict.predictors.neural.cmu_skeleton import CMU25, CMU38
from hri_predict.predictors.neural.network import Shape, network_class_of
from hri_predict.predictors.neural.settings import shipped_weights
from hri_predict.predictors.neural.weights import save_weights
from tests.shared import DATA, needs_data


@pytest.fixture
def cli(cli):
    """Run the command; gives exit status, standard output, standard error."""
    return partial(cli, "evaluate")


@pytest.fixture
def pack(tmp_path):
    """A pack of short random test recordings."""
    (tmp_path / "pack" / "test").mkdir(parents=True)
    for k, action in enumerate(MEAN_OVER):
        expmap = np.random.default_rng(k).normal(size=(200, 117), scale=0.1)
        path = tmp_path / "pack" / "test" / f"{action}_1.npz"
        np.savez(path, expmap=expmap.astype(np.float32))
    return tmp_path / "pack"


@pytest.mark.long
def test_benchmark_as_json_and_as_files(cli, pack, tmp_path):
    out = tmp_path / "report"
    arguments = ["--benchmark", "cmu", "--data", pack, "--predictor", "constant_velocity"]
    status, text, told = cli(*arguments, "--json", "--out", out)
    assert status == 0
    found = json.loads(text)
    assert (found["windows"], found["n_in"], found["n_out"]) == ("all", 10, 25)
    assert [r["method"] for r in found["results"]] == ["constant_velocity", "zero_velocity"]
    first = found["results"][0]
    assert set(first["actions"]) == set(MEAN_OVER)
    errors = [first["actions"][a]["errors"] for a in MEAN_OVER]
    assert first["mean"] == pytest.approx(np.mean(errors, axis=0), abs=1e-4)
    assert len(first["mean"]) == 25
    assert {p["method"] for p in found["printed"]} >= {"PGBIG", "AuxFormer"}
    stem = "constant_velocity_cmu_all_10to25"
    assert {p.name for p in out.iterdir()} == {
        f"{stem}{e}" for e in (".md", ".csv", ".json", ".png")
    }
    assert told.startswith("written: ")
    assert json.loads((out / f"{stem}.json").read_text(encoding="utf-8")) == found
    rows = list(csv.DictReader((out / f"{stem}.csv").open(encoding="utf-8")))
    (cell,) = [
        r
        for r in rows
        if (r["method"], r["action"], r["nominal_ms"]) == ("constant_velocity", "soccer", "400")
    ]
    soccer = first["actions"]["soccer"]["errors"]
    assert float(cell["error_benchmark_mm"]) == soccer[9]
    markdown = (out / f"{stem}.md").read_text(encoding="utf-8")
    assert "| PGBIG, printed | 10.69 |" in markdown
    assert "STB" not in markdown  # prints errors of 10 frames' windows, and of those alone
    assert "hri-predict evaluate --benchmark cmu" in markdown


def test_benchmark_on_screen(cli, pack):
    status, text, told = cli(
        *["--benchmark", "cmu", "--data", pack, "--predictor", "zero_velocity"],
        *["--windows", "8-seeds", "--n-out", "10"],
    )
    assert (status, told) == (0, "")
    assert "TrajectoryCNN, printed" in text
    assert "PGBIG" not in text
    assert "560" not in text


def test_euler_error_is_read_twice(cli, pack):
    status, text, _ = cli(
        *["--benchmark", "cmu", "--data", pack, "--predictor", "zero_velocity"],
        *["--error", "euler", "--windows", "80-seeds", "--json"],
    )
    assert status == 0
    found = json.loads(text)
    assert found["read_at_future_frames"] == [[1, 3, 7, 9, 13, 24], [0, 2, 6, 8, 12, 23]]
    assert (found["unit"], found["n_in"]) == ("rad", 50)
    assert [p["method"] for p in found["printed"]] == ["KD-Former"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--benchmark", "cmuu"], "did you mean 'cmu'"),
        (["--benchmark", "cmu", "--windows", "8"], "all, 8-seeds, 80-seeds"),
        (["--benchmark", "cmu", "--n-out", "12"], "10 or 25"),
        (["--benchmark", "cmu", "--predictor", "kalman"], "trained predictors"),
        (["--benchmark", "cmu", "--predictor", "stb"], "give --weights FILE"),
        (["--benchmark", "cmu", "--predictor", "average"], "give two or more"),
        (["--benchmark", "cmu", "--predictor", "stbb"], "unknown predictor 'stbb'"),
        (["--benchmark", "cmu", "--weights", "w"], "does not use weights"),
        (["--benchmark", "cmu", "--error", "euler", "--predictor", "constant_velocity"], "--error"),
        (["--benchmark", "human36m"], "S5/<action>_<n>.txt"),
        (["--split", "tests"], "did you mean 'test'"),
        (["--weights", "w"], "does not use weights"),
        (["--predictor", "kalman", "--predictor", "kalman"], "--predictor kalman: given twice"),
        (
            ["--predictor", "kalman", "--predictor", "sinn", "--weights", "w"],
            "1 given for 2 --predictor",
        ),
        (["--predictor", "sinn", "--weights", "w"], "weights w: the file does not exist"),
        (["--predictor", "sin"], "did you mean 'sinn'"),
        (["--out", "/dev/null/report"], "--out /dev/null/report: cannot be written"),
        (["--n-out", "10"], "--n-out: has no effect without --benchmark"),
        (["--windows", "8-seeds"], "--windows: has no effect without --benchmark"),
        (["--error", "euler"], "--error: has no effect without --benchmark"),
        (["--benchmark", "cmu", "--split", "test"], "--split: has no effect with --benchmark"),
        (["--benchmark", "cmu", "--disturb"], "--disturb: has no effect with --benchmark"),
        (["--benchmark", "cmu", "--n-out", "0"], "10 or 25"),
        (["--benchmark", "cmu", "--n-in", "1"], "2 to 50 observed frames"),
        (["--benchmark", "cmu", "--horizon", "2"], "--horizon: has no effect with --benchmark"),
        (["--set", "sinn.threads=2"], "write it as NAME.key=value"),
        (["--set", "zero_velocity.process"], "write it as NAME.key=value"),
        (["--set", "zero_velocity.name=kalman"], "give the --predictor that you mean"),
        (["--set", "zero_velocity.rate_hz=10"], "at the same rate; leave it out"),
        (["--set", "zero_velocity.horizon_s=2"], "give --horizon instead"),
        (["--predictor", "sinn=w", "--set", "sinn.weights=v"], "give --predictor NAME=WEIGHTS"),
        (["--horizon", "1.9"], "--horizon 1.9: is evaluated to 1, 1.6, 2 s; give one of them"),
        (["--horizon", "nan"], "--horizon nan: is evaluated to 1, 1.6, 2 s"),
        (["--horizon", "0"], "--horizon 0: is evaluated to 1, 1.6, 2 s; give one of them"),
        (["--horizon", "-1"], "--horizon -1: is evaluated to 1, 1.6, 2 s; give one of them"),
    ],
)
def test_mistakes_end_in_one_line(cli, pack, arguments, told):
    given = ["--data", pack]
    given += [] if "--predictor" in arguments else ["--predictor", "zero_velocity"]
    status, text, error = cli(*given, *arguments)
    assert (status, text) == (2, "")
    assert len(error.splitlines()) == 1
    assert error.startswith("error: ")
    assert told in error


def test_recordings_of_a_folder_a_file_and_a_pack(tmp_path):
    folder = tmp_path / "own"
    (folder / "day1").mkdir(parents=True)
    names = ["b.npz", "a.bvh", "day1/c.mcap", "notes.txt"]
    for name in names:
        (folder / name).touch()
    assert recordings(folder, "test") == [folder / n for n in ("a.bvh", "b.npz", "day1/c.mcap")]
    assert recordings(folder / "b.npz", "test") == [folder / "b.npz"]
    with pytest.raises(ConfigError, match="no such file"):
        recordings(tmp_path / "none", "test")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match="holds no recording"):
        recordings(tmp_path / "empty", "test")


@needs_data
def test_a_folder_of_the_pack_gives_its_part_of_a_split_or_all_of_it():
    part = files([DATA / "motion" / "cmu_tools"], "test_motion")
    assert [path.stem for path in part] == ["62_03", "62_10"]
    assert len(files([DATA / "motion" / "cmu_tools"], None)) == 12
    assert len(files([DATA], "test_motion")) == 58
    assert len(files([DATA / "cmu_mocap"], None)) == 24  # as before: the test recordings
    with pytest.raises(ConfigError, match=r"cmu_tools: no recording of the split test; name"):
        files([DATA / "motion" / "cmu_tools"], "test")


@pytest.mark.long
def test_several_on_the_benchmark_share_tables_and_files(cli, pack, tmp_path):
    names = ("constant_velocity", "zero_velocity")
    asked = [argument for name in names for argument in ("--predictor", name)]
    common = ["--benchmark", "cmu", "--data", pack, "--windows", "8-seeds"]
    status, text, _ = cli(*common, *asked, "--json", "--out", tmp_path / "both")
    assert status == 0
    both = json.loads(text)
    assert [r["method"] for r in both["results"]] == list(names)
    assert both["cards"] == {}
    stem = "constant_velocity_zero_velocity_cmu_8-seeds_10to25"
    markdown = (tmp_path / "both" / f"{stem}.md").read_text(encoding="utf-8")
    assert markdown.startswith("# constant_velocity, zero_velocity on the CMU-Mocap benchmark")
    alone = json.loads(cli(*common, "--predictor", "zero_velocity", "--json")[1])
    assert both["results"][1] == alone["results"][0]


def untrained(path, method, seed, shape):
    """Weights of a freshly initialised network."""
    torch.manual_seed(seed)
    made = network_class_of(method)
    assert made is not None
    network = made(shape, made.options_model())
    save_weights(path, method, network, {"commit": f"of {method}"})
    return path


@pytest.mark.long
def test_each_network_on_the_benchmark_reads_its_own_weights(cli, pack, tmp_path):
    pytest.importorskip("matplotlib")
    shape = Shape(skeleton=CMU25, history_steps=10, horizon_steps=25, rate_hz=25.0, framed=True)
    names = ("sinn", "trajectorycnn")
    files = [untrained(tmp_path / f"{n}.safetensors", n, 3, shape) for n in names]
    pairs = [["--predictor", n, "--weights", f] for n, f in zip(names, files, strict=True)]
    common = ["--benchmark", "cmu", "--data", pack, "--windows", "8-seeds", "--json"]
    status, text, _ = cli(*common, *pairs[0], *pairs[1], "--out", tmp_path / "both")
    assert status == 0
    both = json.loads(text)
    assert [r["method"] for r in both["results"][:2]] == list(names)
    assert {n: card["commit"] for n, card in both["cards"].items()} == {n: f"of {n}" for n in names}
    for name, pair in zip(names, pairs, strict=True):
        alone = json.loads(cli(*common, *pair)[1])["results"][0]
        assert alone in both["results"]
        assert alone["method"] == name
    texts = [f"{n}={f}" for n, f in zip(names, files, strict=True)]
    asked = [part for text in (*texts, "average") for part in ("--predictor", text)]
    mean = json.loads(cli(*common, *asked)[1])["results"][2]
    assert mean["method"] == "average"
    assert mean["mean"][-1] < max(r["mean"][-1] for r in both["results"][:2])
    rotations = Shape(skeleton=CMU38, history_steps=50, horizon_steps=25, rate_hz=25.0, framed=True)
    mapped = untrained(tmp_path / "rotations.safetensors", "sinn", 3, rotations)
    status, _, error = cli(*common, "--predictor", "sinn", "--weights", mapped, *pairs[1])
    assert status == 2
    assert error.startswith("error: --predictor: errors differ (sinn euler, trajectorycnn mpjpe)")


def test_a_network_that_reads_more_than_the_windows_have_is_told(cli, pack, tmp_path):
    shape = Shape(skeleton=CMU25, history_steps=25, horizon_steps=25, rate_hz=25.0, framed=True)
    weights = untrained(tmp_path / "mixer.safetensors", "mixer", 3, shape)
    asked = ["--benchmark", "cmu", "--data", pack, "--windows", "8-seeds", "--predictor", "mixer"]
    status, _, error = cli(*asked, "--weights", weights)
    assert status == 0
    assert "mixer observes 25 frames, of which 15 are missing in windows of 10" in error
    status, text, error = cli(*asked, "--weights", weights, "--n-in", "25", "--json")
    assert (status, error, json.loads(text)["n_in"]) == (0, "", 25)


def test_the_benchmark_without_matplotlib_has_tables_alone(cli, pack, tmp_path, no_matplotlib):
    asked = ["--benchmark", "cmu", "--data", pack, "--windows", "8-seeds", "--out", tmp_path / "b"]
    status, _, err = cli(*asked, "--predictor", "zero_velocity")
    assert (status, err.count(no_matplotlib)) == (0, 1)
    assert sorted(path.suffix for path in (tmp_path / "b").iterdir()) == [".csv", ".json", ".md"]


@pytest.fixture
def walk(tmp_path):
    """A recording of 4 s of even walking, half a metre a second."""
    path = tmp_path / "walking_1.npz"
    steps = np.arange(480)[:, None, None] / 120.0
    rest = np.random.default_rng(0).normal(size=(1, 38, 3), scale=0.3)
    positions = rest + np.array([0.0, 1.0, 0.0]) + steps * np.array([0.5, 0.0, 0.0])
    np.savez(path, positions_world=positions.astype(np.float32), fps=np.float32(120))
    return path


@pytest.mark.long
def test_several_predictors_are_judged_on_the_same_windows(cli, walk, tmp_path):
    pytest.importorskip("matplotlib")
    both = ["--predictor", "constant_velocity", "--predictor", "sinn"]
    status, text, told = cli("--data", walk, *both, "--json", "--out", tmp_path / "report")
    assert status == 0
    results = {r["predictor"]: r for r in json.loads(text)["results"]}
    assert list(results)[:2] == ["constant_velocity", "sinn"]
    assert len(results) == 6
    alone = json.loads(cli("--data", walk, "--predictor", "sinn", "--json")[1])["results"]
    assert results["sinn"] == alone[0]  # whoever is judged beside it
    pictures = {p.stem for p in (tmp_path / "report").glob("*.png")}
    assert {"filmstrip_constant_velocity", "filmstrip_sinn", "error_by_action"} <= pictures
    assert "filmstrip_kalman" not in pictures  # only what was asked for
    assert "filmstrip_sinn.png" in told
    markdown = (tmp_path / "report" / "real.md").read_text(encoding="utf-8")
    assert "| sinn |" in markdown
    assert "| constant_velocity |" in markdown


def test_recordings_without_matplotlib_have_tables_alone(cli, walk, tmp_path, no_matplotlib):
    out = tmp_path / "report"
    status, _, err = cli("--data", walk, "--predictor", "zero_velocity", "--out", out)
    assert (status, err.count(no_matplotlib)) == (0, 1)
    assert sorted(path.name for path in out.iterdir()) == ["real.csv", "real.json", "real.md"]


def test_two_seconds_of_a_predictor_with_settings_of_its_own(cli, walk):
    asked = ["--data", walk, "--predictor", "constant_velocity", "--json"]
    status, text, _ = cli(*asked, "--horizon", 2, "--set", "constant_velocity.span_s=0.04")
    found = json.loads(text)
    assert (status, found["horizons_ms"][-1]) == (0, 2000)
    own, _, _, of_40_ms, kalman = (r["mean_mm"] for r in found["results"])
    assert own == of_40_ms
    assert len(own) == 8
    asked = ["--data", walk, "--predictor", "kalman", "--horizon", 2, "--json"]
    found = json.loads(cli(*asked, "--set", "kalman.history_s=0.1")[1])["results"]
    assert found[0]["mean_mm"] != kalman  # a baseline with other settings is not the baseline


def test_a_recording_without_a_window_is_named_and_left_out(cli, walk, tmp_path):
    short = tmp_path / "glimpse_1.npz"
    positions = np.zeros((30, 38, 3), dtype=np.float32)
    np.savez(short, positions_world=positions, fps=np.float32(120))
    asked = ["--predictor", "zero_velocity"]
    status, text, error = cli("--data", walk, "--data", short, *asked)
    assert status == 0, error
    assert error == (
        f"warning: recording {short}: no person is seen long enough for 120 ms; left out\n"
    )
    assert "glimpse" not in text
    status, _, error = cli("--data", short, *asked)
    assert (status, len(error.splitlines())) == (2, 1)
    assert "no recording can be evaluated" in error
    assert "seen long enough" in error


def test_a_slow_recording_and_one_of_unknown_joints_are_left_out(cli, walk, tmp_path):
    rows = "".join(f"{0.2 * k:.1f},0,0,1,0,0,2\n" for k in range(60))
    for name, joints in (("slow.csv", ("l_wrist", "r_wrist")), ("odd.csv", ("P1", "P2"))):
        columns = ",".join(f"{joint}_{axis}" for joint in joints for axis in "xyz")
        (tmp_path / name).write_text(f"time_s,{columns}\n{rows}", encoding="utf-8")
    asked = ["--predictor", "zero_velocity"]
    slow, odd = tmp_path / "slow.csv", tmp_path / "odd.csv"
    status, _, error = cli("--data", walk, "--data", slow, "--data", odd, *asked)
    assert status == 0, error
    first, second = error.splitlines()
    assert first.startswith(f"warning: recording {slow}: 5 frames per second say nothing")
    assert second.startswith(f"warning: recording {odd}: no joint matches")
    assert first.endswith("; left out")
    assert second.endswith("; left out")
    status, _, error = cli("--data", odd, *asked)
    assert (status, len(error.splitlines())) == (2, 1)
    assert "--joint-map FILE" in error


def test_a_split_of_what_has_none_and_a_recording_twice_are_refused(cli, walk, tmp_path):
    for entry in (walk, tmp_path):
        status, _, error = cli("--data", entry, "--split", "fit", "--predictor", "zero_velocity")
        assert status == 2
        assert error == (
            f"error: --split fit: has no effect on {entry}: only the data pack has splits; "
            f"leave it out\n"
        )
    (tmp_path / "link.npz").symlink_to(walk)
    for other in (walk, tmp_path, tmp_path / "link.npz"):
        status, _, error = cli("--data", walk, "--data", other, "--predictor", "zero_velocity")
        assert status == 2
        assert "is named twice" in error
        assert len(error.splitlines()) == 1


def test_a_benchmark_report_that_cannot_be_finished_leaves_the_old_one(
    cli, pack, tmp_path, monkeypatch
):
    out = tmp_path / "report"
    asked = ["--benchmark", "cmu", "--data", pack, "--windows", "8-seeds", "--out", out]
    assert cli(*asked, "--predictor", "zero_velocity")[0] == 0
    before = {path: path.read_bytes() for path in out.iterdir()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    status, _, error = cli(*asked, "--predictor", "zero_velocity", "--json")
    assert status == 2
    assert "No space left on device; name another folder" in error
    assert {path: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.long
def test_weights_go_to_the_predictor_in_the_same_place(cli, walk):
    sinn, other = (shipped_weights(name) for name in ("sinn", "trajectorycnn"))
    both = ["--data", walk, "--predictor", "trajectorycnn", "--predictor", "sinn"]
    status, text, _ = cli(*both, "--weights", other, "--weights", sinn, "--json")
    assert status == 0
    named, shipped = json.loads(text), json.loads(cli(*both, "--json")[1])
    assert [zones.pop("weights") for zones in named.pop("zones")] == [other.name, sinn.name]
    del shipped["zones"]
    assert named == shipped
    status, _, error = cli(*both, "--weights", sinn, "--weights", other)
    assert status == 2
    assert len(error.splitlines()) == 1
    assert "sinn.safetensors" in error


def test_real_recordings_beside_the_baselines(cli, walk):
    status, text, told = cli("--data", walk, "--predictor", "constant_velocity", "--json")
    assert (status, told) == (0, "")
    found = {r["predictor"]: r for r in json.loads(text)["results"]}
    assert {"constant_velocity", "zero_velocity", "kalman"} <= set(found)
    (zones,) = json.loads(text)["zones"]
    assert zones["calibrated"]
    assert zones["calibration"] == "constant_velocity.calibration.json"
    walking = found["zero_velocity"]["actions"]["walking"]["mm"]
    assert walking[-1] == pytest.approx(500.0, abs=1.0)  # half a metre in the last horizon's second
    assert found["constant_velocity"]["actions"]["walking"]["mm"][-1] == pytest.approx(0, abs=1.0)
