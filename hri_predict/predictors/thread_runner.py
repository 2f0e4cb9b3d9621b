"""Runs the predictor within its deadline; the tick always gets an answer."""

import logging
import threading
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from hri_predict.base.errors import PredictorError, failure
from hri_predict.contracts.predictor import Forecast, Predictor, checked
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.reasons import Reason

log = logging.getLogger(__name__)


class Prediction(Protocol):
    """Runs a predictor for the node.

    Attributes:
        predictor: available once it is ready.
        counters: numbers of failed, late, ... predictions since the start.
    """

    @property
    def predictor(self) -> Predictor:
        """The predictor."""

    @property
    def counters(self) -> Mapping[str, int]:
        """By name."""

    def wait_until_ready(self) -> None:
        """Wait until it can predict.

        Raises:
            HriPredictError: the predictor cannot be built; one line with the remedy.
        """

    def start(self) -> None:
        """Start the predictor; called before the first tick."""

    def stop(self) -> None:
        """Stop the predictor; safe to call twice."""

    def run(self, snapshot: PeopleSnapshot) -> tuple[Forecast | None, Reason | None]:
        """Return a forecast for ``snapshot``, or the reason why there is none in this tick."""


class PredictionRunner:
    """Calls a predictor; a failed, late or NaN prediction becomes a reason instead.

    With a deadline the predictor runs in its own thread, so that a predictor that hangs delays no
    tick; a late answer is discarded. Without a deadline (virtual time) it runs in place.

    ``failures`` and ``late`` count since start.
    """

    def __init__(self, predictor: Predictor, deadline_s: float | None) -> None:
        self.predictor = predictor
        self._deadline_s = deadline_s
        self.failures = self.late = 0
        self._wanted = threading.Event()
        self._done = threading.Event()
        self._busy = False
        self._stopping = False
        self._snapshot: PeopleSnapshot | None = None
        self._result: Forecast | Exception | None = None
        self._thread: threading.Thread | None = None

    @property
    def counters(self) -> dict[str, int]:
        """By name."""
        return {"predictor_failures": self.failures, "predictor_late": self.late}

    def wait_until_ready(self) -> None:
        """Return immediately: the predictor is ready once built."""

    def start(self) -> None:
        """Start the thread, if there is a deadline."""
        if self._deadline_s is not None:
            self._thread = threading.Thread(target=self._work, name="predictor", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Stop the thread, unless it is stuck in the predictor."""
        self._stopping = True
        self._wanted.set()
        if self._thread is not None:
            self._thread.join(timeout=0.5)

    def run(self, snapshot: PeopleSnapshot) -> tuple[Forecast | None, Reason | None]:
        """Return a forecast for ``snapshot``, or the reason why there is none in this tick."""
        if self._thread is None:
            result = self._predict(snapshot)
        else:
            if self._busy and not self._done.is_set():
                self.late += 1
                return None, Reason.PREDICTOR_LATE
            self._busy = True
            self._snapshot = snapshot
            self._done.clear()
            self._wanted.set()
            if not self._done.wait(self._deadline_s):
                self.late += 1
                return None, Reason.PREDICTOR_LATE
            self._busy = False
            assert self._result is not None
            result = self._result
        if isinstance(result, Exception):
            if self.failures == 0 or self.failures % 1000 == 0:
                log.error("predictor failed (%d times before): %s", self.failures, result)
            self.failures += 1
            return None, Reason.PREDICTOR_FAILED
        return result, None

    def _predict(self, snapshot: PeopleSnapshot) -> Forecast | Exception:
        try:
            if not snapshot.ids:
                shape = (0, self.predictor.horizon_steps, len(self.predictor.skeleton.joints), 3)
                return Forecast(np.zeros(shape), None)
            forecast = self.predictor.predict(snapshot.history, snapshot.observed)
            return checked(forecast, len(snapshot.ids), self.predictor)
        except PredictorError as error:
            return error
        except BaseException as error:  # a third party's predictor must not end the node
            failure(error)
            return PredictorError(f"{type(error).__name__}: {error}")

    def _work(self) -> None:
        while True:
            self._wanted.wait()
            self._wanted.clear()
            if self._stopping:
                return
            assert self._snapshot is not None
            self._result = self._predict(self._snapshot)
            self._done.set()
