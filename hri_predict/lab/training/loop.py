"""The training loop: draws batches, takes steps, validates, keeps the best weights, resumes."""

import hashlib
import json
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch
from torch import Tensor

from hri_predict.base.errors import ConfigError, HriPredictError
from hri_predict.lab.training.checkpoint import check_folder, load_checkpoint, save_checkpoint
from hri_predict.lab.training.code import codes_of, refuse_other_code
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.optimisation import Optimisation, learning_rate_factor
from hri_predict.lab.training.processes import Processes
from hri_predict.lab.training.progress import (
    Finished,
    Progress,
    demand_best_weights,
    digest_of,
    finished,
    read_progress,
)
from hri_predict.lab.training.teachers import Teachers
from hri_predict.lab.training.validation import Validation, validate
from hri_predict.lab.training.windows.samples import SampleSource
from hri_predict.predictors.neural.network import Network
from hri_predict.predictors.neural.weights import save_weights

# -- origin of a set of weights: code and data -----------------------------------------------------


def fingerprint(source: SampleSource) -> str:
    """SHA-256 of the rest pose, one training batch and all validation windows."""
    digest = hashlib.sha256(" ".join(source.actions).encode())

    def add(*tensors: Tensor) -> None:
        for tensor in tensors:
            digest.update(tensor.contiguous().numpy().tobytes())

    add(source.rest())
    for samples in chain([source.batch(np.random.default_rng(0), 64)], source.validation()):
        add(samples.history, samples.observed, samples.future, samples.known)
    return digest.hexdigest()


def commit() -> str | None:
    """The checkout's commit, marked if files differ; ``None`` for an installed package."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    here = Path(__file__).resolve().parent
    try:
        done = subprocess.run(command, cwd=here, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None


# --------------------------------------------------------------------------------------------------

Ending = Finished | Literal["interrupted"]
_MAY_CHANGE = ("out", "initial_weights")  # between a run and its resumption
_MAY_CHANGE_TRAIN = ("stop_after", "patience", "max_minutes", "checkpoint_minutes", "threads")


@dataclass(frozen=True, slots=True, kw_only=True)
class Epoch:
    """Results of an epoch, or of a part of it if the run ended within it."""

    number: int  # from 1
    step: int  # steps taken since the run began
    losses: dict[str, float]  # means over its steps, by name; ``loss`` is their sum
    validation: Validation | None
    best: bool
    learning_rate: float
    minutes: float  # since the run began, without interruptions


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Results of a run."""

    ending: Ending
    epochs: int
    steps: int
    best_epoch: int
    validation: dict[str, Any] | None
    minutes: float
    weights: Path

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"weights": str(self.weights)}


class RunObserver(Protocol):
    """An observer of a run."""

    def started(self, step: int, total_steps: int) -> None:
        """Training starts or continues at ``step``."""

    def stepped(self, step: int, loss: float) -> None:
        """``step`` steps have been taken."""

    def ended_epoch(self, epoch: Epoch) -> None:
        """An epoch is over."""


class Run:
    """Trains ``network`` on ``source`` as ``config`` says, into the folder ``config.out``.

    The same configuration, data, processes and threads on the same machine give the same bytes,
    whether the run was interrupted or not.

    Args:
        config: the run's settings.
        source: training and validation windows.
        network: fresh, from ``build_network``.
        view: observes the run, in the first process alone.
        stop: called after each step; true ends the run with a checkpoint.
        processes: the processes that share the run; default: this one alone.
        command: the command line that started it, for the card.

    Raises:
        ConfigError: the batch is smaller than the number of processes, or the device is missing.
    """

    def __init__(
        self,
        config: TrainingConfig,
        source: SampleSource,
        network: Network,
        view: RunObserver,
        *,
        stop: Callable[[], bool] = lambda: False,
        processes: Processes | None = None,
        command: str | None = None,
    ) -> None:
        processes = processes or Processes()
        self.command = command
        if config.train.batch < processes.count:
            raise ConfigError(f"train.batch {config.train.batch}: less than one per process")
        torch.set_num_threads(config.train.threads)
        self.config, self.source, self.view, self.stop = config, source, view, stop
        self.settings, self.processes = config.train, processes
        # windows enter their frames on the CPU, wherever the network is
        self.entry = Network(source.shape)
        self.entry.rest.copy_(network.rest)
        self.teachers = Teachers(config.train.teachers, config.train.taught, network.shape)
        self.optimisation = Optimisation(network.to(_device(config)), config.train, processes)
        self.rng = np.random.default_rng(config.train.seed)
        torch.manual_seed(config.train.seed + processes.rank)  # dropout differs between processes
        self.progress = Progress()
        self.fingerprint = fingerprint(source)
        self.code = codes_of(config)
        self.commit = commit()  # read now: somebody may commit during the run
        self.weights = config.out / f"{config.predictor}.safetensors"
        self._clock = self._saved = time.monotonic()

    def go(self, resume: bool = False) -> Result:
        """Run until one of the endings; ``resume``: from the checkpoint in ``config.out``.

        Raises:
            ConfigError: the folder already holds a run, or no matching run to resume; or the disk
                is full.
            PredictorError: the loss is not finite.
        """
        if resume:
            self._resume()
        else:
            check_folder(self.config.out, resume)
        self.processes.every(torch.zeros(1))  # no process writes before all have checked
        progress, settings = self.progress, self.settings
        if self.processes.rank == 0:
            self.view.started(progress.step, settings.last_step)
        ending = self._ending(False)
        while ending is None:
            interrupted = self._step()
            at_end = progress.step % settings.steps_per_epoch == 0
            if at_end:
                self._end_epoch()
            ending = self._ending(interrupted)
            if not at_end and ending == "out of time":
                self._end_epoch()
            # first after one step: before it there is nothing to resume
            due = ending is not None or progress.step == 1 or self._save_is_due()
            if not at_end and due:
                self._save()
        return self._result(ending)

    @property
    def _done(self) -> float:
        """Completed share of the schedule."""
        progress = self.progress
        return min(progress.step / (progress.total_steps or self.settings.total_steps), 1.0)

    def _foresee(self) -> None:
        """Shorten the schedule to ``max_minutes`` if its epochs would take longer.

        Checked only after an epoch; a run with time for all epochs depends on its steps alone.
        """
        limit, progress = self.settings.max_minutes, self.progress
        if limit is not None:
            possible = progress.step * 60.0 * limit / max(progress.seconds, 1e-9)
            total = max(min(possible, self.settings.total_steps), progress.step)
            of_first = torch.tensor([total], dtype=torch.float64)
            self.processes.same([of_first])
            progress.total_steps = float(of_first)

    def _ending(self, interrupted: bool) -> Ending | None:
        return finished(self.progress, self.settings) or ("interrupted" if interrupted else None)

    def _step(self) -> bool:
        """Take one step; returns whether any process was asked to stop."""
        batch = self.source.batch(self.rng, self.settings.batch)
        mine, share = self.processes.share(batch)
        window, target = mine.entered(self.entry)
        target = self.teachers.teach(window, target)
        device = self.optimisation.network.rest.device
        progress = self.progress
        losses = self.optimisation.step(
            window.to(device), target.to(device), share, progress.step, progress=self._done
        )
        progress.step += 1
        for name, loss in losses.items():
            progress.losses[name] = progress.losses.get(name, 0.0) + loss
        now = time.monotonic()
        progress.seconds += now - self._clock
        self._clock = now
        if self.processes.rank == 0:
            self.view.stepped(progress.step, losses["loss"])
        # all processes must end at the same step: any one's stop counts, and their mean time
        common = torch.tensor([float(self.stop()), progress.seconds], dtype=torch.float64)
        self.processes.add([common])
        progress.seconds = float(common[1]) / self.processes.count
        return bool(common[0] > 0)

    def _end_epoch(self) -> None:
        """Validate, keep the best weights, save, and notify the view."""
        progress, per_epoch = self.progress, self.settings.steps_per_epoch
        number = -(-progress.step // per_epoch)
        steps = progress.step - (number - 1) * per_epoch
        rate = self.settings.learning_rate * learning_rate_factor(
            progress.step - 1, self.settings, self._done
        )
        network = self.optimisation.settle()
        validation = validate(network, self.entry, self.source, self.processes)
        losses = {name: total / steps for name, total in progress.losses.items()}
        # without validation windows (a refit on everything) the newest weights are the best
        best = validation is None or validation.mm < progress.best_mm
        if best:
            progress.best_mm = float("inf") if validation is None else validation.mm
            progress.best = None if validation is None else validation.as_dict()
            progress.best_epoch = number
            self._export(network)
        if steps == per_epoch:
            progress.stale = 0 if best else progress.stale + 1
            progress.losses = {}
            self._foresee()
        self._save()
        if self.processes.rank == 0:
            minutes = progress.seconds / 60.0
            self.view.ended_epoch(
                Epoch(
                    number=number,
                    step=progress.step,
                    losses=losses,
                    validation=validation,
                    best=best,
                    learning_rate=rate,
                    minutes=minutes,
                )
            )

    def _export(self, network: Network) -> None:
        if self.processes.rank == 0:
            card = {
                "config": self.config.model_dump(mode="json"),
                "data_fingerprint": self.fingerprint,
                "commit": self.commit,
                "command": self.command,
                "minutes": round(self.progress.seconds / 60.0, 1),
                "epoch": self.progress.best_epoch,
                "steps": self.progress.step,
                "validation": self.progress.best,
            }
            save_weights(self.weights, self.config.predictor, network, card)
            self.progress.weights = digest_of(self.weights)

    def _save_is_due(self) -> bool:
        due = time.monotonic() - self._saved >= 60.0 * self.settings.checkpoint_minutes
        flag = torch.tensor([float(due)])
        self.processes.same([flag])
        return bool(flag[0] > 0)

    def _save(self) -> None:
        cuda = self.settings.device == "cuda"
        state = {
            "config": self.config.model_dump_json(),
            "data_fingerprint": self.fingerprint,
            "code": json.dumps(self.code),
            "progress": json.dumps(self.progress.model_dump()),
            "optimisation": self.optimisation.state(),
            "numpy": json.dumps(self.rng.bit_generator.state),
            "torch": self.processes.every(torch.get_rng_state()),
            "cuda": torch.cuda.get_rng_state() if cuda else None,
        }
        if self.processes.rank == 0:
            save_checkpoint(self.config.out / "last.pt", state)
        self._saved = time.monotonic()

    def _resume(self) -> None:
        path = self.config.out / "last.pt"
        state = load_checkpoint(path)
        try:
            was = TrainingConfig.model_validate_json(state["config"])
            self._refuse_another(path, was, state["data_fingerprint"])
            refuse_other_code(path, json.loads(state.get("code", "null")), self.code)
            self.progress = read_progress(path, state, self.settings)
            demand_best_weights(self.weights, self.progress)
            self.optimisation.restore(state["optimisation"], self.progress.step)
            self.rng.bit_generator.state = json.loads(state["numpy"])
            if self.settings.device == "cuda":
                torch.cuda.set_rng_state(state["cuda"])
            self._refuse_another_count(path, len(state["torch"]))
            torch.set_rng_state(state["torch"][self.processes.rank])
        except HriPredictError:
            raise
        except Exception as error:  # torch's and numpy's failures have no common base
            raise ConfigError(
                f"checkpoint {path}: has another network or version, or is damaged; "
                "start a new run with another --out"
            ) from error

    def _refuse_another(self, path: Path, was: TrainingConfig, fingerprint: str) -> None:
        old, new = (c.model_dump(exclude=set(_MAY_CHANGE)) for c in (was, self.config))
        for one in (old, new):
            one["data"].pop("root", None)  # the fingerprint tells whether the data is the same
            one["train"] = {k: v for k, v in one["train"].items() if k not in _MAY_CHANGE_TRAIN}
        for key in new:
            if old[key] != new[key]:
                raise ConfigError(
                    f"checkpoint {path}: was trained with {_difference(key, old[key], new[key])}; "
                    f"restore that, or start another run with --out"
                )
        if fingerprint != self.fingerprint:
            raise ConfigError(
                f"checkpoint {path}: was trained on other data; give the same data, or start "
                f"another run with --out"
            )

    def _refuse_another_count(self, path: Path, was: int) -> None:
        """Each process goes on with its own random numbers; with other counts some would be lost.

        ``was``: the number of random states in the checkpoint; 0 if it is damaged.
        """
        if was and was != self.processes.count:
            torchrun = f"torchrun --nproc-per-node {was} -m hri_predict"
            start = f"with {torchrun}" if was > 1 else "without torchrun"
            raise ConfigError(
                f"checkpoint {path}: its run had {was} process{'es' * (was > 1)}, not "
                f"{self.processes.count}; start it {start}, or start another run with --out"
            )

    def _result(self, ending: Ending) -> Result:
        progress = self.progress
        return Result(
            ending=ending,
            epochs=progress.step // self.settings.steps_per_epoch,
            steps=progress.step,
            best_epoch=progress.best_epoch,
            validation=progress.best,
            minutes=progress.seconds / 60.0,
            weights=self.weights,
        )


def _device(config: TrainingConfig) -> torch.device:
    if config.train.device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("train.device cuda: this machine has none; use cpu")
    return torch.device(config.train.device)


def _difference(key: str, old: Any, new: Any) -> str:
    """The first key within ``key`` whose value changed, and both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        for inner in sorted(old.keys() | new.keys()):
            if old.get(inner) != new.get(inner):
                return _difference(f"{key}.{inner}", old.get(inner), new.get(inner))
    return f"{key} {old}, not {new}"
