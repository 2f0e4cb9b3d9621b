"""Whole training runs: one, or all of a plan in order, each resumed where it was interrupted."""

import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import yaml
from pydantic import Field, TypeAdapter, ValidationError

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import load_yaml, read_text
from hri_predict.base.settings import Settings
from hri_predict.lab.training.building import build_network, open_samples
from hri_predict.lab.training.checkpoint import load_checkpoint
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.loop import Result, Run
from hri_predict.lab.training.processes import Processes
from hri_predict.lab.training.view import training_view


class Planned(Settings):
    """A run of a plan."""

    config: str = Field(description="training configuration, in the folder of the plan")
    set: list[str] = Field([], description="changes to it, key.key=value")


def read_plan(path: Path) -> list[Planned] | None:
    """Read the runs of a YAML list, in order; ``None`` if the file is a configuration instead.

    Raises:
        ConfigError: the file cannot be read, or lists anything other than runs.
    """
    found = None
    with suppress(yaml.YAMLError, RecursionError):  # named where it is read as a configuration
        found = load_yaml(read_text(path, "training configuration"))
    if not isinstance(found, list):
        return None
    try:
        return TypeAdapter(list[Planned]).validate_python(found)
    except ValidationError as error:
        raise ConfigError(
            f"{path}: a plan is a list of '{{config: FILE, set: [key=value]}}': "
            f"{error.errors()[0]['msg']}"
        ) from error


def begun(config: TrainingConfig) -> bool:
    """Whether its folder holds a run."""
    return os.path.exists(config.out / "last.pt")  # takes names that are too long


def state(config: TrainingConfig) -> str:
    """The state of its run: ``new``, a percentage, or ``done``."""
    if not begun(config):
        return "new"
    step = json.loads(load_checkpoint(config.out / "last.pt")["progress"])["step"]
    train = config.train
    until = min(train.stop_after or train.epochs, train.epochs) * train.steps_per_epoch
    return "done" if step >= until else f"{100 * step // until} %"


def trained(
    config: TrainingConfig,
    *,
    resume: bool,
    stop: Callable[[], bool] = lambda: False,
    processes: Processes | None = None,
    command: str | None = None,
) -> Result:
    """Train one configuration until one of its endings; see ``loop.Run``."""
    source = open_samples(config)
    network = build_network(config, source)
    with training_view(config) as view:
        run = Run(config, source, network, view, stop=stop, processes=processes, command=command)
        return run.go(resume)
