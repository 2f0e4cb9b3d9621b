"""Runs that cannot be resumed say why in one line: damaged checkpoints, weights that are gone."""

import json

import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.lab.training import loop
from hri_predict.lab.training.checkpoint import save_checkpoint
from hri_predict.lab.training.processes import Processes
from tests.hri_predict.lab.training.small_run import (
    SHAPE,
    Options,
    Small,
    Walkers,
    Watcher,
    checkpoint,
    make_config,
    run,
)


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
    "torch gone": (lambda s: s.update(torch=[]), "or is damaged"),
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


def test_a_run_of_two_processes_is_not_resumed_by_one(tmp_path):
    run(tmp_path, stop_after=2)
    state = checkpoint(tmp_path)
    state["torch"] = state["torch"] * 2
    save_checkpoint(tmp_path / "last.pt", state)
    with pytest.raises(ConfigError) as error:
        run(tmp_path, resume=True)
    assert str(error.value) == (
        f"checkpoint {tmp_path}/last.pt: its run had 2 processes, not 1; start it with torchrun "
        f"--nproc-per-node 2 -m hri_predict, or start another run with --out"
    )


def test_a_run_of_one_process_is_not_resumed_by_two(tmp_path, monkeypatch):
    run(tmp_path, stop_after=2)
    monkeypatch.setattr(Processes, "same", lambda *_: None)  # the other process does not exist
    network, config = Small(SHAPE, Options()), make_config(tmp_path)
    two = loop.Run(config, Walkers(), network, Watcher(), processes=Processes(0, 2))
    with pytest.raises(ConfigError, match="had 1 process, not 2; start it without torchrun, or"):
        two.go(resume=True)


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


class Parts:
    """What a user's package provides; ``code`` is the hash of each part, by name."""

    def __init__(self, monkeypatch, **code):
        self.code = code
        monkeypatch.setattr(registry, "code_of_part", lambda kind, name: self.code.get(name))


def test_a_run_goes_on_with_the_same_code_of_a_user_s_network(tmp_path, monkeypatch):
    Parts(monkeypatch, small="1a")
    run(tmp_path, stop_after=1)
    _, result, _ = run(tmp_path, resume=True)
    assert result.epochs == 4


@pytest.mark.parametrize(
    ("code", "part"),
    [
        ({"small": "2b"}, "predictor 'small'"),
        ({}, "predictor 'small'"),
        ({"small": "1a", "real": "3c"}, "data set 'real'"),
        ({"small": "1a", "adamw": "3c"}, "optimiser 'adamw'"),
        ({"small": "1a", "cosine": "3c"}, "schedule 'cosine'"),
    ],
)
def test_a_run_of_other_code_is_refused_as_one_of_other_settings_is(
    tmp_path, monkeypatch, code, part
):
    parts = Parts(monkeypatch, small="1a")
    run(tmp_path, stop_after=1)
    parts.code = code
    with pytest.raises(ConfigError) as caught:
        run(tmp_path, resume=True)
    assert str(caught.value) == (
        f"checkpoint {tmp_path}/last.pt: was trained with other code of {part}; restore that, or "
        "start another run with --out"
    )


def test_a_checkpoint_that_kept_no_code_goes_on(tmp_path, monkeypatch):
    run(tmp_path, stop_after=1)
    state = checkpoint(tmp_path)
    del state["code"]
    save_checkpoint(tmp_path / "last.pt", state)
    Parts(monkeypatch, small="1a")
    run(tmp_path, resume=True)
