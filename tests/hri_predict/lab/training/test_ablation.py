"""The ablation leaves out one augmentation at a time, trains for real, and does nothing twice."""

import signal
from pathlib import Path

import numpy as np
import pytest
import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.lab.training import ablation, paper_ablation
from hri_predict.lab.training.config import load_training_config
from hri_predict.lab.training.windows.augment import AugmentSettings
from hri_predict.lab.training.windows.motion import DataSettings, MotionSamples
from hri_predict.predictors.neural.network import network_class_of
from tests.commands import status_of
from tests.shared import DATA


@pytest.fixture
def config(tmp_path, request) -> Path | str:
    """A tiny TrajectoryCNN on two walks of points; or the name of a paper's network."""
    if getattr(request, "param", "own") != "own":
        return str(request.param)
    rng = np.random.default_rng(3)
    for name in ("fit_1", "check_1"):
        drift = np.arange(400)[:, None, None] * np.array([0.001, 0.0, 0.01])
        np.savez(
            tmp_path / f"{name}.npz",
            positions_world=(rng.normal(size=(1, 38, 3)) + drift).astype(np.float32),
            fps=np.float32(120), world_ok=np.ones(400, bool), rest_pose_frames=np.int32(0),
            floor_height=np.float32(0),
        )  # fmt: skip
    data = {"fit": ["fit_1.npz"], "validation": ["check_1.npz"]}
    train = {"windows_per_epoch": 8, "batch": 8}
    shape = {"history_steps": 15, "horizon_steps": 25, "rate_hz": 25.0}
    whole = {
        "predictor": "trajectorycnn", "judgement": "real", "shape": shape, "data": data,
        "train": train, "out": "elsewhere",
    }  # fmt: skip
    path = tmp_path / "tiny.yaml"
    path.write_text(yaml.safe_dump(whole))
    return path


@pytest.fixture
def ablate(config, tmp_path):
    """Run ``hri-predict ablate`` with some changes; gives its exit status."""

    def call(*changes, out=tmp_path / "runs", config=config, data=tmp_path):
        given = ["ablate", config, "--data", data, "--out", out]
        given += [word for change in changes for word in ("--set", change)]
        return status_of(*given)

    return call


SHARES = {
    "augment": set(AugmentSettings.model_fields) - {"noise_m", "outliers_m"},
    "bodies": {"share"},
    "trackers": {"rate", "dropped", "noise", "convention"},
}
"""By section, the settings that switch an augmentation off; the others say how strong it is."""


def settings_of(run) -> dict[str, object]:
    return {f"{s}.{k}": v for s in SHARES for k, v in run.data[s].items()}


def refused(status: int, capsys: pytest.CaptureFixture[str], says: str) -> None:
    """One line said why."""
    (line,) = capsys.readouterr().err.splitlines()
    assert status == 2
    assert line.startswith("error: ")
    assert says in line


def test_each_run_leaves_out_its_own_augmentation_alone(config):
    runs = ablation.runs(load_training_config(config))
    whole = settings_of(runs["all"])
    defaults = DataSettings(**load_training_config(config).data).model_dump()
    assert whole == {f"{s}.{k}": v for s in SHARES for k, v in defaults[s].items()}
    left_out = [
        {key for key, value in settings_of(run).items() if value != whole[key]}
        for name, run in runs.items()
        if name not in ("all", "none")
    ]
    assert all(left_out)
    every = {f"{section}.{name}" for section, names in SHARES.items() for name in names}
    assert sorted(key for keys in left_out for key in keys) == sorted(every)
    assert len({run.out for run in runs.values()}) == len(runs)


def test_the_run_without_any_has_none(config):
    none = ablation.runs(load_training_config(config))["none"]
    assert not any(none.data[section][name] for section, names in SHARES.items() for name in names)


@pytest.mark.parametrize("left_out", [2, pytest.param(None, marks=pytest.mark.long)])
def test_all_are_trained_and_judged_once(ablate, tmp_path, monkeypatch, capsys, left_out):
    fewer = dict(list(ablation.LEFT_OUT.items())[:left_out])
    monkeypatch.setattr(ablation, "LEFT_OUT", fewer)
    out = tmp_path / "runs"
    smaller = ["train.epochs=1", "options.channels=2"]
    assert ablate(*smaller) == 0
    printed = capsys.readouterr().out
    assert printed == (out / "ablation.md").read_text()
    rows = [line for line in printed.splitlines()[2:] if line]
    assert len(rows) == len(ablation.LEFT_OUT) + 1
    stamp = (out / "all" / "trajectorycnn.safetensors").stat().st_mtime_ns
    assert ablate(*smaller) == 0
    assert capsys.readouterr().out == printed
    assert (out / "all" / "trajectorycnn.safetensors").stat().st_mtime_ns == stamp


def test_a_folder_s_name_may_hold_anything(config, tmp_path):
    out = str(tmp_path / "runs #1: a")
    made = ablation.configuration(config, "data #2", out)
    assert (str(made.out), made.data["root"]) == (out, "data #2")


def test_ctrl_c_saves_and_the_same_command_goes_on(ablate, tmp_path, monkeypatch, capsys):
    draw, calls = MotionSamples.batch, iter(range(100))

    def interrupted(self, rng, size):
        if size == 8 and next(calls) == 1:
            signal.raise_signal(signal.SIGINT)
        return draw(self, rng, size)

    monkeypatch.setattr(MotionSamples, "batch", interrupted)
    assert ablate("train.epochs=3", "options.channels=2") == 130
    assert capsys.readouterr().err.splitlines()[-1] == "saved; continue with the same command"
    assert (tmp_path / "runs" / "all" / "last.pt").exists()
    assert not (tmp_path / "runs" / "none").exists()


def test_ctrl_c_in_the_last_step_of_a_run_does_not_start_the_next(ablate, tmp_path, monkeypatch):
    draw = MotionSamples.batch

    def interrupted(self, rng, size):
        if size == 8 and not (tmp_path / "runs" / "none").exists():
            signal.raise_signal(signal.SIGINT)
        return draw(self, rng, size)

    monkeypatch.setattr(MotionSamples, "batch", interrupted)
    one_step = ["train.epochs=1", "train.windows_per_epoch=8", "options.channels=2"]
    assert ablate(*one_step) == 130
    assert (tmp_path / "runs" / "all" / "trajectorycnn.safetensors").exists()
    assert [folder.name for folder in (tmp_path / "runs").iterdir()] == ["all"]


@pytest.mark.parametrize("out", ["/dev/null/runs", "taken"])
@pytest.mark.parametrize("config", ["own", "trajectorycnn"], indirect=True)
def test_what_cannot_be_written_is_told_before_the_first_run(
    ablate, tmp_path, monkeypatch, capsys, out
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken" / "ablation.md").mkdir(parents=True)
    monkeypatch.setattr(
        "hri_predict.lab.training.runs.trained", lambda *_, **__: pytest.fail("ran")
    )
    assert ablate(out=out) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot be written" in line


def test_a_table_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "ablation.md").mkdir()
    with pytest.raises(ConfigError, match=r"ablation.md: cannot be written: not a file"):
        ablation.write_table(tmp_path, "table")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("data.augment=3", "training configuration: data.augment: "),
        ("predictor=sinn", "is for 'sinn', but the ablation trains trajectorycnn"),
        (
            "shape.rate_hz=50",
            "shape.rate_hz 50: the evaluation on recordings runs at 25 Hz",
        ),
        ("data.refit=true", "data.refit: also fits the validation recordings"),
    ],
)
def test_what_cannot_end_well_is_refused_before_the_first_run(
    ablate, tmp_path, capsys, change, says
):
    refused(ablate(change), capsys, says)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("config", sorted(paper_ablation.PAPERS), indirect=True)
@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("data.refit=true", "data.refit: also fits the validation recordings"),
        ("shape.horizon_steps=9", "horizon_steps 9: the table shows 400 ms; give 10 or more"),
    ],
)
def test_a_paper_s_table_that_would_lack_numbers_is_refused_before_the_first_run(
    ablate, tmp_path, capsys, change, says
):
    refused(ablate(change), capsys, says)
    assert not (tmp_path / "runs").exists()


def test_ten_steps_are_enough_for_a_paper_s_table():
    runs = paper_ablation.configurations("sinn", "data", Path("runs"), ["shape.horizon_steps=10"])
    assert {run.shape.horizon_steps for run in runs.values()} == {10}


def test_sinn_s_figures_are_those_of_its_paper():
    """Chen et al., CVPR 2024, Table 4, eating: without STA, without SRE and whole."""
    rows = paper_ablation.PAPERS["sinn"].rows
    figures = {
        name.removeprefix("w/o ").split(",")[0]: printed for name, (_, printed) in rows.items()
    }
    assert figures == {"whole": 23.7, "SRE": 55.3, "STA": 45.2}


def test_a_benchmark_has_no_augmentations(ablate, capsys):
    assert ablate("judgement=benchmark") == 2
    assert "need judgement: real" in capsys.readouterr().err


@pytest.mark.parametrize("paper", sorted(paper_ablation.PAPERS))
def test_every_row_of_a_paper_is_another_network(paper):
    runs = paper_ablation.configurations(paper, "data", Path("runs"), [])
    made = network_class_of(paper)
    assert made is not None
    options = [
        made.options_model.model_validate(r.options).model_dump_json() for r in runs.values()
    ]
    assert len(set(options)) == len(runs)
    assert len({run.out for run in runs.values()}) == len(runs)


@pytest.mark.long
def test_a_paper_s_rows_are_trained_and_shown_with_its_figures(ablate, tmp_path, capsys):
    if not DATA.exists():
        pytest.skip("needs the data pack")
    smaller = ["train.epochs=1", "train.windows_per_epoch=16", "train.batch=8", "options.width=8"]
    out = tmp_path / "runs"
    assert ablate(*smaller, out=out, config="stb", data=DATA) == 0
    text = capsys.readouterr().out
    assert text == (out / "ablation.md").read_text()
    assert [line.split(" | ")[-1] for line in text.splitlines()[4:]] == [
        "28.96 |", "29.58 |", "30.24 |", "29.68 |", "34.06 |"
    ]  # fmt: skip
