"""Progress of a training run: a bar with the time left, or a line per epoch; the log."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.loop import Epoch


class TrainingView:
    """Progress on standard error and a TensorBoard log; see ``loop.View``."""

    def __init__(self, config: TrainingConfig, bar: Progress | None) -> None:
        self._config = config
        self._bar = bar
        self._task: Any = None
        self._log: Any = None
        self._began_step = self._total = 0
        self._began_minutes: float | None = None

    def started(self, step: int, total_steps: int) -> None:
        """Open the log and the bar."""
        self._began_step, self._total = step, total_steps
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
    """A view that is always closed at the end.

    Raises:
        ConfigError: the log cannot be written.
    """
    log = config.out / "log"
    if os.path.exists(log) and not log.is_dir():  # reported before anything is written
        raise ConfigError(
            f"{log}: is a file, but the log needs a folder; remove it, or choose another 'out'"
        )
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
        print("no TensorBoard log; to get one: pip install 'hri-predict[train]'", file=sys.stderr)
        return None
    # values logged after the checkpoint are logged again
    purge = step // config.train.steps_per_epoch + 1 if step else None
    log = config.out / "log"
    with OsErrorAs(ConfigError, f"{log}: cannot be written", "choose another 'out'"):
        return SummaryWriter(str(log), purge_step=purge)
