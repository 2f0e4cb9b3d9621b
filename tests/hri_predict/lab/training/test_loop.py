"""The loop on a small network and windows whose future is their past's continuation."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from hri_predict.base.errors import ConfigError, PredictorError
from hri_predict.lab.training import loop
from hri_predict.lab.training.checkpoint import load_checkpoint, save_checkpoint
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.windows.samples import Samples
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import (
    Network,
    NetworkOptions,
    Shape,
    last_pose,
    mpjpe,
)
from hri_predict.predictors.neural.weights import read_header

SHAPE = Shape(skeleton=BODY, history_steps=4, horizon_steps=3, rate_hz=25.0)


class Options(NetworkOptions):
    width: int = 8
    dropout: float = 0.0
    critic: bool = False
    blow_up_at: float = 2.0


class Small(Network):
    """One hidden layer over time, the same for every joint and axis."""

    options_model = Options
    options: Options
    seen: torch.Tensor

    def __init__(self, shape, options):
        super().__init__(shape)
        self.options = options
        self.layers = nn.Sequential(
            nn.Linear(shape.history_steps, options.width),
            nn.Tanh(),
            nn.Dropout(options.dropout),
            nn.Linear(options.width, shape.horizon_steps),
        )
        self.critic = nn.Linear(shape.horizon_steps, 1) if options.critic else None
        self.register_buffer("seen", torch.zeros(()))

    def forward(self, window):
        if self.training:
            self.seen += 1
        residual = self.layers((window.positions - last_pose(window)).movedim(1, -1))
        return last_pose(window) + residual.movedim(-1, 1)

    def losses(self, window, target, progress):
        scale = float("nan") if progress >= self.options.blow_up_at else 1.0
        return {"position": scale * mpjpe(self(window), target)}

    def critic_loss(self, window, target, progress):
        if self.critic is None or progress < 0.5:
            return None
        fake = self.critic(self(window).detach().movedim(1, -1))
        return fake.mean() - self.critic(target.positions.movedim(1, -1)).mean()

    def critic_parameters(self):
        return iter(()) if self.critic is None else self.critic.parameters()


class Walkers:
    """People who drift at a constant velocity of their own."""

    shape = SHAPE
    actions: tuple[str, ...] = ("walking", "standing")

    def __init__(self, validates=True):
        self._validates = validates

    def rest(self):
        return torch.linspace(0, 1, 84).view(28, 3)

    def batch(self, rng, size):
        steps = np.arange(SHAPE.history_steps + SHAPE.horizon_steps)[:, None, None]
        actions = rng.integers(0, 2, size)
        start = rng.normal(size=(size, 1, 28, 3))
        velocity = rng.normal(size=(size, 1, 1, 3)) * 0.05 * (actions == 0)[:, None, None, None]
        positions = torch.from_numpy(start + velocity * steps).float()
        seen = torch.from_numpy(rng.random((size, 7, 28)) < 0.9)
        past = SHAPE.history_steps
        return Samples(
            history=positions[:, :past],
            observed=seen[:, :past],
            future=positions[:, past:],
            known=seen[:, past:],
            actions=torch.from_numpy(actions),
        )

    def validation(self):
        rng = np.random.default_rng(99)
        yield from (self.batch(rng, 32) for _ in range(2 if self._validates else 0))


class Watcher:
    def __init__(self):
        self.start = None
        self.losses = []
        self.epochs = []

    def started(self, step, total_steps):
        self.start = (step, total_steps)

    def stepped(self, step, loss):
        self.losses.append(loss)

    def ended_epoch(self, epoch):
        self.epochs.append(epoch)


def make_config(out, options=None, **train):
    settings = {"epochs": 4, "windows_per_epoch": 64, "batch": 16, "learning_rate": 0.02,
                "warmup": 0.05}  # fmt: skip
    return TrainingConfig.model_validate(
        {
            "predictor": "small", "judgement": "real", "out": out, "options": options or {},
            "shape": {"history_steps": 4, "horizon_steps": 3}, "train": settings | train,
        }
    )  # fmt: skip


def run(out, options=None, resume=False, source=None, stop=None, **train):
    config = make_config(out, options, **train)
    source, view = source or Walkers(), Watcher()
    torch.manual_seed(config.train.seed)
    network = Small(SHAPE, Options(**config.options))
    network.rest.copy_(source.rest())
    more = {} if stop is None else {"stop": stop}
    result = loop.Run(config, source, network, view, **more).go(resume)
    return network, result, view


def same(a, b):
    return all(torch.equal(x, y) for x, y in zip(a.values(), b.values(), strict=True))


def checkpoint(out):
    return load_checkpoint(out / "last.pt")


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


def test_a_finished_run_resumed_does_nothing_more(tmp_path):
    _, first, _ = run(tmp_path)
    _, again, view = run(tmp_path, resume=True)
    assert view.losses == []
    assert again == first


def test_a_run_is_not_overwritten(tmp_path):
    run(tmp_path, stop_after=1)
    with pytest.raises(ConfigError, match="holds a run; --resume"):
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
            "--rdzv-endpoint", "127.0.0.1:0", str(script), __file__, str(tmp_path / "two"),
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


def changed(**values):
    """Return a change of the progress in a checkpoint."""

    def change(state):
        state["progress"] = json.dumps(json.loads(state["progress"]) | values)

    return change


def numpy_state(value):
    def change(state):
        told = json.loads(state["numpy"])
        told["state"]["state"] = value
        state["numpy"] = json.dumps(told)

    return change


def moments(edit):
    return lambda state: [edit(each) for each in state["optimisation"]["adam"]["state"].values()]


DAMAGE = {
    "step -5": (changed(step=-5), "progress.step: "),
    "step 1.5": (changed(step=1.5), "progress.step: "),
    "step true": (changed(step=True), "progress.step: "),
    "step text": (changed(step="4"), "progress.step: "),
    "step beyond the end": (changed(step=10**12), "beyond the last step, 16"),
    "losses null": (changed(losses=None), "progress.losses: "),
    "losses a list": (changed(losses=[1.0]), "progress.losses: "),
    "losses of text": (changed(losses={"loss": "a"}), "progress.losses.loss: "),
    "losses NaN": (changed(losses={"loss": float("nan")}), "progress.losses.loss: "),
    "seconds": (changed(seconds="a"), "progress.seconds: "),
    "seconds infinite": (changed(seconds=float("inf")), "progress.seconds: "),
    "best null": (changed(best_mm=None), "progress.best_mm: "),
    "best text": (changed(best_mm="a"), "progress.best_mm: "),
    "best NaN": (changed(best_mm=float("nan")), "progress.best_mm: "),
    "best epoch": (changed(best_epoch=7), "its best epoch is beyond the 2"),
    "unknown key": (changed(mood=1), "progress.mood: "),
    "progress a list": (lambda s: s.update(progress="[]"), "progress: "),
    "progress no JSON": (lambda s: s.update(progress="{"), "holds no progress"),
    "progress gone": (lambda s: s.pop("progress"), "holds no progress"),
    "numpy large": (numpy_state(10**60), "or is damaged"),
    "numpy negative": (numpy_state(-1), "or is damaged"),
    "numpy text": (lambda s: s.update(numpy="null"), "or is damaged"),
    "adam None": (lambda s: s["optimisation"].update(adam=None), "or is damaged"),
    "adam text": (lambda s: s["optimisation"].update(adam="a"), "or is damaged"),
    "adam a number": (lambda s: s["optimisation"].update(adam=3), "or is damaged"),
    "adam's rate": (
        lambda s: s["optimisation"]["adam"]["param_groups"][0].update(full_lr="fast"),
        "or is damaged",
    ),
    "adam's shapes": (moments(lambda m: m.update(exp_avg=torch.ones(7, 7, 7))), "or is damaged"),
    "adam's numbers": (
        moments(lambda m: m["exp_avg"].fill_(float("nan"))),
        "or is damaged",
    ),
    "weights": (
        lambda s: s["optimisation"]["network"]["layers.0.bias"].fill_(float("nan")),
        "or is damaged",
    ),
    "torch": (lambda s: s.update(torch=[3]), "or is damaged"),
    "config": (lambda s: s.update(config="[]"), "or is damaged"),
}


@pytest.mark.parametrize(("change", "said"), DAMAGE.values(), ids=DAMAGE)
def test_a_readable_checkpoint_with_wrong_content_is_refused_in_one_line(tmp_path, change, said):
    run(tmp_path, stop_after=2)
    state = checkpoint(tmp_path)
    change(state)
    save_checkpoint(tmp_path / "last.pt", state)
    with pytest.raises(ConfigError) as error:
        run(tmp_path, resume=True)
    line = str(error.value)
    assert line.startswith(f"checkpoint {tmp_path / 'last.pt'}: ")
    assert said in line
    assert line.endswith("with another --out")
    assert "\n" not in line


@pytest.mark.parametrize("stop_after", [2, 4])
def test_best_weights_that_are_gone_or_damaged_are_named_with_a_remedy(tmp_path, stop_after):
    path = run(tmp_path, stop_after=stop_after)[1].weights
    whole = path.read_bytes()
    remedy = "put the file back, or start the run again with another --out$"
    for data, said in (
        (None, "are missing"),
        (whole[:-1] + bytes([whole[-1] ^ 1]), "are damaged or were replaced"),
        (whole[:20], "cannot be read"),
    ):
        path.unlink(missing_ok=True)
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(ConfigError, match=rf"^weights .*, {said}; {remedy}"):
            run(tmp_path, resume=True)
    path.write_bytes(whole)
    assert run(tmp_path, resume=True)[1].ending == "epochs done"


def test_weights_newer_than_the_checkpoint_are_those_of_a_crash_between_the_two(tmp_path):
    run(tmp_path, stop_after=1)
    before = (tmp_path / "last.pt").read_bytes()
    result = run(tmp_path, stop_after=2, resume=True)[1]
    assert result.best_epoch == 2
    (tmp_path / "last.pt").write_bytes(before)
    assert run(tmp_path, resume=True)[1].ending == "epochs done"
