"""Progress of a training run: stored in each checkpoint as JSON, validated when it is read."""

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hri_predict.base.errors import ConfigError, HriPredictError
from hri_predict.lab.training.config import TrainSettings
from hri_predict.predictors.neural.weights import read_header

_Count = Annotated[int, Field(ge=0)]
_Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Progress(BaseModel):
    """State of a run's progress.

    Attributes:
        step: steps taken since the run began.
        losses: sums over the epoch's steps so far, by name.
        seconds: time taken, without interruptions.
        total_steps: step at which the schedule ends; 0: that of the settings.
        best_mm: validation error of the best weights.
        best_epoch: their epoch; 0: none yet.
        stale: epochs since then.
        best: their validation.
        weights: SHA-256 of their file.
    """

    model_config = ConfigDict(strict=True, extra="forbid")

    step: _Count = 0
    losses: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = {}
    seconds: _Amount = 0.0
    total_steps: _Amount = 0.0
    best_mm: Annotated[float, Field(ge=0)] = float("inf")
    best_epoch: _Count = 0
    stale: _Count = 0
    best: dict[str, Any] | None = None
    weights: str | None = None


Finished = Literal["epochs done", "no better validation", "out of time"]


def finished(progress: Progress, settings: TrainSettings) -> Finished | None:
    """Return why a run takes no more steps with these settings; ``None``: it goes on."""
    if progress.step >= settings.last_step:
        return "epochs done"
    if settings.patience and progress.stale >= settings.patience:
        return "no better validation"
    limit = settings.max_minutes
    if limit is not None and progress.seconds >= 60.0 * limit:
        return "out of time"
    return None


def read_progress(path: Path, state: dict[str, Any], settings: TrainSettings) -> Progress:
    """Return the progress in the checkpoint's ``state``.

    Raises:
        ConfigError: it is not that of a run with these settings.
    """
    remedy = "start the run again with another --out"
    try:
        progress = Progress.model_validate(json.loads(state["progress"]))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, ("progress", *first["loc"])))
        raise ConfigError(f"checkpoint {path}: {key}: {first['msg'].lower()}; {remedy}") from error
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ConfigError(f"checkpoint {path}: holds no progress of a run; {remedy}") from error
    epochs = -(-progress.step // settings.steps_per_epoch)
    if progress.step > settings.total_steps:
        raise ConfigError(
            f"checkpoint {path}: progress.step {progress.step} is beyond the last step, "
            f"{settings.total_steps}; {remedy}"
        )
    if max(progress.best_epoch, progress.stale) > epochs:
        raise ConfigError(
            f"checkpoint {path}: its best epoch is beyond the {epochs} that it took; {remedy}"
        )
    return progress


def digest_of(path: Path) -> str:
    """Return a file's SHA-256."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def demand_best_weights(path: Path, progress: Progress) -> None:
    """Check that the best weights are still those that the run wrote.

    Weights newer than the checkpoint are of a run that crashed between the two; it writes them
    again.

    Raises:
        ConfigError: they are missing, damaged, or others.
    """
    if not progress.best_epoch:
        return
    remedy = "put the file back, or start the run again with another --out"
    of = f"the best weights so far, of epoch {progress.best_epoch}"
    try:
        if digest_of(path) == progress.weights:
            return
        newer = int(read_header(path).card.get("steps", 0)) > progress.step
    except FileNotFoundError as error:
        raise ConfigError(f"weights {path}: {of}, are missing; {remedy}") from error
    except (OSError, HriPredictError, TypeError, ValueError) as error:
        raise ConfigError(f"weights {path}: {of}, cannot be read; {remedy}") from error
    if not newer:
        raise ConfigError(f"weights {path}: {of}, are damaged or were replaced; {remedy}")
