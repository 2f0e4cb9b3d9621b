"""Files of trained weights: safetensors, described by their own header.

A file holds a network's parameters in half precision and its buffers (the rest pose, running
means) unchanged, without the adversary's. The header has all that is needed to rebuild the
network (method, skeleton, steps, rate, options) and a card with information for the user.
Nothing in a file is ever executed, and no tensor is read before its size is known to be right.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from pydantic import Field
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor
from torch.overrides import TorchFunctionMode

from hri_predict.base.errors import ConfigError, PredictorError
from hri_predict.base.files import atomic_write
from hri_predict.base.settings import Settings, validated
from hri_predict.base.skeleton import CANONICAL, Skeleton, make_skeleton
from hri_predict.contracts import registry
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import Network, NetworkClass, Shape, network_class_of
from hri_predict.predictors.neural.session import line_of

MAX_BYTES = 512 * 2**20  # ten times the largest network of the papers in single precision
_KEY = "hri_predict"  # key of the header's metadata
_KNOWN = {skeleton.name: skeleton for skeleton in (BODY, CANONICAL)}
_FLOATS, _INTEGERS = ("F16", "BF16", "F32"), ("I64",)  # a batch norm counts in the latter
_REMEDY = "train it again, or give another file"


class StoredShape(Settings):
    """Size of the task of a file's network; see ``network.Shape``."""

    skeleton: str = Field(max_length=100)
    joints: list[str] = Field(min_length=1, max_length=256)
    parents: list[int]
    left_right_pairs: list[tuple[int, int]]
    parts: dict[str, list[int]]
    history_steps: int = Field(ge=1, le=1000)
    horizon_steps: int = Field(ge=1, le=1000)
    rate_hz: float = Field(gt=0, le=200)
    framed: bool


class Header(Settings):
    """The header of a weights file."""

    version: Literal[1] = 1
    method: str = Field(max_length=100)
    shape: StoredShape
    options: dict[str, Any]
    card: dict[str, Any]


@dataclass(frozen=True, slots=True)
class LoadedWeights:
    """A network ready for inference, the name of its method, and its card."""

    network: Network
    method: str
    card: dict[str, Any]


def save_weights(path: Path, method: str, network: Network, card: dict[str, Any]) -> None:
    """Write a network's weights; an existing file is replaced in one step, or not at all.

    Args:
        path: the file, usually ``*.safetensors``.
        method: name of the network's predictor.
        network: has ``options`` set.
        card: information for the user: data, configuration, commit, errors. JSON; NaN becomes
            null.

    Raises:
        PredictorError: the file cannot be written, a weight is not a finite number or too large for
            half precision, or the card is not JSON.
    """
    left_out = {id(parameter) for parameter in network.critic_parameters()}
    halved = {
        name for name, parameter in network.named_parameters() if id(parameter) not in left_out
    }
    dropped = {name for name, parameter in network.named_parameters() if id(parameter) in left_out}
    tensors = {
        name: (tensor.half() if name in halved and tensor.is_floating_point() else tensor.clone())
        .cpu()
        .contiguous()
        for name, tensor in network.state_dict().items()
        if name not in dropped
    }
    _check_finite(tensors, path)
    header = Header(
        method=method,
        shape=_stored(network.shape),
        options=network.options.model_dump(mode="json"),
        card=card,
    )
    try:
        text = json.dumps(header.model_dump(mode="json"), allow_nan=False)
    except ValueError as error:
        raise PredictorError(
            f"weights {path}: the card is not JSON: {error}; correct it"
        ) from error
    try:
        atomic_write(path, save(tensors, metadata={_KEY: text}))
    except OSError as error:
        raise PredictorError(
            f"weights {path}: cannot be written: {error.strerror or error}; check the path"
        ) from error


def read_header(path: Path) -> Header:
    """Read the header of a file of weights, without its tensors.

    Raises:
        ConfigError: the file does not exist, or its header has wrong keys.
        PredictorError: it is not a file of weights, or not one of this project.
    """
    _check_file(path)
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise _broken(path, f"not a whole safetensors file ({line_of(error)})") from error
    if _KEY not in metadata:
        raise _broken(path, "not weights of hri-predict: the header lacks their description")
    try:
        data = json.loads(metadata[_KEY])
    except (ValueError, RecursionError) as error:
        raise _broken(path, f"its header is not JSON ({line_of(error)})") from error
    return validated(Header, data, f"weights {path}")


def load_weights(path: Path, horizon_steps: int | None = None) -> LoadedWeights:
    """Build the network of a file and load its weights: single precision, for inference only.

    Args:
        path: the file.
        horizon_steps: steps to predict, if different from the file's horizon; only for networks
            whose parameters do not depend on it.

    Raises:
        ConfigError: the file does not exist, or its header names an unknown method or has a wrong
            key.
        PredictorError: the file is broken, foreign, or does not fit its method's network.
    """
    header = read_header(path)
    network_class = _network_class(header.method, path)
    options = validated(network_class.options_model, header.options, f"weights {path}: options")
    shape = _shape(header.shape, horizon_steps, path)
    try:
        with _LayersUnallocated():
            planned = network_class(shape, options)
        tensors = _tensors(path, planned)
        network = network_class(shape, options)
    except ConfigError as error:  # of options within options
        raise ConfigError(f"weights {path}: {error}") from error
    except (ValueError, TypeError, RuntimeError, ArithmeticError, LookupError) as error:
        why = f"no {header.method} can be built from its header ({line_of(error)})"
        raise _broken(path, why) from error
    network.load_state_dict(tensors, strict=False)  # only the adversary is missing
    return LoadedWeights(network.eval().requires_grad_(False), header.method, header.card)


class _LayersUnallocated(TorchFunctionMode):
    """Context in which new layers get weights without memory (torch's device "meta").

    Switching the default device would be simpler, but its ``arange`` is written in Python and
    imports torch's compiler, which takes two seconds.
    """

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Iterable[type],
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:
        if func is torch.empty:  # as torch.nn's layers make their weights
            return func(*args, **{**(kwargs or {}), "device": "meta"})
        return func(*args, **(kwargs or {}))


def _check_file(path: Path) -> None:
    if path.is_dir():
        raise ConfigError(f"weights {path}: is a folder; name the *.safetensors file in it")
    if not path.is_file():
        raise ConfigError(f"weights {path}: the file does not exist; train them, or check the path")
    if path.stat().st_size > MAX_BYTES:
        raise _broken(path, f"larger than {MAX_BYTES // 2**20} MiB, too large for weights")


def _network_class(method: str, path: Path) -> NetworkClass:
    if method not in registry.names("predictors"):
        raise ConfigError(
            f"weights {path}: of the unknown predictor '{method}'; "
            f"install the package that provides it"
        )
    network_class = network_class_of(method)
    if network_class is None:
        raise ConfigError(f"weights {path}: of '{method}', which has no network; {_REMEDY}")
    return network_class


def _stored(shape: Shape) -> StoredShape:
    skeleton = shape.skeleton
    return StoredShape(
        skeleton=skeleton.name,
        joints=list(skeleton.joints),
        parents=list(skeleton.parents),
        left_right_pairs=list(skeleton.left_right_pairs),
        parts={name: list(joints) for name, joints in skeleton.parts.items()},
        history_steps=shape.history_steps,
        horizon_steps=shape.horizon_steps,
        rate_hz=shape.rate_hz,
        framed=shape.framed,
    )


def _shape(stored: StoredShape, horizon_steps: int | None, path: Path) -> Shape:
    skeleton = _KNOWN.get(stored.skeleton)
    if skeleton is None:
        skeleton = _rebuilt(stored, path)
    elif (skeleton.joints, skeleton.parents) != (tuple(stored.joints), tuple(stored.parents)):
        raise _broken(path, f"its joints are not those of skeleton '{stored.skeleton}'")
    horizon = stored.horizon_steps if horizon_steps is None else horizon_steps
    return Shape(
        skeleton=skeleton,
        history_steps=stored.history_steps,
        horizon_steps=horizon,
        rate_hz=stored.rate_hz,
        framed=stored.framed,
    )


def _rebuilt(stored: StoredShape, path: Path) -> Skeleton:
    """A skeleton without a name in the project, such as the benchmark's."""
    count = len(stored.joints)
    linked = [*stored.left_right_pairs, *stored.parts.values()]
    if (
        len(stored.parents) != count
        or any(not -1 <= parent < count for parent in stored.parents)
        or any(not 0 <= joint < count for group in linked for joint in group)
    ):
        raise _broken(path, f"the joints of its skeleton '{stored.skeleton}' do not fit together")
    return make_skeleton(
        stored.skeleton,
        stored.joints,
        stored.parents,
        left_right_pairs=stored.left_right_pairs,
        parts={name: tuple(joints) for name, joints in stored.parts.items()},
    )


def _tensors(path: Path, planned: Network) -> dict[str, Tensor]:
    """Check and then read the tensors for ``planned``, a network without memory."""
    critic = {id(parameter) for parameter in planned.critic_parameters()}
    optional = {name for name, p in planned.named_parameters() if id(p) in critic}
    wanted = {n: tuple(t.shape) for n, t in planned.state_dict().items() if n not in optional}
    try:
        with safe_open(path, framework="pt") as file:
            names = list(file.keys())
            stored = {name: tuple(file.get_slice(name).get_shape()) for name in names}
            if stored != wanted:
                raise _broken(path, _difference(stored, wanted))
            _check_kinds(planned, {n: file.get_slice(n).get_dtype() for n in wanted}, path)
            tensors = {name: file.get_tensor(name) for name in wanted}
    except (SafetensorError, OSError) as error:
        raise _broken(path, f"not a whole safetensors file ({line_of(error)})") from error
    _check_finite(tensors, path)
    return tensors


def _difference(stored: dict[str, tuple[int, ...]], wanted: dict[str, tuple[int, ...]]) -> str:
    for name in sorted(stored.keys() | wanted.keys()):
        if name not in stored:
            return f"it lacks '{name}'"
        if name not in wanted:
            return f"it has '{name}', which its network lacks"
        if stored[name] != wanted[name]:
            return f"'{name}' has shape {stored[name]}, its network's has {wanted[name]}"
    raise AssertionError("they do not differ")


def _check_kinds(planned: Network, kinds: dict[str, str], path: Path) -> None:
    """Reject types whose conversion loses data: torch would drop a weight's imaginary part."""
    state = planned.state_dict()
    for name, kind in kinds.items():
        taken = _FLOATS if state[name].is_floating_point() else _INTEGERS
        if kind not in taken:
            raise _broken(path, f"'{name}' is of type {kind}; expected {', '.join(taken)}")


def _check_finite(tensors: dict[str, Tensor], path: Path) -> None:
    for name, tensor in tensors.items():
        if tensor.is_floating_point() and not bool(tensor.isfinite().all()):
            raise _broken(path, f"'{name}' has values that are not numbers, or too large")


def _broken(path: Path, why: str) -> PredictorError:
    return PredictorError(f"weights {path}: {why}; {_REMEDY}")
