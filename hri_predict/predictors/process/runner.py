"""Runs the predictor in a process of its own; the tick always gets an answer."""

import logging
import math
import threading
import time

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import HriPredictError, PredictorError
from hri_predict.contracts.predictor import Forecast, checked
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.process.description import Description
from hri_predict.predictors.process.remote import Job, Patience, Worker, WorkerEndedError
from hri_predict.protocol.reasons import Reason

log = logging.getLogger(__name__)

# The first start may wait for a cold disk or a network share: the robot does not run yet.
FIRST_START = Patience(limit_s=120.0, idle_s=30.0, cpu_s=math.inf)
# Later ones read what is in memory already. A start that computes or reads may take as long as the
# first; one that does nothing is given up in seconds, however busy the machine is.
IDLE_S = 5.0
CPU_FACTOR, CPU_MORE_S = 3.0, 10.0  # of the first start's time on processors: it spins
HANG_DEADLINES = 50  # a worker that gives no answer for so long is killed
HANG_S = 1.0  # but not sooner than after this time
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.2, 10.0  # before a worker is started anew
LIVED_S = 30.0  # a worker that lived so long counts as sound, and its successor comes at once
END_S = 1.0  # a worker that does not end by itself within this time is killed
_PATIENCE_S = 10.0  # for whoever asks outside the loop


class RemotePredictor:
    """A predictor that computes in the worker; see ``contracts.predictor.Predictor``."""

    def __init__(self, runner: "ProcessRunner", described: Description) -> None:
        self._runner = runner
        self.skeleton = described.skeleton
        self.history_steps = described.history_steps
        self.horizon_steps = described.horizon_steps
        self.rate_hz = described.rate_hz

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Predict in the worker; see ``Predictor.predict``. Must not be called while the loop runs.

        Raises:
            PredictorError: it failed, or took longer than ten seconds.
        """
        forecast = self._runner.ask(history, observed, _PATIENCE_S)
        if forecast is None:
            raise PredictorError(f"no forecast within {_PATIENCE_S:g} s")
        return checked(forecast, len(history), self)


class ProcessRunner:
    """Runs a predictor in another process; otherwise like ``PredictionRunner``.

    A worker that dies or hangs is restarted after a pause, which grows with repeated failures.
    During a restart each tick gets the reason immediately. ``failures`` and ``late`` count since
    the start; ``restarts`` counts the workers after the first. The owner must call ``stop``.
    """

    def __init__(self, job: Job, deadline_s: float) -> None:
        """Start the process; ``wait_until_ready`` returns when it can predict."""
        self.failures = self.late = self.restarts = 0
        self._job = job
        self._deadline_s = deadline_s
        self._hang_s = max(HANG_S, HANG_DEADLINES * deadline_s)
        self._stopping = threading.Event()
        self._ready = threading.Event()
        self._patience = FIRST_START
        self._problem: HriPredictError | None = None  # why the first worker could not begin
        self._described: Description | None = None
        self._started: Worker | None = None  # the process that runs, ready or not
        self._worker: Worker | None = None  # the same once it is ready
        # The worker ends with the thread that started it: this one lives as long as the node.
        self._supervisor = threading.Thread(target=self._supervise, name="predictor", daemon=True)
        self._supervisor.start()

    def wait_until_ready(self) -> None:
        """Wait for the first worker.

        Raises:
            HriPredictError: the predictor cannot be built; one line with the remedy.
        """
        while not self._ready.wait(0.1):  # in parts, so that Ctrl-C gets through
            pass
        if self._problem is not None:
            raise self._problem
        assert self._described is not None
        self.predictor = RemotePredictor(self, self._described)

    @property
    def counters(self) -> dict[str, int]:
        """By name."""
        return {
            "predictor_failures": self.failures,
            "predictor_late": self.late,
            "predictor_restarts": self.restarts,
        }

    def start(self) -> None:
        """Do nothing: the worker is already waiting."""

    def stop(self) -> None:
        """Stop the worker; safe to call twice."""
        self._stopping.set()
        worker = self._started
        if worker is not None:
            worker.end()
        self._supervisor.join(END_S)
        while self._supervisor.is_alive():
            if self._started is not None:
                self._started.kill()
            self._supervisor.join(0.05)

    def run(self, snapshot: PeopleSnapshot) -> tuple[Forecast | None, Reason | None]:
        """Return a forecast for ``snapshot``, or the reason why there is none in this tick."""
        if not snapshot.ids:
            shape = (0, self.predictor.horizon_steps, len(self.predictor.skeleton.joints), 3)
            return Forecast(np.zeros(shape), None), None
        try:
            forecast = self.ask(snapshot.history, snapshot.observed, self._deadline_s)
            if forecast is None:
                self.late += 1
                return None, Reason.PREDICTOR_LATE
            return checked(forecast, len(snapshot.ids), self.predictor), None
        except PredictorError as error:
            if self.failures == 0 or self.failures % 1000 == 0:
                log.error("predictor failed (%d times before): %s", self.failures, error)
            self.failures += 1
            return None, Reason.PREDICTOR_FAILED

    def ask(self, history: Floats, observed: Bools, wait_s: float) -> Forecast | None:
        """Ask the worker for a forecast; ``None``: it did not come within ``wait_s``.

        Raises:
            PredictorError: the predictor failed, or there is no worker at the moment.
        """
        worker = self._worker
        if worker is None:
            raise PredictorError("its process is being restarted")
        try:
            forecast = worker.forecast(history, observed, wait_s)
        except WorkerEndedError:
            self._worker = None
            raise
        if forecast is None and worker.silent_s > self._hang_s:
            self._worker = None
            log.error("predictor: no answer for %.3g s; killing its process", worker.silent_s)
            worker.kill()
        return forecast

    def _supervise(self) -> None:
        pause_s = FIRST_PAUSE_S
        while not self._stopping.is_set():
            began = time.monotonic()
            problem = self._one_life()
            if self._stopping.is_set():
                return
            if not self._ready.is_set():
                self._problem = problem
                self._ready.set()
                return
            pause_s = FIRST_PAUSE_S if time.monotonic() - began > LIVED_S else pause_s
            log.error("predictor: %s; it is restarted in %.1f s", problem, pause_s)
            self._stopping.wait(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)
            self.restarts += 1

    def _one_life(self) -> HriPredictError:
        """Run a worker until it ends, and return the reason."""
        try:
            worker = Worker(self._job)
        except (OSError, AttributeError) as error:
            return PredictorError(
                f"the predictor's own process cannot be started: {error}; set "
                f"predictor.process to false"
            )
        self._started = worker
        if self._stopping.is_set():  # ``stop`` may have looked before
            worker.end()
        try:
            began = time.monotonic()
            described = worker.begin(self._patience)
            if self._described is None:
                self._described = described
                cpu_s = CPU_FACTOR * worker.start_cpu_s + CPU_MORE_S
                self._patience = Patience(limit_s=FIRST_START.limit_s, idle_s=IDLE_S, cpu_s=cpu_s)
            if not described.is_like(self._described):
                raise PredictorError("its files have changed since the start; restart the node")
            self._worker = worker
            if self._ready.is_set():
                log.warning(
                    "predictor: its new process is ready after %.1f s; forecasts resume",
                    time.monotonic() - began,
                )
            self._ready.set()
            status = worker.wait()
            return PredictorError(f"its process exited with {_said(status)}")
        except HriPredictError as error:
            return error
        except Exception as error:  # without an end of this life nobody would know of it
            log.exception("predictor: the supervision of its process failed")
            return PredictorError(f"its process could not be supervised: {error!r}")
        finally:
            self._worker = None
            worker.kill()
            worker.wait()
            self._started = None


def _said(status: int) -> str:
    return f"signal {-status}" if status < 0 else f"status {status}"
