"""Identity of a predictor: everything that its errors depend on."""

import hashlib
import shlex
from typing import Any

from hri_predict.base.work.identity import joined
from hri_predict.contracts.predictor import PredictorSettings

_NOT_ITS_OWN = {"name", "horizon_s", "weights", "engine", "process"}
"""Settings that are compared elsewhere, or only change where a forecast is computed."""
CALIBRATED_S = 1.2
"""Horizon of a calibration in seconds, unless another is given."""


def calibrate_command(name: str, weights: str | None, horizon_s: float) -> str:
    """Return the command that calibrates a predictor with these weights, up to this horizon."""
    words = ["hri-predict", "calibrate", "--predictor", name]
    words += [] if weights is None else ["--weights", weights]
    words += ["--horizon", f"{horizon_s:g}"] if horizon_s > CALIBRATED_S else []
    return shlex.join([*words, "--data", "recordings"])


def identity(settings: PredictorSettings) -> tuple[dict[str, Any], str | None]:
    """Return the settings that affect a predictor's errors, and the hash of its weights."""
    values = settings.model_dump(mode="json", exclude=_NOT_ITS_OWN)
    found = [
        hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "missing"
        for path in settings.files()
    ]
    if all(each == "missing" for each in found):
        return values, None
    return values, joined(found)
