"""The loop on a small network and windows whose future is their past's continuation."""

import dataclasses
import json
import os
import subprocess
import sys

import pytest
import torch
from safetensors.torch import load_file

from hri_predict.base.errors import ConfigError, PredictorError
from hri_predict.lab.training import loop
from hri_predict.predictors.neural.weights import read_header
from tests.hri_predict.lab.training import small_run
from tests.hri_predict.lab.training.small_run import (
    SHAPE,
    Options,
    Small,
    Walkers,
    Watcher,
    checkpoint,
    make_config,
    run,
    same,
)


def test_it_learns_and_reports_validation_of_the_exported_weights(tmp_path):
    _, result, view = run(tmp_path, epochs=20, ema_decay=0.9)
    first, last = view.epochs[0].validation, view.epochs[-1].validation
    assert last.mm < 0.5 * first.mm
    assert result.ending == "epochs done"
    assert result.epochs == 20
    assert result.steps == 80
    best = min(view.epochs, key=lambda e: e.validation.mm)
    assert result.best_epoch == best.number
    assert result.validation == best.validation.as_dict()
    assert result.weights.exists()


def test_it_exports_the_averaged_weights_without_the_adversary(tmp_path):
    _, result, view = run(tmp_path, {"critic": True}, ema_decay=0.9)
    assert view.epochs[-1].best
    state = checkpoint(tmp_path)["optimisation"]
    assert not same(state["averaged"], state["network"])
    file = load_file(result.weights)
    assert file.keys() == {k for k in state["averaged"] if not k.startswith("critic")}
    for name, tensor in file.items():
        torch.testing.assert_close(tensor.float(), state["averaged"][name], rtol=1e-3, atol=1e-4)
    card = read_header(result.weights).card
    assert card["config"]["train"]["ema_decay"] == 0.9
    assert card["validation"] == result.validation
    assert card["epoch"] == 4
    assert card["steps"] == 16
    assert len(card["data_fingerprint"]) == 64


def test_the_adversary_moves_only_when_it_is_at_work(tmp_path):
    # at work in the second half; its loss must not move the model, nor the model's loss it
    run(tmp_path / "half", {"critic": True}, stop_after=2)
    run(tmp_path / "whole", {"critic": True})
    run(tmp_path / "none", {"critic": False}, ema_decay=0)
    torch.manual_seed(0)
    fresh = Small(SHAPE, Options(critic=True)).state_dict()
    half, whole = (checkpoint(tmp_path / n)["optimisation"]["network"] for n in ("half", "whole"))
    assert torch.equal(half["critic.weight"], fresh["critic.weight"])
    assert not torch.equal(whole["critic.weight"], fresh["critic.weight"])
    alone = checkpoint(tmp_path / "none")["optimisation"]["network"]
    layers = [name for name in alone if name.startswith("layers")]
    # `seen` counts the critic's forward passes, too; the model itself goes the same way
    assert all(torch.equal(alone[n], whole[n]) for n in layers)


RESUMED = {"dropout": 0.3, "critic": True}


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    out = tmp_path_factory.mktemp("straight")
    return checkpoint(out) if run(out, RESUMED) else None


def assert_same_run(out, straight):
    resumed = checkpoint(out)
    for part in ("network", "averaged"):
        assert same(resumed["optimisation"][part], straight["optimisation"][part])
    for adam in ("adam", "critic_adam"):
        ours, theirs = (c["optimisation"][adam]["state"] for c in (resumed, straight))
        assert ours.keys() == theirs.keys()
        assert all(same(ours[k], theirs[k]) for k in ours)
    assert resumed["numpy"] == straight["numpy"]
    assert torch.equal(resumed["torch"][0], straight["torch"][0])
    one, two = (json.loads(c["progress"]) for c in (resumed, straight))
    own = {"seconds": 0, "weights": None}  # the file of weights names its folder and minutes
    assert one | own == two | own


def test_two_epochs_and_two_resumed_are_four_to_the_bit(tmp_path, straight):
    run(tmp_path, RESUMED, stop_after=2)
    _, result, view = run(tmp_path, RESUMED, resume=True)
    assert view.start == (8, 16)
    assert result.epochs == 4
    assert_same_run(tmp_path, straight)


def test_an_interrupted_epoch_goes_on_to_the_bit(tmp_path, straight):
    calls = iter(range(100))
    _, result, view = run(tmp_path, RESUMED, stop=lambda: next(calls) == 5)
    assert result.ending == "interrupted"
    assert len(view.losses) == 6
    run(tmp_path, RESUMED, resume=True)
    assert_same_run(tmp_path, straight)


def test_a_crash_within_an_epoch_costs_only_what_came_after_the_checkpoint(tmp_path, straight):
    class Crash(Exception):
        pass

    calls = iter(range(100))

    def crash():
        if next(calls) == 6:
            raise Crash
        return False

    with pytest.raises(Crash):
        run(tmp_path, RESUMED, stop=crash, checkpoint_minutes=1e-9)
    _, _, view = run(tmp_path, RESUMED, resume=True)
    assert view.start == (6, 16)
    assert_same_run(tmp_path, straight)


def test_a_run_that_fails_in_its_first_step_leaves_the_folder_free(tmp_path):
    with pytest.raises(PredictorError, match="training step 0"):
        run(tmp_path, {"blow_up_at": 0.0})
    _, result, _ = run(tmp_path)
    assert result.ending == "epochs done"


def test_a_crash_after_the_first_step_is_resumed_from_there(tmp_path, straight):
    def crash():
        if (tmp_path / "last.pt").exists():
            raise RuntimeError
        return False

    with pytest.raises(RuntimeError):
        run(tmp_path, RESUMED, stop=crash)
    _, _, view = run(tmp_path, RESUMED, resume=True)
    assert view.start == (1, 16)
    assert_same_run(tmp_path, straight)


def test_a_finished_run_resumed_does_nothing_more(tmp_path):
    _, first, _ = run(tmp_path)
    _, again, view = run(tmp_path, resume=True)
    assert view.losses == []
    assert again == first


def test_a_run_is_not_overwritten(tmp_path):
    run(tmp_path, stop_after=1)
    with pytest.raises(ConfigError, match=r"holds a run; --resume .* or delete the folder"):
        run(tmp_path)


def test_another_run_is_not_resumed(tmp_path):
    run(tmp_path, stop_after=1)
    with pytest.raises(ConfigError, match=r"train.learning_rate 0.02, not 0.5"):
        run(tmp_path, resume=True, learning_rate=0.5)
    with pytest.raises(ConfigError, match=r"options.width None, not 9"):
        run(tmp_path, {"width": 9}, resume=True)

    class Others(Walkers):
        def rest(self):
            return torch.zeros(28, 3)

    with pytest.raises(ConfigError, match="other data"):
        run(tmp_path, resume=True, source=Others())

    class OtherChecks(Walkers):
        """The last of the validation windows are others."""

        def validation(self):
            first, last = super().validation()
            yield from (first, dataclasses.replace(last, future=last.future + 0.1))

    with pytest.raises(ConfigError, match="other data"):
        run(tmp_path, resume=True, source=OtherChecks())
    with pytest.raises(ConfigError, match="without --resume"):
        run(tmp_path / "nowhere", resume=True)


def test_a_loss_that_is_not_finite_names_its_step(tmp_path):
    with pytest.raises(
        PredictorError, match=r"^training step 9: the loss 'position' is not finite"
    ) as error:
        run(tmp_path, {"blow_up_at": 9 / 16})
    assert "\n" not in str(error.value)


def test_it_stops_when_validation_gets_no_better(tmp_path):
    _, result, view = run(tmp_path, learning_rate=1e-30, ema_decay=0, patience=2)
    assert result.ending == "no better validation"
    assert len(view.epochs) == 3
    assert result.best_epoch == 1


def test_out_of_time_it_still_judges_and_exports(tmp_path):
    _, result, view = run(tmp_path, max_minutes=1e-9)
    assert result.ending == "out of time"
    assert result.steps == 1
    assert len(view.epochs) == 1
    assert result.weights.exists()
    _, longer, _ = run(tmp_path, resume=True)
    assert longer.ending == "epochs done"


def test_a_run_out_of_time_takes_no_step_more_until_it_gets_more_time(tmp_path):
    _, first, _ = run(tmp_path, max_minutes=1e-9)
    before = first.weights.read_bytes()
    _, again, view = run(tmp_path, resume=True, max_minutes=1e-9)
    assert (again.ending, again.steps, view.losses) == ("out of time", 1, [])
    assert first.weights.read_bytes() == before
    _, longer, _ = run(tmp_path, resume=True, max_minutes=9.0)
    assert (longer.ending, longer.steps) == ("epochs done", 16)


def test_without_validation_windows_the_newest_weights_are_kept(tmp_path):
    _, result, view = run(tmp_path, source=Walkers(validates=False), patience=1)
    assert [e.best for e in view.epochs] == [True] * 4
    assert result.validation is None
    file = load_file(result.weights)
    newest = checkpoint(tmp_path)["optimisation"]["averaged"]["layers.0.weight"]
    torch.testing.assert_close(file["layers.0.weight"].float(), newest, rtol=1e-3, atol=1e-4)


SCRIPT = """
import importlib.util, os, sys
from pathlib import Path

import torch

spec = importlib.util.spec_from_file_location("case", sys.argv[1])
case = importlib.util.module_from_spec(spec)
spec.loader.exec_module(case)
from hri_predict.lab.training import loop
from hri_predict.lab.training.processes import Processes

with Processes.join() as processes:
    assert processes.count == 2
    view = case.Watcher()
    config = case.make_config(Path(sys.argv[2]))
    torch.manual_seed(processes.rank)  # the first process's weights are everybody's
    network = case.Small(case.SHAPE, case.Options())
    network.rest.copy_(case.Walkers().rest())
    loop.Run(config, case.Walkers(), network, view, processes=processes).go()
    if processes.rank == 0:
        torch.save(view.losses, Path(sys.argv[2]) / "losses.pt")
    else:
        assert view.losses == []
# A thread of the group that is left now and then aborts the process as it ends.
threads = {Path("/proc/self/task", n, "comm").read_text() for n in os.listdir("/proc/self/task")}
assert not any("gloo" in name for name in threads), threads
"""


@pytest.mark.long
def test_two_processes_go_one_process_s_way(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run(
        [
            sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2",
            "--master-addr", "127.0.0.1", "--master-port", "0", "--rdzv-backend", "c10d",
            "--rdzv-endpoint", "127.0.0.1:0", str(script), small_run.__file__,
            str(tmp_path / "two"),
        ],
        env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, timeout=120,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    _, _, view = run(tmp_path / "one")
    losses = torch.load(tmp_path / "two" / "losses.pt", weights_only=True)
    assert losses == pytest.approx(view.losses, rel=0, abs=1e-6)
    one, two = (checkpoint(tmp_path / n) for n in ("one", "two"))
    for name, value in one["optimisation"]["averaged"].items():
        torch.testing.assert_close(two["optimisation"]["averaged"][name], value, rtol=0, atol=1e-6)
    first, second = (json.loads(c["progress"])["best_mm"] for c in (one, two))
    assert second == pytest.approx(first, abs=1e-2)


def test_the_schedule_ends_with_the_time(tmp_path, monkeypatch):
    seconds = iter(range(1000))  # a step takes a second or more
    monkeypatch.setattr(loop.time, "monotonic", lambda: float(next(seconds)))
    took = {}
    for name, limit in (("free", None), ("short", 0.2)):
        epochs = run(tmp_path / name, max_minutes=limit, epochs=8, checkpoint_minutes=9)[2].epochs
        took[name] = [epoch.learning_rate for epoch in epochs]
    assert took["short"][-1] < 0.1 * took["short"][0]
    assert took["short"][0] == took["free"][0]  # the first epoch cannot know


def test_weights_tell_how_they_were_made(tmp_path):
    network = Small(SHAPE, Options())
    asked = loop.Run(make_config(tmp_path), Walkers(), network, Watcher(), command="train x")
    card = read_header(asked.go().weights).card
    assert (card["command"], card["config"]["train"]["seed"]) == ("train x", 0)


def test_every_loss_has_its_name_in_the_epochs(tmp_path):
    first, *_, last = run(tmp_path, {"critic": True})[2].epochs
    assert first.losses.keys() == {"position", "loss"}
    assert last.losses.keys() == {"position", "critic", "loss"}
    assert last.losses["loss"] == pytest.approx(last.losses["position"])
