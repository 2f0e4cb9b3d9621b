"""Code of other packages that a training run uses: after a change, it is another run."""

from collections.abc import Mapping
from pathlib import Path

from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.lab.training.config import TrainingConfig


def codes_of(config: TrainingConfig) -> dict[str, str]:
    """Return the SHA-256 of the code of each part that another package provides, by its name.

    The code of this package is left out: runs can be resumed after an update.
    """
    parts: dict[str, tuple[registry.Kind, str]] = {
        f"predictor '{config.predictor}'": ("predictors", config.predictor),
        f"data set '{config.judgement}'": ("data_sets", config.judgement),
        f"optimiser '{config.train.optimiser}'": ("optimisers", config.train.optimiser),
        f"schedule '{config.train.schedule}'": ("schedules", config.train.schedule),
    }
    found = {name: registry.code_of_part(*part) for name, part in parts.items()}
    return {name: code for name, code in found.items() if code is not None}


def refuse_other_code(path: Path, was: Mapping[str, str] | None, now: Mapping[str, str]) -> None:
    """Refuse to resume a checkpoint that other code wrote.

    Args:
        path: the checkpoint.
        was: ``codes_of`` the run that wrote it; ``None``: written before 0.3, which kept none.
        now: ``codes_of`` this run.

    Raises:
        ConfigError: the code of a part has changed.
    """
    if was is None:
        return
    for name in sorted(was.keys() | now.keys()):
        if was.get(name) != now.get(name):
            raise ConfigError(
                f"checkpoint {path}: was trained with other code of {name}; restore that, or "
                f"start another run with --out"
            )
