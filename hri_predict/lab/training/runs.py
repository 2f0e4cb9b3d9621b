"""Whole training runs: one, or all of a plan in order, each resumed where it was interrupted."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import torch
import yaml
from pydantic import Field, TypeAdapter, ValidationError
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import load_yaml, read_text
from hri_predict.base.installed import for_this_installation
from hri_predict.base.settings import Settings, validated
from hri_predict.lab.training.checkpoint import check_folder, load_checkpoint
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.first_try import made, try_network
from hri_predict.lab.training.loop import Epoch, Result, Run
from hri_predict.lab.training.parts import part
from hri_predict.lab.training.processes import Processes
from hri_predict.lab.training.progress import finished, read_progress
from hri_predict.lab.training.windows.samples import SampleSource, SampleSourceClass
from hri_predict.predictors.neural.network import (
    Network,
    NetworkOptions,
    Shape,
    network_class_of,
)
from hri_predict.predictors.neural.weights import load_weights


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


def check_run_folder(config: TrainingConfig, resume: bool) -> None:
    """Fail before the data are read, which takes minutes, if the run's folder does not suit it.

    Raises:
        ConfigError: see ``check_folder``; or the log's place is taken.
    """
    check_folder(config.out, resume)
    log = config.out / "log"
    if os.path.exists(log) and not log.is_dir():
        raise ConfigError(
            f"{log}: is a file, but the log needs a folder; remove it, or choose another 'out'"
        )


def state(config: TrainingConfig) -> str:
    """The state of its run: ``new``, a percentage of its steps, or ``done``: it takes no more."""
    if not begun(config):
        return "new"
    path, train = config.out / "last.pt", config.train
    progress = read_progress(path, load_checkpoint(path), train)
    if finished(progress, train):
        return "done"
    return f"{100 * progress.step // train.last_step} %"


def trained(
    config: TrainingConfig,
    *,
    resume: bool,
    stop: Callable[[], bool] = lambda: False,
    processes: Processes | None = None,
    command: str | None = None,
) -> Result:
    """Train one configuration until one of its endings; see ``loop.Run``."""
    check_run_folder(config, resume)
    source = open_samples(config)
    network = build_network(config, source)
    try_network(network, source, config.predictor)
    with training_view(config) as view:
        run = Run(config, source, network, view, stop=stop, processes=processes, command=command)
        return run.go(resume)


def open_samples(config: TrainingConfig) -> SampleSource:
    """Open the training and validation windows that ``config`` names.

    Raises:
        ConfigError: a key of ``data`` is wrong, or there is nothing to train on.
        RecordingError: a recording cannot be read.
    """
    data_set: SampleSourceClass = part("data_sets", config.judgement)
    data = validated(data_set.settings_model, config.data, "training configuration: data")
    source, rate_hz = data_set.opened(data, **dict(config.shape)), config.shape.rate_hz
    if source.shape.rate_hz != rate_hz:
        raise ConfigError(
            f"training configuration: shape.rate_hz {rate_hz:g}: data set {config.judgement} has "
            f"{source.shape.rate_hz:g}; leave it out"
        )
    return source


def build_network(config: TrainingConfig, source: SampleSource) -> Network:
    """The network that ``config`` names, seeded, or with its ``initial_weights``.

    Raises:
        ConfigError: the predictor does not exist, it is not a trained one, or an option is wrong.
        PredictorError: the initial weights cannot be read or belong to another network.
    """
    network_class = network_class_of(config.predictor)
    if network_class is None:
        raise ConfigError(
            f"predictor '{config.predictor}' has no network: nothing to train; name a trained one"
        )
    options = validated(
        network_class.options_model, config.options, "training configuration: options"
    )
    _check_space(options, str(config.data.get("space", "positions")))
    torch.manual_seed(config.train.seed)
    network = made(network_class, source.shape, options, config.predictor)
    network.rest.copy_(source.rest())
    if config.initial_weights is not None:
        _start_from(network, config.initial_weights)
    return network


def _check_space(options: NetworkOptions, space: str) -> None:
    """Refuse options that take rotations for positions, which would go unnoticed."""
    own = getattr(options, "space", space)
    if own != space:
        raise ConfigError(
            f"training configuration: options.space is {own} and data.space {space}; set both alike"
        )
    if space == "positions":
        return
    for key, off in (("mirrored", "false"), ("bone_weight", "0")):
        if getattr(options, key, False):
            raise ConfigError(
                f"training configuration: options.{key} needs positions, and data.space is "
                f"{space}; set options.{key}={off}"
            )


def _start_from(network: Network, path: Path) -> None:
    """Copy the weights in ``path``, their rest pose included, into ``network``."""
    given = load_weights(path).network
    same_task = _described(given.shape) == _described(network.shape)
    if type(given) is not type(network) or not (
        same_task and _continues(given.options, network.options)
    ):
        raise ConfigError(
            f"initial_weights {path}: have another network, shape or options; train with the "
            f"predictor, shape and options that its card states"
        )
    missing = network.load_state_dict(given.state_dict(), strict=False).missing_keys
    critic = {id(p) for p in network.critic_parameters()}
    grows = any(
        getattr(given.options, k) != getattr(network.options, k) for k in given.options.added
    )
    for name in missing:  # an adversary is not shipped; it starts with fresh weights
        if id(network.get_parameter(name)) not in critic and not grows:
            raise ConfigError(f"initial_weights {path}: lacks '{name}'; train again without it")


def _described(shape: Shape) -> tuple[object, ...]:
    """Return the values that make two shapes equal; unnamed skeletons are rebuilt objects."""
    skeleton = shape.skeleton
    return (
        skeleton.joints,
        skeleton.parents,
        skeleton.left_right_pairs,
        skeleton.parts,
        shape.history_steps,
        shape.horizon_steps,
        shape.rate_hz,
        shape.framed,
    )


def _continues(given: NetworkOptions, ours: NetworkOptions) -> bool:
    """Whether weights trained with ``given`` mean the same in a network with ``ours``."""
    defaults = type(ours)()
    free = {name: getattr(defaults, name) for name in ours.training}
    for name in ours.added:
        if getattr(given, name) == getattr(defaults, name):
            free[name] = getattr(defaults, name)
    return given.model_copy(update=free) == ours.model_copy(update=free)


class TrainingView:
    """Progress on standard error and a TensorBoard log; see ``loop.View``."""

    def __init__(self, config: TrainingConfig, bar: Progress | None) -> None:
        self._config = config
        self._bar = bar
        self._task: Any = None
        self._log: Any = None
        self._total = 0

    def started(self, step: int, total_steps: int) -> None:
        """Open the log and the bar."""
        self._total = total_steps
        self._log = _log(self._config, step)
        if self._bar is not None:
            self._task = self._bar.add_task("training", total=total_steps, completed=step, loss="")

    def stepped(self, step: int, loss: float) -> None:
        """Move the bar."""
        if self._bar is not None:
            self._bar.update(self._task, completed=step, loss=f"loss {loss:.4f}")

    def ended_epoch(self, epoch: Epoch) -> None:
        """Print a line and log the numbers."""
        error, best = "", " (best)" if epoch.best else ""
        if epoch.validation is not None:
            error = f"  validation {epoch.validation.mm:.1f} {self._config.error_unit}"
        line = (
            f"epoch {epoch.number}  loss {epoch.losses['loss']:.4f}{error}{best}"
            f"  {epoch.minutes:.1f} min"
        )
        if self._bar is not None:
            self._bar.console.print(line)
        else:
            print(line + self._left(epoch), file=sys.stderr, flush=True)
        if self._log is not None:
            self._write(epoch)

    def _left(self, epoch: Epoch) -> str:
        left = epoch.minutes * (self._total / epoch.step - 1.0)
        limit = self._config.train.max_minutes
        if limit is not None:
            left = min(left, limit - epoch.minutes)
        return f", {left:.1f} min left" if left > 0 else ""

    def _write(self, epoch: Epoch) -> None:
        for name, value in epoch.losses.items():
            self._log.add_scalar(
                "loss" if name == "loss" else f"losses/{name}", value, epoch.number
            )
        self._log.add_scalar("learning_rate", epoch.learning_rate, epoch.number)
        if epoch.validation is None:
            return
        unit = self._config.error_unit
        self._log.add_scalar(f"validation_{unit}/mean", epoch.validation.mm, epoch.number)
        for name, value in epoch.validation.actions_mm.items():
            self._log.add_scalar(f"validation_action_{unit}/{name}", value, epoch.number)
        rate = self._config.shape.rate_hz
        for step, value in enumerate(epoch.validation.at_mm, start=1):
            tag = f"validation_horizon_{unit}/{1000 * step / rate:04.0f}_ms"
            self._log.add_scalar(tag, value, epoch.number)
        self._log.flush()

    def close(self) -> None:
        """Close the log."""
        if self._log is not None:
            self._log.close()


@contextmanager
def training_view(config: TrainingConfig) -> Iterator[TrainingView]:
    """A view that is always closed at the end."""
    console = Console(stderr=True)
    bar = None
    if console.is_terminal:
        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[loss]}"),
            console=console,
        )
        bar.start()
    view = TrainingView(config, bar)
    try:
        yield view
    finally:
        if bar is not None:
            bar.stop()
        view.close()


def _log(config: TrainingConfig, step: int) -> Any:
    """A TensorBoard writer into the run's folder, or ``None`` where tensorboard is missing."""
    try:
        from torch.utils.tensorboard import SummaryWriter  # optional: extra `train`
    except ImportError:
        line = "no TensorBoard log; to get one: pip install 'hri-predict[train]'"
        print(for_this_installation(line), file=sys.stderr)
        return None
    # values logged after the checkpoint are logged again
    purge = step // config.train.steps_per_epoch + 1 if step else None
    log = config.out / "log"
    with OsErrorAs(ConfigError, f"{log}: cannot be written", "choose another 'out'"):
        return SummaryWriter(str(log), purge_step=purge)
