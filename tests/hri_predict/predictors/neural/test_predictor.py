"""From the room to a network and back: geometry, what the network lacks, settings, start-up."""

import logging
import subprocess
import sys
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
import torch
import yaml
from torch import nn

from hri_predict.base.errors import ConfigError, PredictorError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL, make_skeleton
from hri_predict.cli.check import predictors as listing
from hri_predict.contracts import registry
from hri_predict.predictors.neural import settings as neural
from hri_predict.predictors.neural.body import BODY, SHARED_BODY, SHARED_CANONICAL, from_canonical
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    last_pose,
)
from hri_predict.predictors.neural.predictor import NeuralPredictor
from hri_predict.predictors.neural.settings import NeuralSettings, shipped_weights
from hri_predict.predictors.neural.weights import save_weights
from hri_predict.run import assemble
from hri_predict.run import config as configuration


class Drift(Network):
    """Every joint goes on in a straight line that depends on the whole pose and its mask."""

    options_model = NetworkOptions
    any_horizon: ClassVar[bool] = True
    calls = 0

    def __init__(self, shape: Shape, options: NetworkOptions) -> None:
        super().__init__(shape)
        self.options = options
        self.mix = nn.Linear(shape.joints * 4, shape.joints * 3)

    def forward(self, window: BodyFrames) -> torch.Tensor:
        Drift.calls += 1
        seen = window.observed[..., None].to(window.positions.dtype)
        features = torch.cat([window.positions, seen], -1).mean(1).flatten(1)
        velocity = 0.1 * self.mix(features).view(-1, 1, self.shape.joints, 3)
        ahead = torch.arange(1.0, self.shape.horizon_steps + 1).view(1, -1, 1, 1)
        return last_pose(window) + velocity * ahead


class Unsure(Drift):
    """States how wrong it may be: a deviation of its own for each joint, of centimetres."""

    exportable: ClassVar[bool] = True

    def __init__(self, shape: Shape, options: NetworkOptions) -> None:
        super().__init__(shape, options)
        self.deviation = nn.Parameter(torch.linspace(-4.0, -1.0, shape.joints)[:, None])

    def forward(self, window: BodyFrames) -> torch.Tensor:
        ahead = super().forward(window)
        return torch.cat([ahead, self.deviation.expand(*ahead.shape[:3], 1)], -1)


class FixedDrift(Drift):
    any_horizon: ClassVar[bool] = False


class DriftPredictor(NeuralPredictor):
    """Goes on."""

    method = "drift"
    network_class = Drift


class FixedDriftPredictor(NeuralPredictor):
    """Goes on for as long as it was trained."""

    method = "drift"
    network_class = FixedDrift


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    known, load = registry.names, registry.load
    monkeypatch.setattr(registry, "names", lambda kind: [*known(kind), "drift"])
    monkeypatch.setattr(
        registry, "load", lambda kind, name: DriftPredictor if name == "drift" else load(kind, name)
    )


@pytest.fixture
def weights(tmp_path, random_network):
    path = tmp_path / "drift.safetensors"
    save_weights(path, "drift", random_network(Drift), {"data": "none"})
    return path


@pytest.fixture
def predictor(weights):
    return drift(weights)


def drift(weights, cls=DriftPredictor, skeleton=CANONICAL, **settings) -> NeuralPredictor:
    return cls(NeuralSettings(name="drift", weights=str(weights), **settings), skeleton)


@pytest.fixture
def walk(standing):
    """(2, 15, 21, 3) two who walk, a little shaky, and what is seen of them."""
    rng = np.random.default_rng(11)
    ahead = np.arange(15)[:, None, None] * np.array([0.04, 0.01, 0.0])
    history = standing + ahead + np.array([[1.0, 2.0, 0.0], [-2.0, 0.5, 0.0]])[:, None, None]
    history = history + rng.normal(0, 0.01, history.shape)
    return history, rng.random(history.shape[:3]) < 0.8


def joint(*names: str) -> list[int]:
    return [CANONICAL.index(name) for name in names]


def test_canonical_joints_are_the_body_s(weights, predictor, walk):
    body = drift(weights, skeleton=BODY).predict(*from_canonical(*walk)).positions
    canonical = predictor.predict(*walk).positions
    assert body.shape == (2, 25, 28, 3)
    np.testing.assert_array_equal(canonical[:, :, SHARED_CANONICAL], body[:, :, SHARED_BODY])


@pytest.mark.parametrize("move", [[900.0, -900.0, 3.0], [0.0, 1000.0, -1000.0]])
def test_anywhere_in_the_room_is_the_same(predictor, walk, move):
    history, observed = walk
    near = predictor.predict(history, observed).positions
    far = predictor.predict(history + np.array(move), observed).positions
    np.testing.assert_allclose(far - np.array(move), near, rtol=0, atol=1e-5)


def test_whichever_way_a_person_faces_is_the_same(predictor, walk):
    history, observed = walk
    c, s = np.cos(2.0), np.sin(2.0)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    turned = predictor.predict(history @ turn.T, observed).positions
    straight = predictor.predict(history, observed).positions
    np.testing.assert_allclose(turned, straight @ turn.T, rtol=0, atol=1e-5)


CARRIED = [
    ("waist", ("l_hip", "r_hip")),
    ("neck", ("l_shoulder", "r_shoulder")),
    ("head_top", ("head",)),
]


@pytest.mark.parametrize(("name", "carriers"), CARRIED)
def test_what_the_body_lacks_moves_with_its_neighbours(predictor, walk, name, carriers):
    history, observed = walk
    observed[:] = True
    forecast = predictor.predict(history, observed).positions
    moved = forecast[:, :, joint(*carriers)] - history[:, -1:, joint(*carriers)]
    want = history[:, -1:, joint(name)[0]] + moved.mean(axis=2)
    np.testing.assert_allclose(forecast[:, :, joint(name)[0]], want, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("name", "carriers"), CARRIED)
def test_what_was_last_seen_earlier_moves_on_from_then(predictor, walk, name, carriers):
    history, observed = walk
    observed[:] = True
    observed[:, 6:, joint(name)] = False
    forecast = predictor.predict(history, observed).positions
    moved = forecast[:, :, joint(*carriers)] - history[:, 5:6, joint(*carriers)]
    want = history[:, 5:6, joint(name)[0]] + moved.mean(axis=2)
    np.testing.assert_allclose(forecast[:, :, joint(name)[0]], want, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("name", "carriers"), CARRIED)
def test_what_was_never_seen_is_where_its_neighbours_are(predictor, walk, name, carriers):
    history, observed = walk
    observed[:, :, joint(name)] = False
    forecast = predictor.predict(history, observed).positions
    want = forecast[:, :, joint(*carriers)].mean(axis=2)
    np.testing.assert_allclose(forecast[:, :, joint(name)[0]], want, rtol=0, atol=1e-12)


def test_a_shorter_horizon_is_the_beginning_of_the_longer(weights, walk):
    whole = drift(weights).predict(*walk).positions
    for cls in (DriftPredictor, FixedDriftPredictor):
        short = drift(weights, cls, horizon_s=0.41)
        assert short.horizon_steps == 11  # reaches at least so far
        np.testing.assert_array_equal(short.predict(*walk).positions, whole[:, :11])


def test_a_longer_horizon_only_where_the_network_can(weights, walk, caplog):
    further = drift(weights, horizon_s=2.0)
    assert further.horizon_steps == 50
    assert further.predict(*walk).positions.shape == (2, 50, 21, 3)
    with caplog.at_level(logging.WARNING):
        capped = drift(weights, FixedDriftPredictor, horizon_s=2.0)
    assert capped.horizon_steps == 25
    assert capped.predict(*walk).positions.shape == (2, 25, 21, 3)
    assert "its weights reach 1 s, not predictor.horizon_s 2 s" in caplog.text


@pytest.mark.parametrize("horizon_s", [2.0, 2.04])
def test_far_beyond_the_trained_horizon_is_told_once(weights, caplog, horizon_s):
    with caplog.at_level(logging.WARNING):
        predictor = drift(weights, horizon_s=horizon_s)
        history, observed = np.zeros((1, 15, 21, 3)), np.ones((1, 15, 21), bool)
        predictor.predict(history, observed)
    told = [r.getMessage() for r in caplog.records]
    if horizon_s == 2.0:
        assert told == []
    else:
        assert len(told) == 1
        assert "2.04 s is far beyond the 1 s that its weights were trained for" in told[0]


@pytest.mark.parametrize("engine", ["torch", "onnxruntime"])
def test_a_network_states_its_deviation(tmp_path, random_network, monkeypatch, walk, engine):
    if engine == "onnxruntime":
        pytest.importorskip("onnxruntime", reason="ONNX Runtime is not installed")
    monkeypatch.setattr(DriftPredictor, "network_class", Unsure)
    network, path = random_network(Unsure), tmp_path / "unsure.safetensors"
    save_weights(path, "drift", network, {})
    predictor = drift(path, engine=engine, horizon_s=0.4)  # any horizon
    found, plain = predictor.predict(*walk), random_network(Drift)
    assert found.std is not None
    plain.load_state_dict(network.state_dict(), strict=False)
    said = dict(
        zip(BODY.joints, network.deviation.detach().half().double().exp()[:, 0], strict=True)
    )
    assert found.std.shape == found.positions.shape[:3] == (2, 10, 21)
    for name in ("head", "l_wrist"):
        np.testing.assert_allclose(found.std[:, :, joint(name)], float(said[name]), rtol=1e-5)
    between = float(said["l_hip"] + said["r_hip"]) / 2
    np.testing.assert_allclose(found.std[:, :, joint("waist")], between, rtol=1e-5)
    save_weights(path, "drift", plain, {})
    monkeypatch.setattr(DriftPredictor, "network_class", Drift)
    alone = drift(path, horizon_s=0.4).predict(*walk)
    np.testing.assert_allclose(found.positions, alone.positions, rtol=0, atol=1e-5)
    assert alone.std is None


@pytest.mark.parametrize("log", [torch.nan, -torch.inf, torch.inf, 1000.0])
def test_a_deviation_that_is_not_finite_is_no_forecast(tmp_path, random_network, monkeypatch, log):
    class Unsound(Drift):
        def forward(self, window: BodyFrames) -> torch.Tensor:
            return nn.functional.pad(super().forward(window), (0, 1), value=log)

    path = tmp_path / "unsound.safetensors"
    save_weights(path, "drift", random_network(Drift), {})
    monkeypatch.setattr(DriftPredictor, "network_class", Unsound)
    with pytest.raises(PredictorError, match="std is of the wrong shape, not finite or below 0"):
        drift(path)


@pytest.mark.parametrize("of", [lambda a: a[:, :, :20], lambda a: torch.cat([a, a], -1)])
def test_a_network_of_another_shape_is_refused(tmp_path, random_network, monkeypatch, of):
    class Other(Drift):
        def forward(self, window: BodyFrames) -> torch.Tensor:
            return of(super().forward(window))

    save_weights(tmp_path / "o", "drift", random_network(Drift), {})
    monkeypatch.setattr(DriftPredictor, "network_class", Other)
    with pytest.raises(PredictorError, match=r"shape \(1, 10, .* not \(1, H, 28, 3 or 4\)"):
        drift(tmp_path / "o", horizon_s=0.4)


def test_weights_that_give_no_finite_forecast_are_refused_at_the_start(
    tmp_path, random_network, monkeypatch
):
    class Runaway(Drift):
        def forward(self, window: BodyFrames) -> torch.Tensor:
            return super().forward(window) * torch.inf

    path = tmp_path / "runaway.safetensors"
    save_weights(path, "drift", random_network(Drift), {})
    monkeypatch.setattr(DriftPredictor, "network_class", Runaway)
    with pytest.raises(PredictorError) as caught:
        drift(path)
    assert str(caught.value) == (
        f"predictor drift: weights {path}: forecast is not finite; train them again, or give "
        f"another file"
    )


def test_rate_of_the_weights_is_the_only_one(weights):
    with pytest.raises(ConfigError, match=r"rate_hz is 30, but its weights .* are for 25"):
        drift(weights, rate_hz=30.0)


def test_weights_of_another_method_are_refused(weights):
    class Other(DriftPredictor):
        method = "other"

    with pytest.raises(ConfigError, match=r"are for 'drift'; give the file of this predictor"):
        drift(weights, Other)


@pytest.mark.parametrize("framed", [True, False])
def test_weights_of_the_benchmark_do_not_serve_the_node(tmp_path, framed):
    skeleton = BODY if framed else make_skeleton("own", ["a"], [-1])
    network = Drift(
        Shape(skeleton=skeleton, history_steps=10, horizon_steps=25, rate_hz=25.0, framed=framed),
        NetworkOptions(),
    )
    save_weights(tmp_path / "b.safetensors", "drift", network, {})
    with pytest.raises(ConfigError, match="give weights for 'body28' in the room"):
        drift(tmp_path / "b.safetensors")


def test_other_skeletons_are_refused(weights):
    with pytest.raises(ConfigError, match="not on 'own'"):
        drift(weights, skeleton=make_skeleton("own", ["a"], [-1]))


def test_missing_weights_are_told(tmp_path):
    with pytest.raises(ConfigError, match="the file does not exist"):
        drift(tmp_path / "none.safetensors")


def test_by_default_the_shipped_file_is_read():
    assert shipped_weights("drift").name == "drift.safetensors"
    assert shipped_weights("drift").parent.is_dir()
    with pytest.raises(ConfigError, match=r"no weights of 'drift' are shipped; .*--weights FILE"):
        DriftPredictor(NeuralSettings(name="drift"))


def test_weights_are_looked_for_beside_the_configuration(weights, tmp_path):
    demo = configuration.load(configuration.shipped("demo.yaml"))
    (tmp_path / "cell.yaml").touch()
    given = NeuralSettings(name="drift", weights=weights.name)
    cell = replace(demo, path=tmp_path / "cell.yaml", predictor=given)
    built = assemble.build_predictor(cell)
    assert isinstance(built, DriftPredictor)
    assert NeuralSettings(name="drift").resolved(tmp_path).weights is None


@pytest.mark.parametrize("change", [{"threads": 0}, {"weights": ""}, {"std": 1}])
def test_wrong_settings_are_refused(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        validated(NeuralSettings, {"name": "drift"} | change, "predictor")


def test_is_warm_and_keeps_to_its_threads(weights):
    before, Drift.calls = torch.get_num_threads(), 0
    try:
        drift(weights, threads=2)
        assert torch.get_num_threads() == 2
        assert Drift.calls >= 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.long
def test_torch_is_not_imported_for_what_does_not_need_it(tmp_path):
    demo = yaml.safe_load(configuration.shipped("demo.yaml").read_text(encoding="utf-8"))
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(demo | {"predictor": {"name": "kalman"}}))
    script = (
        "import sys; from pathlib import Path; from hri_predict.run import config;"
        "from hri_predict.cli.check import check;"
        "check.examine(config.load(Path(sys.argv[1]))); sys.exit('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script, path], timeout=60)
    assert done.returncode == 0


@pytest.mark.long
def test_loading_weights_does_not_import_the_compiler_of_torch():
    """It takes two seconds of each start."""
    script = (
        "import sys; from pathlib import Path;"
        "from hri_predict.predictors.neural.weights import load_weights;"
        "[load_weights(Path(path)) for path in sys.argv[1:]];"
        "print([name for name in ('torch._dynamo', 'sympy') if name in sys.modules])"
    )
    files = sorted(map(str, shipped_weights("sinn").parent.glob("*.safetensors")))
    assert len(files) >= 6
    command = [sys.executable, "-c", script, *files]
    done = subprocess.run(command, timeout=120, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_what_shipped_weights_say_is_listed(weights, monkeypatch, tmp_path):
    monkeypatch.setattr(neural, "shipped_weights", lambda _: weights)
    row = listing._predictor_row("drift")
    assert row["about"] == "Goes on."
    assert (row["weights"]["rate_hz"], row["weights"]["horizon_s"]) == (25.0, 1.0)
    weights.write_bytes(b"cut")
    assert "not a whole safetensors file" in listing._predictor_row("drift")["about"]
    monkeypatch.setattr(neural, "shipped_weights", lambda _: tmp_path / "none")
    assert listing._predictor_row("drift")["weights"] == {"path": None}
