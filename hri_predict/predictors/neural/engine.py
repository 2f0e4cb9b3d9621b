"""Engine of a network: torch itself, or ONNX Runtime with an exported copy of the network.

A copy is a second program, so it is verified each time a predictor is built: it is used only if it
agrees with torch on windows like those of a cell. Otherwise torch is used, and the reason is
logged. A node need not export: ``exported`` caches the copy and the windows.
"""

import contextlib
import hashlib
import io
import json
import logging
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.machine.cache import cached, forget
from hri_predict.predictors.neural.network import BodyFrames, Network
from hri_predict.predictors.neural.session import (
    AGREES_M,
    EngineError,
    Session,
    line_of,
    runtime,
)
from hri_predict.predictors.neural.settings import EngineName
from hri_predict.predictors.neural.windows import Singles

log = logging.getLogger(__name__)

_OPSET = 17
_EXPORT = 5  # raise it when the way of exporting, or of keeping, changes
_PROBES = 6  # people of the test: see ``_probe``
_COPIED = "forward must not branch on values or loop over people"


@dataclass(frozen=True, slots=True)
class Engine:
    """Computes a network's forward pass.

    Attributes:
        name: torch or onnxruntime.
        forward: a window of B people to (B, H, J, 3 or 4), as ``Network.lean``.
        differs_m: the largest difference from torch on the probes, in metres.
        why: reason not to use ONNX Runtime; one line.
        model: the exported copy in use; empty for torch.
    """

    name: EngineName
    forward: Callable[[BodyFrames], Tensor]
    differs_m: float = 0.0
    why: str = ""
    model: bytes = b""


def engine_for(network: Network, wanted: EngineName, threads: int) -> Engine:
    """The engine of a network, for any number of people.

    Args:
        network: in inference mode.
        wanted: ``auto``: ONNX Runtime where the network can be exported and the copy agrees.
        threads: CPU threads that it may use.

    Raises:
        ConfigError: ``onnxruntime`` is requested by name and is not available.
    """
    if wanted == "torch" or (wanted == "auto" and not network.exportable):
        return Engine("torch", network.lean())
    try:
        return _onnxruntime(network, threads)
    except EngineError as error:
        if wanted == "onnxruntime":
            raise ConfigError(
                f"predictor.engine onnxruntime: {error}; set predictor.engine to auto"
            ) from error
        log.warning("the network runs in torch, which may take twice as long: %s", error)
        return Engine("torch", network.lean(), why=str(error))


def _onnxruntime(network: Network, threads: int) -> Engine:
    """Return a copy that agrees with torch. A cached one that does not is exported again, once.

    Raises:
        EngineError: no copy agrees.
    """
    if not network.exportable:
        raise EngineError("this network cannot be exported")
    runtime()
    name = f"{type(network).__name__.lower()}-{_digest(network)}.onnx"
    problem, asked = "", probes(network)
    for _ in range(2):
        model = cached(name, lambda: _exported(network))
        try:
            session = Session(model, asked[0].wanted.shape[1:], threads)
        except EngineError as error:
            problem = str(error)
        else:
            differs, problem = _difference(session, asked)
            if not problem:
                return Engine("onnxruntime", _Forward(session), differs, model=model)
        forget(name)
    raise EngineError(problem)


def _difference(session: Session, asked: "list[Probe]") -> tuple[float, str]:
    """Return a copy's largest difference from torch, and why it cannot be used; "" if it can."""
    try:
        differs = max(session.difference(p.positions, p.observed, p.wanted) for p in asked)
    except EngineError as error:
        log.debug("%s", error)  # in the runtime's own words, which name nodes of its graph
        return np.inf, f"its copy of the network fails for other numbers of people; {_COPIED}"
    if differs <= AGREES_M:
        return differs, ""
    return differs, f"its copy of the network differs from torch by {differs:.2g} m; {_COPIED}"


class _Forward:
    """A session as a network's forward pass."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def __call__(self, window: BodyFrames) -> Tensor:
        return torch.from_numpy(
            self._session(
                window.positions.contiguous().numpy(), window.observed.contiguous().numpy()
            )
        )


class _Traced(nn.Module):
    """A network with tensors as its arguments, as the exporter needs them."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.lean = network.lean()

    def forward(self, positions: Tensor, observed: Tensor) -> Tensor:
        return self.lean(BodyFrames(positions, observed))


def _exported(network: Network) -> bytes:
    """The network as an ONNX model for any number of people.

    Uses the exporter that traces: torch's other one dropped a small summand from a denominator.

    Raises:
        EngineError: it cannot be exported.
    """
    window = _probe(network)
    file = io.BytesIO()
    people = {"positions": {0: "people"}, "observed": {0: "people"}, "forecast": {0: "people"}}
    try:
        with _quiet(), torch.no_grad():
            torch.onnx.export(
                _Traced(network).eval(),
                (window.positions, window.observed),
                cast(Any, file),
                dynamo=False,
                input_names=["positions", "observed"],
                output_names=["forecast"],
                dynamic_axes=people,
                opset_version=_OPSET,
            )
    except Exception as error:  # the exporter's errors share no base but this
        raise EngineError(f"the network cannot be exported: {line_of(error)}") from error
    return file.getvalue()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the exporter's tracing warnings, and the graphs that it prints on stdout."""
    exporter = logging.getLogger("torch.onnx")
    level, said = exporter.level, getattr(torch._C, "_jit_onnx_log", None)
    try:
        exporter.setLevel(logging.ERROR)
        if said is not None:
            cast(Any, torch._C)._jit_onnx_log = lambda *_: None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        exporter.setLevel(level)
        if said is not None:
            cast(Any, torch._C)._jit_onnx_log = said


@dataclass(frozen=True, slots=True)
class Probe:
    """A window, and what torch forecasts for it.

    Attributes:
        positions: (B, T, J, 3) m.
        observed: (B, T, J).
        wanted: (B, H, J, 3 or 4), as ``Network.forward``.
    """

    positions: Singles
    observed: Bools
    wanted: Singles


def probes(network: Network) -> list[Probe]:
    """Torch's own forecasts for several people together, for two of them, and one by one.

    A branch may depend on all people of a window, or on their number.
    """
    everybody = _probe(network)
    found = []
    for people in (slice(None), slice(0, 2), *(slice(i, i + 1) for i in range(_PROBES))):
        window = BodyFrames(everybody.positions[people], everybody.observed[people])
        with torch.inference_mode():
            wanted = network(window)  # the plain forward pass, which has no shortcut
        found.append(
            Probe(
                window.positions.contiguous().numpy(),
                window.observed.contiguous().numpy(),
                wanted.contiguous().numpy(),
            )
        )
    return found


def _probe(network: Network) -> BodyFrames:
    """Windows of people moving at up to a few metres per second, observed in several ways.

    Always; with gaps; without a joint; not recently; never; only at first.
    """
    rng = np.random.default_rng(0)
    steps, joints = network.shape.history_steps, network.shape.joints
    body = network.rest.double().numpy() + 0.05 * rng.standard_normal((_PROBES, 1, joints, 3))
    moved: Floats = (
        0.02 * rng.standard_normal((_PROBES, steps, joints, 3))
        + 0.05 * rng.standard_normal((_PROBES, 1, 1, 3))
    ).cumsum(1)
    observed = np.ones((_PROBES, steps, joints), dtype=bool)
    observed[1] = rng.random((steps, joints)) > 0.3
    observed[2, :, joints // 2] = False
    observed[3, steps // 2 :] = False
    observed[4] = False
    observed[5, 1:] = False
    with torch.no_grad():
        return network.enter(torch.from_numpy(body + moved), torch.from_numpy(observed))[0]


def _digest(network: Network) -> str:
    """Hash of everything an exported copy depends on, except the code; the probes check that."""
    digest = hashlib.sha256()
    shape, options = network.shape, network.options.model_dump(mode="json")
    about = [
        _EXPORT,
        torch.__version__,
        type(network).__qualname__,
        options,
        [shape.skeleton.joints, shape.history_steps, shape.horizon_steps, shape.rate_hz],
    ]
    digest.update(json.dumps(about, sort_keys=True, default=str).encode())
    adversary = {parameter.data_ptr() for parameter in network.critic_parameters()}
    for name, tensor in network.state_dict().items():
        if tensor.data_ptr() not in adversary:  # not in the weights' file, so random each time
            digest.update(name.encode())
            digest.update(tensor.contiguous().numpy().tobytes())
    return digest.hexdigest()[:32]
