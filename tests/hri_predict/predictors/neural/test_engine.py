"""Engines: a copy of the network computes only where it agrees with torch, which is the oracle."""

import logging
import os
import subprocess
import sys
from functools import cache, partial
from typing import ClassVar

import numpy as np
import pytest
import torch
from torch import nn

from hri_predict.base.errors import ConfigError, PredictorError
from hri_predict.base.machine.cache import cached, forget
from hri_predict.contracts import registry
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.engine import engine_for
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    last_pose,
)
from hri_predict.predictors.neural.predictor import NeuralPredictor
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.zones.predictor_identity import identity

pytest.importorskip("onnxruntime", reason="ONNX Runtime is not installed")

SHAPE = Shape(skeleton=BODY, history_steps=5, horizon_steps=3, rate_hz=25.0)
ROUNDING_M = 1e-5
"""Metres: some hundred operations in single precision on values of a few metres."""


class Leaning(Network):
    """Adds a learnt offset to the last pose."""

    exportable: ClassVar[bool] = True

    def __init__(self, shape=SHAPE, lean=0.1):
        super().__init__(shape)
        self.options = NetworkOptions()
        self.offset = nn.Parameter(torch.full((1, shape.horizon_steps, 1, 3), lean))
        self.requires_grad_(False)

    def forward(self, window):
        return last_pose(window) + self.offset


class Branching(Leaning):
    """Does another thing where a joint is not observed, by a branch that tracing freezes."""

    def forward(self, window):
        ahead = super().forward(window)
        return ahead if bool(window.observed[:, -1].all()) else 2 * ahead


class Doubting(Leaning):
    """States another deviation where a joint is not observed."""

    def forward(self, window):
        doubt = 0.0 if bool(window.observed[:, -1].all()) else 0.01
        return nn.functional.pad(super().forward(window), (0, 1), value=doubt)


class Pairing(Leaning):
    """Does another thing for two people."""

    def forward(self, window):
        ahead = super().forward(window)
        return 2 * ahead if len(window.observed) == 2 else ahead


class Looping(Leaning):
    """Takes one person after another, as many as there were when it was exported."""

    def forward(self, window):
        ahead = super().forward(window)
        return torch.stack([ahead[i] for i in range(len(ahead))])


class Unexportable(Leaning):
    exportable: ClassVar[bool] = False


class Inverting(Leaning):
    """Uses what no exporter knows."""

    def forward(self, window):
        gram = torch.einsum("btjx,btjy->bxy", window.positions, window.positions)
        return super().forward(window) + torch.linalg.eigvalsh(gram)[:, None, None]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HRI_PREDICT_CACHE", str(tmp_path))
    return tmp_path


def walk(people, steps):
    rng = np.random.default_rng(people)
    return rng.normal(0, 0.02, (people, steps, 21, 3)).cumsum(1) + rng.normal(
        0, 0.3, (people, 1, 21, 3)
    )


@cache
def shipped(name, engine):
    """A network as it is shipped; to export one takes a second."""
    cls = registry.load("predictors", name)
    predictor = cls(cls.settings_model.model_validate({"name": name, "engine": engine}))
    assert isinstance(predictor, NeuralPredictor)
    return predictor


seldom = partial(pytest.param, marks=pytest.mark.long)  # to export one takes seconds


@pytest.mark.parametrize(
    "name",
    ["sinn", "trajectorycnn", "kdformer", seldom("stb"), seldom("auxformer"), seldom("mixer")],
)
@pytest.mark.long
def test_forecasts_of_the_copy_are_torch_s(name):
    torch_s, copy_s = shipped(name, "torch"), shipped(name, "auto")
    assert (torch_s.engine.name, copy_s.engine.name) == ("torch", "onnxruntime")
    for people in (1, 2, 5, 16):  # one copy serves any number of people
        history = walk(people, torch_s.history_steps)
        observed = np.random.default_rng(1).random(history.shape[:3]) > 0.2
        wanted, found = (p.predict(history, observed).positions for p in (torch_s, copy_s))
        assert np.abs(wanted - found).max() < ROUNDING_M


def test_the_copy_of_kdformer_turns_a_bone_that_points_the_other_way():
    """The rotation from a direction to its opposite has a formula of its own."""
    copy = shipped("kdformer", "auto")
    assert copy.engine.name == "onnxruntime"
    skeleton, body = copy.network.shape.skeleton, copy.network.rest.clone()
    hand = skeleton.joints.index("l_hand")
    body[hand] = 2 * body[skeleton.parents[hand]] - body[hand]
    window = BodyFrames(
        body.expand(1, copy.history_steps, -1, -1), torch.ones(1, copy.history_steps, 28).bool()
    )
    with torch.inference_mode():
        differs = copy.engine.forward(window) - copy.network(window)
    assert float(differs.abs().max()) < ROUNDING_M  # a copy without the formula: 0.03 m


@pytest.mark.parametrize(
    ("network", "why"),
    [
        (Branching, "differs from torch"),
        (Doubting, "differs from torch"),
        (Pairing, "differs from torch"),
        (Looping, "people; forward must not branch on values or loop over people"),
        (Inverting, "cannot be exported"),
        (Unexportable, ""),
    ],
)
def test_a_network_that_cannot_be_copied_is_computed_by_torch(network, why, caplog, capfd):
    caplog.set_level(logging.INFO)
    built: Network = network()
    built.eval()
    engine = engine_for(built, "auto", 1)
    assert engine.name == "torch"
    assert why in caplog.text
    assert "ONNXRuntimeError" not in caplog.text
    assert capfd.readouterr() == ("", "")  # the exporter prints graphs of thousands of lines
    with pytest.raises(ConfigError, match=f"engine onnxruntime: .*{why}.*; set predictor.engine"):
        engine_for(built, "onnxruntime", 1)


@pytest.mark.parametrize(
    "given", [np.zeros((1, 3, 28, 3), np.float32), np.zeros((2, 3, 28, 3), int)]
)
def test_an_answer_of_another_shape_or_type_is_an_error(monkeypatch, given):
    """One person's forecast for two would be taken for both."""
    import onnxruntime

    engine = engine_for(Leaning().eval(), "auto", 1)
    window = BodyFrames(torch.zeros(2, 5, 28, 3), torch.ones(2, 5, 28, dtype=torch.bool))
    assert engine.forward(window).shape == (2, 3, 28, 3)
    monkeypatch.setattr(onnxruntime.InferenceSession, "run", lambda *_: [given])
    with pytest.raises(PredictorError, match=r"not float32 \(2, 3, 28, 3\); set predictor\.engine"):
        engine.forward(window)


@pytest.mark.parametrize(
    "broken", ["raise RuntimeError('another ABI')", "class SessionOptions: pass"]
)
def test_a_broken_or_too_old_onnx_runtime_leaves_torch(tmp_path, monkeypatch, broken, caplog):
    (tmp_path / "onnxruntime.py").write_text(broken)
    monkeypatch.delitem(sys.modules, "onnxruntime", raising=False)
    monkeypatch.syspath_prepend(str(tmp_path))
    engine = engine_for(Leaning().eval(), "auto", 1)
    assert engine.name == "torch"
    assert "ONNX Runtime" in engine.why
    assert [r.levelname for r in caplog.records] == ["WARNING"]


def test_a_copy_is_kept_and_found_again(folder):
    engine_for(Leaning().eval(), "auto", 1)
    (kept,) = folder.iterdir()
    before = kept.stat().st_ino
    assert engine_for(Leaning().eval(), "auto", 1).name == "onnxruntime"
    assert kept.stat().st_ino == before
    engine_for(Leaning(lean=0.2).eval(), "auto", 1)
    assert len(list(folder.iterdir())) == 2  # other weights, another copy


@pytest.mark.long
def test_a_random_adversary_does_not_make_another_copy(folder):
    cls = registry.load("predictors", "sinn")
    for _ in range(2):
        cls(cls.settings_model(name="sinn", rate_hz=25.0, horizon_s=0.4))
    assert len(list(folder.iterdir())) == 1


def test_a_copy_of_something_else_is_made_anew(folder):
    """What lies in the cache under the right name may be the code's of yesterday."""
    other = engine_for(Leaning(lean=0.5).eval(), "auto", 1)
    forget(next(folder.iterdir()).name)
    engine_for(Leaning().eval(), "auto", 1)
    (kept,) = folder.iterdir()
    right = kept.read_bytes()
    forget(kept.name)
    cached(kept.name, lambda: other.model)
    assert kept.read_bytes() != right
    engine = engine_for(Leaning().eval(), "auto", 1)
    assert engine.name == "onnxruntime"
    assert engine.differs_m < ROUNDING_M
    assert kept.read_bytes() == right


def test_without_onnx_runtime_torch_computes_and_nothing_is_exported(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert engine_for(Leaning().eval(), "auto", 1).name == "torch"
    assert not list(folder.iterdir())
    with pytest.raises(ConfigError, match=r"is not installed; set predictor\.engine to auto"):
        engine_for(Leaning().eval(), "onnxruntime", 1)


def test_torch_alone_is_what_was_asked_for(folder):
    assert engine_for(Leaning().eval(), "torch", 1).name == "torch"
    assert not list(folder.iterdir())


@pytest.mark.long
def test_nothing_is_written_outside_the_cache(tmp_path):
    """ONNX Runtime would write a device's id below the home folder, and call its maker."""
    home, kept = tmp_path / "home", tmp_path / "kept"
    home.mkdir()
    code = (
        "from hri_predict import registry; cls = registry.load('predictors', 'mixer'); "
        "p = cls(cls.settings_model(name='mixer', rate_hz=25.0, horizon_s=1.0)); "
        "print(p.engine.name)"
    )
    given = {
        k: v for k, v in os.environ.items() if k not in ("XDG_CACHE_HOME", "ORT_DISABLE_TELEMETRY")
    }
    given |= {"HOME": str(home), "HRI_PREDICT_CACHE": str(kept)}
    ran = subprocess.run(
        [sys.executable, "-c", code],
        env=given,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert ran.stdout.strip() == "onnxruntime"
    assert [p.name for p in home.rglob("*")] == []
    assert len(list(kept.glob("*.onnx"))) == 1


def test_a_calibration_holds_for_every_engine():
    either = [NeuralSettings(name="sinn", engine=engine) for engine in ("torch", "onnxruntime")]
    assert identity(either[0]) == identity(either[1])
