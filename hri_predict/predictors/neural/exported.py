"""A trained predictor without torch: its exported network, cached with the data for a start.

torch takes seconds to import and half a gigabyte. Everything that needs torch only once runs in a
separate process (``exporting``), which then exits: check the weights, export the network, and
forecast some windows. The result is cached under a name that identifies everything it depends on:
weights, settings, and the code and versions that made it. At each start the copy must still
reproduce torch's forecasts.

Without numba, torch is imported anyway, to bring windows into people's own frames.
"""

import hashlib
import io
import json
import logging
import subprocess
import sys
import zipfile
import zlib
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import numpy as np

from hri_predict.base.errors import PredictorError
from hri_predict.base.files import package_path
from hri_predict.base.machine.cache import cached, forget
from hri_predict.base.machine.compiled import is_compiled
from hri_predict.base.skeleton import CANONICAL, neighbours
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.entering import tables
from hri_predict.predictors.neural.forecasting import Forecasting
from hri_predict.predictors.neural.session import AGREES_M, EngineError, Session, runtime
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.predictors.neural.windows import Entered, Singles

log = logging.getLogger(__name__)

MAX_BYTES = 2**30
NOT_EXPORTED = 3
"""Exit status of the exporting process without a copy; torch then reports the reason."""
# Exceptions that damaged content can raise.
_BROKEN: tuple[type[Exception], ...] = (ValueError, KeyError, TypeError, AttributeError, OSError)
_BROKEN += (EOFError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error)
_LIMIT_S = 600.0  # of an export: a start as a whole has its own limit
_VERSION = 3  # raise it when what is kept changes, or how
_BEGIN = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from hri_predict.predictors.neural.exporting import main; sys.exit(main(sys.argv[2]))"
)


class NoCopyError(Exception):
    """This predictor has no exported copy; torch is used and reports the reason."""


@dataclass(frozen=True, kw_only=True)
class Stored:
    """The cached part of a predictor.

    Attributes:
        model: the exported network.
        history_steps, horizon_steps: steps of the predictor.
        rest: (28, 3) m; see ``Network``.
        probes: (positions, observed, wanted) of windows and torch's forecasts.
        warnings: for the user, at each start.
    """

    model: bytes
    history_steps: int
    horizon_steps: int
    rest: Any
    probes: list[tuple[Any, Any, Any]]
    warnings: list[str]

    def packed(self) -> bytes:
        """As bytes."""
        file = io.BytesIO()
        arrays = {"rest": self.rest, "model": np.frombuffer(self.model, np.uint8)}
        for k, probe in enumerate(self.probes):
            arrays |= dict(zip((f"p{k}", f"o{k}", f"w{k}"), probe, strict=True))
        about = {
            "history_steps": self.history_steps,
            "horizon_steps": self.horizon_steps,
            "probes": len(self.probes),
            "warnings": self.warnings,
        }
        arrays["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
        np.savez(file, allow_pickle=False, **arrays)
        return file.getvalue()

    @classmethod
    def unpacked(cls, content: bytes) -> "Stored":
        """Restore an object from the bytes of ``packed``.

        Raises:
            NoCopyError: they are not such bytes.
        """
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
                about = json.loads(arrays["about"].tobytes())
                return cls(
                    model=arrays["model"].tobytes(),
                    history_steps=int(about["history_steps"]),
                    horizon_steps=int(about["horizon_steps"]),
                    rest=arrays["rest"],
                    probes=[
                        (arrays[f"p{k}"], arrays[f"o{k}"], arrays[f"w{k}"])
                        for k in range(int(about["probes"]))
                    ],
                    warnings=[str(each) for each in about["warnings"]],
                )
        except _BROKEN as error:
            raise NoCopyError("its cached copy is damaged") from error


@dataclass(frozen=True, slots=True)
class Computed:
    """The engine of an exported predictor; see ``engine.Engine``."""

    differs_m: float
    name: str = "onnxruntime"
    why: str = ""


class ExportedPredictor(Forecasting):
    """The forecasts of a trained predictor, by ONNX Runtime alone.

    Attributes:
        engine: engine that computes them.
    """

    settings_model = NeuralSettings

    def __init__(self, settings: NeuralSettings, stored: Stored) -> None:
        """Load the copy, check that it agrees with torch, and warm it up.

        Raises:
            EngineError: ONNX Runtime rejects it, or it does not agree.
            PredictorError: its forecast is not finite.
        """
        self.skeleton = CANONICAL
        self.rate_hz = settings.rate_hz
        self.history_steps, self.horizon_steps = stored.history_steps, stored.horizon_steps
        nearest = np.ascontiguousarray(neighbours(BODY.parents))
        self._tables = tables(CANONICAL, stored.rest, nearest)
        shape = next((wanted.shape[1:] for _, _, wanted in stored.probes), ())
        self._session = Session(stored.model, shape, settings.threads)
        differs = max((self._session.difference(*probe) for probe in stored.probes), default=np.inf)
        if not differs <= AGREES_M:
            raise EngineError(f"the copy of the network differs from torch by {differs:.2g} m")
        self.engine = Computed(differs_m=differs)
        if not is_compiled():  # torch's operations enter and leave, by default on all cores
            import torch

            torch.set_num_threads(settings.threads)
        self._warm_up(settings.name, settings.files()[0])
        for line in stored.warnings:
            log.warning("%s", line)

    def _ahead(self, entered: Entered) -> Singles:
        return self._session(entered.window, entered.observed)


def exported(settings: PredictorSettings) -> ExportedPredictor:
    """Build a shipped trained predictor from its exported copy, which is made if missing.

    Raises:
        NoCopyError: no copy can be made.
    """
    if type(settings) is not NeuralSettings or settings.engine == "torch":
        raise NoCopyError("torch is requested")
    name = settings.name
    if not registry.is_ours("predictors", name):
        raise NoCopyError("it is not shipped")
    try:
        runtime()
        key = _key(settings)
        for _ in range(2):
            try:
                content = cached(key, lambda: _made(settings, key))
                return ExportedPredictor(settings, Stored.unpacked(content))
            except (EngineError, NoCopyError, PredictorError) as error:
                problem = error
                forget(key)
    except (EngineError, OSError) as error:
        raise NoCopyError(str(error)) from error
    raise NoCopyError(str(problem)) from problem


def _key(settings: NeuralSettings) -> str:
    """Name of the copy, with a hash of everything it depends on.

    Raises:
        OSError: the weights cannot be read.
    """
    asked = settings.model_dump(mode="json", exclude={"weights", "threads", "engine", "process"})
    versions = {}
    for package in ("torch", "onnxruntime", "numpy", "hri-predict"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = ""
    about = [_VERSION, settings.name, asked, versions]
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    code = [package_path("base", "skeleton.py"), *sorted(package_path("predictors").rglob("*.py"))]
    for path in (*settings.files(), *code):
        if path.stat().st_size > MAX_BYTES:
            raise OSError("larger than any weights")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return f"{settings.name}-{digest.hexdigest()[:32]}.forecasts"


def _made(settings: NeuralSettings, key: str) -> bytes:
    """Make the copy in another process, whose memory is freed when it exits.

    Raises:
        NoCopyError: it cannot be made, and torch reports the reason; or it may not belong to
            ``key``.
        OSError: the weights cannot be read.
    """
    content = _by_another_process(settings)
    if _key(settings) != key:  # that process may have read other weights
        raise NoCopyError("its files changed while it was exported")
    return content


def _by_another_process(settings: NeuralSettings) -> bytes:
    told = settings.model_dump(mode="json", exclude_unset=True) | {"name": settings.name}
    command = [sys.executable, "-c", _BEGIN, json.dumps(sys.path), json.dumps(told)]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_LIMIT_S,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoCopyError(f"the process that exports it failed: {error}") from error
    if done.returncode != 0 or not done.stdout:
        if done.returncode != NOT_EXPORTED:
            log.warning(
                "predictor %s: its export exited with status %d; torch is loaded instead, which "
                "takes time and memory",
                settings.name,
                done.returncode,
            )
        raise NoCopyError(f"the process that exports it exited with status {done.returncode}")
    return done.stdout
