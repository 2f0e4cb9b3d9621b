"""The configuration of ``hri-predict train``: one YAML file per predictor and evaluation."""

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from hri_predict.base.files import read_yaml
from hri_predict.base.set_key import set_key
from hri_predict.base.settings import Settings, validated


class ShapeSettings(Settings):
    """Steps of history and horizon, and steps per second (``shape:``)."""

    history_steps: int = Field(ge=2, le=1000)
    horizon_steps: int = Field(ge=1, le=1000)
    rate_hz: float = Field(25.0, gt=0, le=200)


class TrainSettings(Settings):
    """Settings of the training (``train:``)."""

    epochs: int = Field(50, ge=1, le=10**9, description="epochs of the learning rate's schedule")
    stop_after: int | None = Field(None, ge=1, description="stop after this many epochs")
    windows_per_epoch: int = Field(4096, ge=1, le=10**9)
    batch: int = Field(64, ge=1, le=2**16, description="windows per step, over all processes")
    learning_rate: float = Field(1e-3, gt=0)
    critic_learning_rate: float = Field(
        1e-4, gt=0, description="learning rate of an adversary, if any"
    )
    weight_decay: float = Field(0.01, ge=0)
    warmup: float = Field(
        0.05, ge=0, le=0.05, description="share of the run's steps in which the learning rate rises"
    )
    optimiser: str = Field("adamw", description="adamw, adam, or one from an installed package")
    schedule: str = Field("cosine", description="cosine, constant, steps, or one from a package")
    decay: float = Field(0.96, gt=0, le=1, description="steps: factor of the learning rate ...")
    decay_epochs: float = Field(2.0, gt=0, description="... after this many epochs")
    ema_decay: float = Field(
        0.999,
        ge=0,
        lt=1,
        description="decay of the averaged weights, which are shipped; 0: no average",
    )
    clip_norm: float = Field(1.0, gt=0, description="maximum gradient norm of a step")
    seed: int = Field(0, ge=0, le=2**63 - 1)
    teachers: list[str] = Field(
        [], description="weights files, or predictors whose weights ship, to learn from"
    )
    taught: float = Field(
        0.5, ge=0, le=1, description="share of the windows whose target is the teachers' mean"
    )
    patience: int = Field(
        0, ge=0, description="stop after this many epochs without better validation; 0: never"
    )
    threads: int = Field(1, ge=1, le=256)
    device: Literal["cpu", "cuda"] = "cpu"
    precision: Literal["float32", "bfloat16"] = Field(
        "float32",
        description="precision of products; bfloat16 (3 digits) is faster on some processors",
    )
    max_minutes: float | None = Field(
        None,
        gt=0,
        description="maximum training time, resumed parts included; the schedule ends with it",
    )
    checkpoint_minutes: float = Field(
        5.0, gt=0, description="minutes between checkpoints within an epoch"
    )

    @model_validator(mode="after")
    def _an_epoch_has_a_batch(self) -> Self:
        if self.batch > self.windows_per_epoch:
            raise ValueError(
                f"batch {self.batch} is more than windows_per_epoch {self.windows_per_epoch}; make "
                f"batch smaller"
            )
        return self

    @property
    def steps_per_epoch(self) -> int:
        """Whole batches in an epoch; at least one."""
        return self.windows_per_epoch // self.batch

    @property
    def total_steps(self) -> int:
        """Steps of the whole schedule."""
        return self.epochs * self.steps_per_epoch

    @property
    def last_step(self) -> int:
        """Step after which the run ends: that of ``stop_after``, or of the whole schedule."""
        return min(self.stop_after or self.epochs, self.epochs) * self.steps_per_epoch

    @property
    def warmup_steps(self) -> float:
        """Number of warm-up steps: a share of the run, so a short run also reaches the peak."""
        return self.warmup * self.total_steps


class TrainingConfig(Settings):
    """A whole training run."""

    predictor: str
    judgement: str = Field(
        description="data set: real, benchmark (CMU), human36m, or one from a package"
    )
    shape: ShapeSettings
    options: dict[str, Any] = Field({}, description="the network's own sizes and switches")
    data: dict[str, Any] = Field({}, description="see the data set's settings_model")
    train: TrainSettings = TrainSettings()
    initial_weights: Path | None = Field(None, description="weights to start from (fine-tuning)")
    out: Path = Field(description="folder of the run: checkpoints, log, weights")

    @field_validator("out")
    @classmethod
    def _a_folder_of_its_own(cls, value: Path) -> Path:
        if value == Path() or "\0" in str(value):
            raise ValueError("must name a folder for this run alone, such as runs/sinn")
        return value

    @property
    def error_unit(self) -> str:
        """Unit of the validation error: mm of positions, mrad of rotations (exponential maps)."""
        return "mrad" if self.data.get("space") == "rotations" else "mm"


def load_training_config(path: Path, changes: list[str] | None = None) -> TrainingConfig:
    """Read a training configuration; ``changes`` are ``key.key=value`` that override it.

    Raises:
        ConfigError: the file, a key or a change is wrong; one line with the remedy.
    """
    data = read_yaml(path, "training configuration")
    for change in changes or []:
        set_key(data, change)
    return validated(TrainingConfig, data, str(path))
