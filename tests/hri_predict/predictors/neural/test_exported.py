"""A trained predictor without torch gives torch's forecasts, or torch computes."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.predictors.building import predictor_of
from hri_predict.predictors.neural import exported, exporting
from hri_predict.predictors.neural.exported import ExportedPredictor, NoCopyError, Stored

pytest.importorskip("onnxruntime", reason="ONNX Runtime is not installed")


def settings_of(name="sinn", **settings):
    return registry.predictor_settings(name)(name=name, **settings)


@pytest.fixture(scope="module")
def by_torch():
    """The shipped predictor as it is built where torch is there."""
    return registry.load("predictors", "sinn")(settings_of())


@pytest.fixture(scope="module")
def stored(by_torch):
    return exporting._stored(by_torch, ["far beyond"])


@pytest.fixture
def made(monkeypatch, tmp_path, stored):
    """The cache's folder is new; the list has one entry for each time that a copy was made."""
    monkeypatch.setenv("HRI_PREDICT_CACHE", str(tmp_path))
    return counted(monkeypatch, stored.packed())


def counted(monkeypatch, content):
    """Let ``content`` be what is made; the list has an entry for each time."""
    calls = []

    def make(settings):
        calls.append(settings)
        return content

    monkeypatch.setattr(exported, "_by_another_process", make)
    return calls


def window(predictor, people=3):
    rng = np.random.default_rng(1)
    shape = (people, predictor.history_steps, len(predictor.skeleton.joints))
    return rng.normal(0, 0.5, (*shape, 3)).cumsum(1) * 0.1, rng.random(shape) > 0.1


@pytest.mark.long
def test_its_forecasts_are_those_of_the_predictor(by_torch, made):
    copy = predictor_of(settings_of())
    assert isinstance(copy, ExportedPredictor)
    assert by_torch.engine.name == "onnxruntime"
    for name in ("history_steps", "horizon_steps", "rate_hz", "skeleton"):
        assert getattr(copy, name) == getattr(by_torch, name)
    for people in (0, 1, 3):
        history, observed = window(by_torch, people)
        forecast = copy.predict(history, observed)
        wanted = by_torch.predict(history, observed)
        np.testing.assert_array_equal(forecast.positions, wanted.positions)


def test_it_is_made_once_and_warns_each_time(made, caplog):
    for _ in range(2):
        exported.exported(settings_of())
    assert len(made) == 1
    assert caplog.messages.count("far beyond") == 2


def test_a_copy_fails_as_any_predictor_does(made, monkeypatch):
    def broken(settings):
        raise ZeroDivisionError("in a kernel")

    monkeypatch.setattr(exported, "exported", broken)
    with pytest.raises(ConfigError, match="predictor 'sinn' cannot be built: ZeroDivisionError"):
        predictor_of(settings_of())


def test_probes_of_another_shape_do_not_end_the_start(monkeypatch, made, stored):
    short = [(p, o, w[:, :-1]) for p, o, w in stored.probes]
    counted(monkeypatch, replace(stored, probes=short).packed())
    with pytest.raises(NoCopyError, match="cannot run it"):
        exported.exported(settings_of())


def test_without_numba_torch_has_the_threads_of_the_settings(made, monkeypatch):
    before = torch.get_num_threads()
    monkeypatch.setattr(exported, "is_compiled", lambda: False)
    try:
        torch.set_num_threads(3)
        exported.exported(settings_of(threads=2))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.long
def test_other_settings_or_weights_have_their_own_copy(made, tmp_path):
    exported.exported(settings_of())
    exported.exported(settings_of(horizon_s=0.4))
    exported.exported(settings_of(threads=2))
    assert len(made) == 2
    other = tmp_path / "other.safetensors"
    other.write_bytes(settings_of().files()[0].read_bytes() + b" ")
    exported.exported(settings_of(weights=str(other)))
    assert len(made) == 3


@pytest.mark.long
def test_a_copy_that_disagrees_with_torch_does_not_compute(monkeypatch, made, stored, by_torch):
    moved = [(p, o, w + np.float32(0.01)) for p, o, w in stored.probes]
    calls = counted(monkeypatch, replace(stored, probes=moved).packed())
    with pytest.raises(NoCopyError, match=r"differs from torch by 0\.01"):
        exported.exported(settings_of())
    assert len(calls) == 2
    monkeypatch.setattr(registry, "load", lambda kind, name: lambda settings: by_torch)
    assert predictor_of(settings_of()) is by_torch


def test_damaged_copies_are_made_again(made, stored, tmp_path):
    exported.exported(settings_of())
    (kept,) = tmp_path.glob("sinn-*.forecasts")
    kept.write_bytes(kept.read_bytes()[:1000])
    exported.exported(settings_of())
    assert len(made) == 2
    for content in (b"", b"PK", stored.packed()[:-500], stored.packed()[500:]):
        with pytest.raises(NoCopyError):
            Stored.unpacked(content)


def test_the_copy_of_another_predictor_is_not_its_own(made, tmp_path):
    """It agrees with itself: only its name says what it is a copy of."""
    exported.exported(settings_of())
    (kept,) = tmp_path.glob("sinn-*.forecasts")
    kept.rename(tmp_path / exported._key(settings_of(horizon_s=0.4)))
    exported.exported(settings_of(horizon_s=0.4))
    assert len(made) == 2


def test_weights_that_change_during_the_export_have_no_copy(made, monkeypatch, stored, tmp_path):
    weights = tmp_path / "own.safetensors"
    weights.write_bytes(settings_of().files()[0].read_bytes())

    def make(settings):
        weights.write_bytes(weights.read_bytes() + b" ")
        return stored.packed()

    monkeypatch.setattr(exported, "_by_another_process", make)
    with pytest.raises(NoCopyError, match="changed while it was exported"):
        exported.exported(settings_of(weights=str(weights)))
    assert not list(tmp_path.glob("*.forecasts"))


@pytest.mark.parametrize(
    "settings",
    [
        settings_of(engine="torch"),
        settings_of("aggregated"),
        settings_of("constant_velocity"),
        settings_of(weights="/nowhere.safetensors"),
    ],
)
def test_without_a_copy_torch_computes_or_says_why(made, settings):
    with pytest.raises(NoCopyError):
        exported.exported(settings)
    assert not made


def test_a_failing_export_leaves_it_to_torch(monkeypatch, tmp_path):
    monkeypatch.setenv("HRI_PREDICT_CACHE", str(tmp_path))
    monkeypatch.setattr(exported, "_BEGIN", "import sys; sys.exit(3)")
    with pytest.raises(NoCopyError, match="status 3"):
        exported.exported(settings_of())
    assert not list(tmp_path.iterdir())


WITHOUT_TORCH = """
import json, sys
from pathlib import Path
from hri_predict.run import assemble, config
runner = assemble.build_prediction(config.load(Path(sys.argv[1])).with_predictor("sinn"))
try:
    runner.wait_until_ready()
    maps = Path(f"/proc/{runner._worker.process.pid}/maps").read_text()
finally:
    runner.stop()
print(json.dumps(["torch" in sys.modules, "libtorch" in maps, "onnxruntime" in maps]))
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="asks the kernel what a process has mapped")
def test_neither_process_of_a_node_has_torch(monkeypatch, tmp_path):
    monkeypatch.setenv("HRI_PREDICT_CACHE", str(tmp_path))
    from hri_predict.run import config

    command = [sys.executable, "-c", WITHOUT_TORCH, str(config.shipped("demo.yaml"))]
    for _ in range(2):  # also with an empty cache: the process that exports has ended
        done = subprocess.run(command, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout.splitlines()[-1]) == [False, False, True]
    assert len(list(tmp_path.glob("sinn-*.forecasts"))) == 1
