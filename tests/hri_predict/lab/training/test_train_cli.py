"""``hri-predict train`` in process, on recordings made here."""

import json
import shutil
import signal
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch
import yaml

from hri_predict.base.files import data_path
from hri_predict.base.skeleton import make_skeleton
from hri_predict.lab.training.config import TrainingConfig, load_training_config
from hri_predict.lab.training.loop import Result
from hri_predict.lab.training.optimisation import Optimisation, learning_rate_factor
from hri_predict.lab.training.parts import DATA_SETS
from hri_predict.lab.training.processes import Processes
from hri_predict.lab.training.runs import build_network
from hri_predict.lab.training.windows.motion import MotionSamples
from hri_predict.predictors.neural.cmu_skeleton import CMU25, CMU38
from hri_predict.predictors.neural.network import Shape, network_class_of
from hri_predict.predictors.neural.weights import load_weights, save_weights
from hri_predict.predictors.trajectorycnn import TrajectoryCNN, TrajectoryCNNOptions

_REAL = sorted(path.stem for path in data_path("training").glob("*_real.yaml"))
PAPERS = sorted(data_path("training", "papers").glob("*.yaml"))
METHODS = [stem.removesuffix("_real") for stem in _REAL]


def write_walk(folder: Path, name: str, frames: int) -> None:
    """Somebody who glides along, in the data pack's layout: axes left, up, forward."""
    start = np.random.default_rng(5).normal(size=(1, 38, 3))
    start[0, 2, 0], start[0, 8, 0] = 0.1, -0.1  # the hips
    time = np.arange(frames)[:, None, None] / 120.0
    np.savez(
        folder / f"{name}.npz", fps=np.float32(120.0), world_ok=np.ones(frames, bool),
        positions_world=(start + time * np.array([0.0, 0.0, 1.0])).astype(np.float32),
        rest_pose_frames=np.int32(0), floor_height=np.float32(0),
    )  # fmt: skip


@pytest.fixture
def config(tmp_path):
    """A small run; its file."""
    for name, frames in (("walk_1", 400), ("walk_2", 300), ("check_1", 250)):
        write_walk(tmp_path, name, frames)
    path = tmp_path / "small.yaml"
    settings = {
        "predictor": "trajectorycnn",
        "judgement": "real",
        "shape": {"history_steps": 5, "horizon_steps": 10},
        "options": {"channels": 4, "blocks": 1},
        "data": {"root": str(tmp_path), "fit": ["walk_*.npz"], "validation": ["check_1.npz"]},
        "train": {"epochs": 3, "windows_per_epoch": 32, "batch": 16},
        "out": str(tmp_path / "run"),
    }
    path.write_text(yaml.safe_dump(settings), encoding="utf-8")
    return path


@pytest.fixture
def cli(cli):
    """Run the command; gives exit status, standard output, standard error."""
    return partial(cli, "train")


@pytest.mark.long
def test_it_trains_a_predictor(cli, config, tmp_path):
    status, out, err = cli(config, "--json")
    assert status == 0, err
    result = json.loads(out)
    assert result["ending"] == "epochs done"
    assert result["epochs"] == 3
    assert result["validation"]["actions_mm"].keys() == {"check"}
    assert [line.split("  ")[0] for line in err.splitlines()] == ["epoch 1", "epoch 2", "epoch 3"]
    assert list((tmp_path / "run" / "log").glob("events*"))
    loaded = load_weights(Path(result["weights"]))
    assert loaded.card["config"]["options"] == {"channels": 4, "blocks": 1}
    assert loaded.network.shape.horizon_steps == 10
    assert np.abs(loaded.network.rest.numpy()).max() > 0.1


def test_flags_change_the_configuration(cli, config, tmp_path):
    recordings = tmp_path / "elsewhere"
    recordings.mkdir()
    for name in ("walk_9", "check_1"):
        write_walk(recordings, name, 300)
    out = tmp_path / "other run"
    status, printed, err = cli(
        config, "--set", "train.epochs=1", "--set", "options.channels=5", "--data", recordings,
        "--out", out,
    )  # fmt: skip
    assert status == 0, err
    assert str(out / "trajectorycnn.safetensors") in printed
    card = load_weights(out / "trajectorycnn.safetensors").card
    assert card["config"]["options"]["channels"] == 5
    assert card["config"]["data"]["root"] == str(recordings)


def test_patience_without_anything_to_validate_on_is_told(cli, config):
    changes = ["train.epochs=1", "train.patience=2", "data.refit=true"]
    status, _, err = cli(config, *(word for c in changes for word in ("--set", c)))
    assert status == 0, err
    assert err.startswith("warning: train.patience has no effect with data.refit")


def test_it_starts_from_given_weights(cli, config, tmp_path):
    cli(config, "--json")
    given = tmp_path / "run" / "trajectorycnn.safetensors"
    changes = ["--set", f"initial_weights={given}", "--set", "train.learning_rate=1e-30"]
    status, _, err = cli(config, *changes, "--set", "train.ema_decay=0", "--out", tmp_path / "two")
    assert status == 0, err
    old, new = (load_weights(p).network.state_dict() for p in (
        given, tmp_path / "two" / "trajectorycnn.safetensors"
    ))  # fmt: skip
    for name, value in old.items():
        np.testing.assert_allclose(new[name], value, atol=1e-6)
    status, _, err = cli(config, *changes, "--set", "options.channels=8", "--out", tmp_path / "c")
    assert status == 2
    assert "have another network, shape or options" in err


def test_weights_of_a_skeleton_of_its_own_start_a_network(tmp_path):
    """The benchmark's skeleton is built anew from each file."""
    parts = {"left_arm": (0, 1), "right_arm": (2,)}
    own = make_skeleton("own", ["a", "b", "c"], [-1, 0, -1], parts=parts)
    shape = Shape(skeleton=own, history_steps=8, horizon_steps=5, rate_hz=25.0)
    options = {"channels": 4, "blocks": 1}
    given = tmp_path / "trajectorycnn.safetensors"
    network = TrajectoryCNN(shape, TrajectoryCNNOptions.model_validate(options))
    save_weights(given, "trajectorycnn", network, {})
    config = TrainingConfig.model_validate({
        "predictor": "trajectorycnn", "judgement": "benchmark", "out": tmp_path / "run",
        "shape": {"history_steps": 8, "horizon_steps": 5}, "options": options,
        "initial_weights": given,
    })  # fmt: skip
    source = SimpleNamespace(shape=shape, rest=lambda: torch.zeros(3, 3))
    started = build_network(config, cast(Any, source)).state_dict()
    for name, value in load_weights(given).network.state_dict().items():
        torch.testing.assert_close(started[name], value)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_saves_and_says_how_to_go_on(cli, config, monkeypatch, number):
    draw, calls = MotionSamples.batch, iter(range(100))

    def interrupted(self, rng, size):
        if size == 16 and next(calls) == 2:
            signal.raise_signal(number)
        return draw(self, rng, size)

    monkeypatch.setattr(MotionSamples, "batch", interrupted)
    before = signal.getsignal(number)
    status, _, err = cli(config)
    assert status == 130
    assert f"saved; continue with: hri-predict train {config} --resume" in err
    assert signal.getsignal(number) == before
    moved = shutil.copytree(config.parent, config.parent.parent / f"moved{number}")
    status, out, err = cli(config, "--resume", "--json", "--data", moved)  # the same recordings
    assert status == 0, err
    assert json.loads(out)["epochs"] == 3
    assert "epoch 1" not in err  # it had ended
    assert "epoch 2" in err


def test_ctrl_c_under_torchrun_names_the_command_that_starts_as_many(cli, config, monkeypatch):
    monkeypatch.setattr(Processes, "join", lambda: Processes(0, 2))
    monkeypatch.setattr(Processes, "__exit__", lambda *_: None)
    monkeypatch.setattr(
        "hri_predict.lab.training.runs.trained",
        lambda settings, **_: Result(
            ending="interrupted", epochs=0, steps=1, best_epoch=0, validation=None, minutes=1.0,
            weights=settings.out / "none",
        ),
    )  # fmt: skip
    status, _, err = cli(config)
    assert status == 130
    again = f"torchrun --nproc-per-node 2 -m hri_predict train {config} --resume"
    assert f"saved; continue with: {again}" in err.splitlines()


def test_it_works_without_tensorboard(cli, config, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    status, _, err = cli(config)
    assert status == 0
    assert "no TensorBoard log; to get one: " in err
    assert "[train]'" in err
    assert not (tmp_path / "run" / "log").exists()


def test_a_file_where_the_log_goes_is_told_before_anything_is_written(cli, config, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "log").touch()
    status, _, err = cli(config)
    assert status == 2
    assert err.splitlines() == [
        f"error: {tmp_path}/run/log: is a file, but the log needs a folder; remove it, or choose "
        f"another 'out'"
    ]
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["log"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--out", "/dev/null/run"], "cannot be written"),
        (["--out", "used"], "used: holds a run; --resume continues it"),
        (["--out", "new", "--resume"], "no such file; start the run without --resume"),
    ],
)
def test_a_folder_that_does_not_suit_is_told_before_the_data_are_read(
    cli, config, tmp_path, monkeypatch, words, says
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "last.pt").touch()
    monkeypatch.setattr("hri_predict.lab.training.runs.open_samples", lambda _: pytest.fail("read"))
    status, _, err = cli(config, *words)
    assert status == 2
    (line,) = err.splitlines()
    assert says in line


def test_every_folder_of_a_plan_is_tried_before_its_first_run(cli, config, tmp_path, monkeypatch):
    plan = tmp_path / "plan.yaml"
    plan.write_text("- {config: small.yaml}\n- {config: small.yaml, set: [out=/dev/null/run]}\n")
    monkeypatch.setattr(
        "hri_predict.lab.training.runs.trained", lambda *_, **__: pytest.fail("ran")
    )
    status, _, err = cli(plan)
    assert status == 2
    assert "checkpoint /dev/null/run/last.pt: cannot be written" in err


def test_a_plan_is_trained_in_order_and_goes_on(cli, config, tmp_path, monkeypatch):
    second = tmp_path / "second.yaml"
    second.write_text(config.read_text().replace(str(tmp_path / "run"), str(tmp_path / "two")))
    plan = tmp_path / "plan.yaml"
    plan.write_text("- {config: small.yaml}\n- {config: second.yaml, set: [train.epochs=2]}\n")
    draw, calls = MotionSamples.batch, iter(range(1000))

    def interrupted(self, rng, size):
        if size == 16 and next(calls) == 7:  # in the second run's first epoch
            signal.raise_signal(signal.SIGINT)
        return draw(self, rng, size)

    with monkeypatch.context() as patched:
        patched.setattr(MotionSamples, "batch", interrupted)
        status, _, err = cli(plan)
    assert status == 130
    assert err.splitlines()[-1] == f"saved; continue with: hri-predict train {plan}"
    status, out, _ = cli(plan, "--dry-run")
    one, two = out.splitlines()
    assert one == f"{tmp_path / 'run'}: 3 epochs: done"
    assert two == f"{tmp_path / 'two'}: 2 epochs: 50 %"
    status, out, err = cli(plan)
    assert status == 0, err
    assert out.count("epochs done") == 2
    assert err.startswith("epoch 2 ")  # of the second; the first had ended
    assert cli(plan, "--dry-run")[1].count(": done") == 2
    card = load_weights(tmp_path / "two" / "trajectorycnn.safetensors").card
    assert card["command"] == f"hri-predict train {plan}"
    status, _, err = cli(plan, "--out", "elsewhere")
    assert (status, err.count("\n")) == (2, 1)
    plan.write_text("- {confg: small.yaml}\n")
    assert "a plan is a list of" in cli(plan)[2]


@pytest.mark.parametrize("path", PAPERS, ids=lambda path: path.stem)
def test_a_paper_s_configuration_builds_its_network_and_schedule(path):
    config = load_training_config(path)
    assert (config.predictor, config.out) == (path.stem, Path("runs/papers") / path.stem)
    data = DATA_SETS[config.judgement].settings_model.model_validate(config.data)
    skeleton = CMU25 if data.space == "positions" else CMU38
    shape = Shape(skeleton=skeleton, framed=True, **dict(config.shape))
    rest = torch.zeros(len(skeleton.joints), 3)
    network = build_network(config, cast(Any, SimpleNamespace(shape=shape, rest=lambda: rest)))
    optimisation = Optimisation(network, config.train, Processes())
    assert type(optimisation._adam) is torch.optim.Adam
    steps = config.train.total_steps
    late = learning_rate_factor(steps - 1, config.train, 1 - 1 / steps)
    assert late == pytest.approx(0.96**24 if path.stem == "stb" else 1.0)


def test_the_shipped_plan_names_runs_that_can_be_made(cli):
    status, out, err = cli("configs/training/all.yaml", "--dry-run")
    assert status == 0, err
    folders = [line.split(":")[0] for line in out.splitlines()]
    assert folders[0] == "runs/sinn_real"
    shipped = {p.stem for p in data_path("training").glob("*_*.yaml")}
    assert {Path(f).name for f in folders} == shipped
    assert len(folders) == len(set(folders))


def test_help_has_an_example(cli):
    status, out, _ = cli("--help")
    assert status == 0
    assert "Example: hri-predict train configs/training/trajectorycnn_real.yaml" in " ".join(
        out.split()
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere.yaml"], "training configuration nowhere.yaml: cannot be read"),
        (["--set", "train.epoch=1"], "train.epoch: unknown key; did you mean 'epochs'?"),
        (["--set", "train.epochs"], "write it as key=value"),
        (["--set", "train.epochs=[1"], "its value is not valid YAML"),
        (["--set", "out.x=1"], "'out' has no keys"),
        (["--set", "train.epochs=0"], "train.epochs: input should be greater than or equal to 1"),
        (
            ["--set", "judgement=dance"],
            "unknown data set 'dance'; available: benchmark, human36m, real",
        ),
        (["--set", "train.schedule=cosin"], "unknown schedule 'cosin'; did you mean 'cosine'?"),
        (["--set", "train.optimiser=sgd"], "unknown optimiser 'sgd'; available: adam, adamw"),
        (["--set", "predictor=kalman"], "predictor 'kalman' has no network: nothing to train"),
        (["--set", "predictor=kdforma"], "unknown predictor 'kdforma'; did you mean 'kdformer'?"),
        (["--set", "options.chanels=1"], "options: chanels: unknown key; did you mean 'channels'?"),
        (["--set", "data.fitt=1"], "data: fitt: unknown key; did you mean 'fit'?"),
        (["--set", "initial_weights=gone"], "weights gone: the file does not exist"),
        (["--set", "out=/dev/null/run"], "cannot be written"),
        (["--set", "out=/dev/full"], "/dev/full is not a folder; choose another 'out'"),
        (["--set", f"out={'a' * 300}"], "cannot be written: File name too long"),
        (["--out", ""], "out: must name a folder for this run alone"),
        (["--out", "."], "out: must name a folder for this run alone"),
        (["--set", r'out="a\0b"'], "contains a control character); quote it"),
        (["--set", f"train.seed={2**70}"], "train.seed: input should be less than or equal to"),
        (["--set", f"train.batch={10**21}"], "train.batch: input should be less than or equal to"),
        (["--set", f"train.epochs={10**400}"], "train.epochs: input should be less than or"),
        (["--set", "train.batch=33"], "train: batch 33 is more than windows_per_epoch 32"),
        (
            ["--set", 'data.fit=["**x"]'],
            "nothing matches '**x'"  # a pattern since Python 3.13
            if sys.version_info >= (3, 13)
            else "'**x' is neither a file nor a pattern",
        ),
        (["--resume"], "no such file; start the run without --resume"),
        (["--set", "train.device=cuda"], "train.device cuda: this machine has none; use cpu"),
        (["--set", "train.epochs=99", "--data", "/nowhere"], "nothing matches 'walk_*.npz'"),
    ],
)
def test_a_mistake_is_one_line(cli, config, monkeypatch, arguments, says):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    first = [] if arguments[0].endswith(".yaml") else [config]
    status, out, err = cli(*first, *arguments)
    assert status == 2
    assert out == ""
    assert len(err.splitlines()) == 1, err
    assert says in err


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("judgement", ["real", "benchmark"])
def test_the_shipped_configurations_say_what_they_are(method, judgement):
    path = data_path("training", f"{method}_{judgement}.yaml")
    config = load_training_config(path)
    assert isinstance(config, TrainingConfig)
    assert (config.predictor, config.judgement) == (method, judgement)
    assert config.out == Path("runs") / path.stem
    network = network_class_of(method)
    assert network is not None
    network.options_model.model_validate(config.options)
    DATA_SETS[judgement].settings_model.model_validate(config.data)
