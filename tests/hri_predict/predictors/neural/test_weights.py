"""Files of weights: what is kept, and that nothing but a whole, fitting file is taken."""

import json
import os
import struct
from types import SimpleNamespace

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import nn

from hri_predict.base.errors import ConfigError, HriPredictError, PredictorError
from hri_predict.base.skeleton import CANONICAL, make_skeleton
from hri_predict.contracts import registry
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    last_pose,
)
from hri_predict.predictors.neural.weights import load_weights, read_header, save_weights

CARD = {"data": "of this test", "validation_mm": [1.5, 2.5]}


class SmallOptions(NetworkOptions):
    width: int = 8


class Small(Network):
    """A network as small as can be, with a running mean and an adversary."""

    options_model = SmallOptions

    def __init__(self, shape: Shape, options: SmallOptions) -> None:
        super().__init__(shape)
        self.options = options
        self.encode = nn.Linear(shape.history_steps, options.width)
        self.norm = nn.BatchNorm1d(shape.joints)
        self.decode = nn.Linear(options.width, 3)
        self.critic = nn.Linear(3, 1)

    def forward(self, window: BodyFrames) -> torch.Tensor:
        heights = self.norm(window.positions[..., 2].mT)
        moved = self.decode(torch.tanh(self.encode(heights)))
        return last_pose(window) + moved[:, None].expand(-1, self.shape.horizon_steps, -1, -1)

    def critic_parameters(self):
        return self.critic.parameters()


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    methods = {"small": SimpleNamespace(network_class=Small), "netless": SimpleNamespace()}
    monkeypatch.setattr(registry, "names", lambda kind: sorted(methods))
    monkeypatch.setattr(registry, "load", lambda kind, name: methods[name])


def small(skeleton=BODY, **options: int) -> Small:
    torch.manual_seed(3)
    network = Small(
        Shape(skeleton=skeleton, history_steps=15, horizon_steps=25, rate_hz=25.0),
        SmallOptions(**options),
    )
    network.rest.normal_()
    network.norm.running_mean.normal_()  # type: ignore[union-attr]
    return network


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "small.safetensors"
    save_weights(path, "small", small(), CARD)
    return path


def rewritten(path, tensors=None, **header):
    """The file with other tensors, or other values in its header (``shape__x`` is nested)."""
    with safe_open(path, framework="pt") as file:
        described = json.loads(file.metadata()["hri_predict"])
    for key, value in header.items():
        *outer, last = key.split("__")
        place = described
        for part in outer:
            place = place[part]
        place[last] = value
    metadata = {"hri_predict": json.dumps(described)}
    save_file(load_file(path) if tensors is None else tensors, path, metadata)
    return path


def test_comes_back_as_it_was_but_for_half_precision(path):
    network = small(width=8).eval()
    loaded = load_weights(path)
    assert loaded.method == "small"
    assert loaded.card == CARD
    assert loaded.network.options == network.options
    assert loaded.network.shape == network.shape
    assert loaded.network.shape.skeleton is BODY
    assert not loaded.network.training
    assert not any(p.requires_grad for p in loaded.network.parameters())
    kept = loaded.network.state_dict()
    for name, tensor in network.state_dict().items():
        if not name.startswith("critic"):
            assert kept[name].dtype == tensor.dtype
            exact = name in dict(network.named_buffers())
            want = tensor if exact else tensor.half().float()
            torch.testing.assert_close(kept[name], want, rtol=0, atol=0)


def test_options_and_shape_are_kept(tmp_path):
    path = tmp_path / "wide.safetensors"
    save_weights(path, "small", small(CANONICAL, width=17), {})
    network = load_weights(path).network
    assert isinstance(network, Small)
    assert network.encode.out_features == 17
    assert network.shape.skeleton is CANONICAL


def test_adversary_is_not_shipped(path):
    assert "decode.weight" in load_file(path)
    assert not [name for name in load_file(path) if name.startswith("critic")]


def test_parameters_take_two_bytes_each(path):
    assert load_file(path)["encode.weight"].dtype == torch.float16
    assert load_file(path)["rest"].dtype == torch.float32


def test_a_skeleton_of_its_own_comes_back(tmp_path):
    skeleton = make_skeleton(
        "arms", ["a", "b", "c"], [-1, 0, 0], left_right_pairs=[(1, 2)], parts={"both": (1, 2)}
    )
    path = tmp_path / "arms.safetensors"
    save_weights(path, "small", small(skeleton), {})
    back = load_weights(path).network.shape.skeleton
    assert back.joints == skeleton.joints
    assert back.parents == skeleton.parents
    assert back.left_right_pairs == skeleton.left_right_pairs
    assert back.parts == skeleton.parts


def test_horizon_can_be_asked_for(path):
    network = load_weights(path, horizon_steps=50).network
    positions = torch.zeros(2, 15, 28, 3)
    assert network(BodyFrames(positions, positions[..., 0] == 0)).shape == (2, 50, 28, 3)


def test_header_is_read_without_the_tensors(path):
    header = read_header(path)
    assert header.card == CARD
    assert header.shape.joints == list(BODY.joints)
    assert (header.shape.history_steps, header.shape.horizon_steps) == (15, 25)


def test_same_network_same_bytes(path, tmp_path):
    save_weights(tmp_path / "again.safetensors", "small", small(), CARD)
    assert (tmp_path / "again.safetensors").read_bytes() == path.read_bytes()


def test_a_failed_save_leaves_the_old_file(path, monkeypatch):
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(PredictorError, match="No space left"):
        save_weights(path, "small", small(width=9), CARD)
    assert path.read_bytes() == before


@pytest.mark.parametrize("value", [float("nan"), 1e6])
def test_what_half_precision_cannot_hold_is_not_saved(tmp_path, value):
    network = small()
    with torch.no_grad():
        network.decode.bias[0] = value
    with pytest.raises(PredictorError, match=r"decode\.bias"):
        save_weights(tmp_path / "bad.safetensors", "small", network, {})
    assert not list(tmp_path.iterdir())


def test_a_card_that_is_not_json_is_refused(tmp_path):
    with pytest.raises(PredictorError, match="card"):
        save_weights(tmp_path / "bad.safetensors", "small", small(), {"what": object()})


def test_what_a_card_does_not_know_is_null(path):
    save_weights(path, "small", small(), {"error_mm": float("nan")})
    assert read_header(path).card == {"error_mm": None}


def _cut(path, share):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def _without(path, name):
    rewritten(path, {n: t for n, t in load_file(path).items() if n != name})


def _with(path, **tensors):
    rewritten(path, load_file(path) | tensors)


BROKEN = {
    "empty": lambda p: p.write_bytes(b""),
    "cut in the header": lambda p: _cut(p, 0.3),
    "cut in the tensors": lambda p: _cut(p, 0.95),
    "random": lambda p: p.write_bytes(bytes(range(256)) * 20),
    "header of exabytes": lambda p: p.write_bytes(struct.pack("<Q", 2**62) + b"{}"),
    "pickle": lambda p: torch.save(small().state_dict(), p),
    "foreign": lambda p: save_file({"a": torch.zeros(3)}, p),
    "header no JSON": lambda p: save_file({}, p, {"hri_predict": "{" * 10000}),
    "header no mapping": lambda p: save_file({}, p, {"hri_predict": "[1]"}),
    "unknown key": lambda p: rewritten(p, colour="red"),
    "of a later version": lambda p: rewritten(p, version=2),
    "unknown method": lambda p: rewritten(p, method="smal"),
    "method without a network": lambda p: rewritten(p, method="netless"),
    "unknown option": lambda p: rewritten(p, options__depth=3),
    "option of another type": lambda p: rewritten(p, options__width="wide"),
    "negative option": lambda p: rewritten(p, options__width=-1),
    "no history": lambda p: rewritten(p, shape__history_steps=0),
    "other joints": lambda p: rewritten(p, shape__joints=list(BODY.joints[::-1])),
    "other parents": lambda p: rewritten(p, shape__parents=[-1] * 28),
    "too few parents": lambda p: rewritten(p, shape__skeleton="own", shape__parents=[-1]),
    "a parent that is not": lambda p: rewritten(
        p, shape__skeleton="own", shape__parents=[-1] * 27 + [28]
    ),
    "a part's joint that is not": lambda p: rewritten(
        p, shape__skeleton="own", shape__parts={"all": [28]}
    ),
    "options that do not fit": lambda p: rewritten(p, options__width=9),
    "options of terabytes": lambda p: rewritten(p, options__width=10**11),
    "a tensor missing": lambda p: _without(p, "decode.weight"),
    "a tensor too many": lambda p: _with(p, more=torch.zeros(2)),
    "a tensor of another shape": lambda p: _with(p, rest=torch.zeros(27, 3)),
    "a value not finite": lambda p: _with(p, rest=torch.full((28, 3), torch.inf)),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_file_is_refused_in_one_line(path, kind):
    BROKEN[kind](path)
    with pytest.raises(HriPredictError) as caught:
        load_weights(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert len(message) < 600


def test_no_file_and_a_folder_are_told(tmp_path):
    with pytest.raises(ConfigError, match="the file does not exist"):
        load_weights(tmp_path / "none.safetensors")
    with pytest.raises(ConfigError, match=r"is a folder; name the \*\.safetensors file in it"):
        load_weights(tmp_path)


@pytest.mark.parametrize(
    "kind", [torch.float64, torch.complex64, torch.int64, torch.uint8, torch.bool]
)
def test_weights_of_another_type_are_refused(path, kind):
    _with(path, **{"decode.bias": torch.ones(3, dtype=kind)})
    with pytest.raises(PredictorError, match=r"'decode\.bias' is of type .*; expected F16, BF16"):
        load_weights(path)


def test_a_count_is_a_whole_number(path):
    _with(path, **{"norm.num_batches_tracked": torch.tensor(2.5)})
    with pytest.raises(PredictorError, match=r"'norm\.num_batches_tracked' is of type F32"):
        load_weights(path)


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.float32])
def test_weights_of_any_common_precision_are_taken(path, kind):
    _with(path, **{"decode.bias": torch.tensor([0.5, 1.0, -2.0], dtype=kind)})
    bias = load_weights(path).network.get_parameter("decode.bias")
    assert (bias.dtype, bias.tolist()) == (torch.float32, [0.5, 1.0, -2.0])
