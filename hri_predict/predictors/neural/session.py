"""ONNX Runtime: an exported network as a function of arrays. It needs no torch."""

import os
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools
from hri_predict.base.errors import PredictorError
from hri_predict.predictors.neural.windows import Singles

AGREES_M = 1e-4
"""Maximum difference between a copy's forecasts and torch's: rounding gives a hundredth of it."""
_TELEMETRY = "ORT_DISABLE_TELEMETRY"


class EngineError(Exception):
    """A network cannot be exported, or its copy cannot be used; one line."""


def runtime() -> Any:
    """The module ``onnxruntime``.

    Raises:
        EngineError: it is not installed, or broken.
    """
    os.environ.setdefault(_TELEMETRY, "1")  # else the import writes a device's id and calls out
    try:
        import onnxruntime
    except ImportError as error:
        raise EngineError("ONNX Runtime is not installed") from error
    except Exception as error:  # a broken installation may raise anything
        raise EngineError(f"ONNX Runtime cannot be imported: {line_of(error)}") from error
    return onnxruntime


class Session:
    """An ONNX Runtime session for windows: (B, T, J, 3) m, and observed (B, T, J).

    Args:
        model: the exported network.
        shape: (H, J, 3 or 4) shape of the forecasts.
        threads: CPU threads that it may use.

    Raises:
        EngineError: ONNX Runtime is missing, or rejects the model.
    """

    def __init__(self, model: bytes, shape: tuple[int, ...], threads: int) -> None:
        onnxruntime = runtime()
        try:
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = min(threads, os.cpu_count() or 1)
            options.inter_op_num_threads = 1
            options.log_severity_level = 4  # what fails is raised
            options.add_session_config_entry("session.intra_op.allow_spinning", "0")
            self._session = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # its errors share no base but this
            raise EngineError(f"ONNX Runtime rejects the network: {line_of(error)}") from error
        self._shape = shape
        # a network that does not read the mask has no such input
        self._inputs = frozenset(entry.name for entry in self._session.get_inputs())

    def __call__(self, positions: Singles, observed: Bools) -> Singles:
        """(B, H, J, 3 or 4), as ``Network.forward``.

        Raises:
            PredictorError: the result has another shape or type.
        """
        inputs = {"positions": positions, "observed": observed}
        read = {name: array for name, array in inputs.items() if name in self._inputs}
        forecast: Singles = self._session.run(None, read)[0]
        expected = (len(observed), *self._shape)
        if forecast.shape != expected or forecast.dtype != np.float32:
            raise PredictorError(
                f"ONNX Runtime gave {forecast.dtype} {forecast.shape}, not float32 {expected}; set "
                f"predictor.engine to torch"
            )
        return forecast

    def difference(self, positions: Singles, observed: Bools, wanted: Singles) -> float:
        """Largest difference from torch's forecast of a window, in metres; infinite for NaN.

        Logarithms of deviations count alike: 1e-4 is then 0.01 % of a deviation.

        Raises:
            EngineError: it fails, or the forecasts have different shapes.
        """
        try:
            apart = float(np.abs(self(positions, observed) - wanted).max())
        except Exception as error:  # the runtime's errors share no base but this
            raise EngineError(f"ONNX Runtime cannot run it: {line_of(error)}") from error
        return apart if np.isfinite(apart) else np.inf


def line_of(error: BaseException) -> str:
    """An error's message in one line of at most 200 characters."""
    return " ".join(str(error).split())[:200] or type(error).__name__
