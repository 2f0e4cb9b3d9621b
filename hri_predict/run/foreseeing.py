"""Forecasts of a recording in batches, ahead of the node, for runs on the virtual clock.

All scenes of a recording are there from the start. A second people stage takes them in ahead of the
node, at the ticks' times, and the predictor forecasts the people of many ticks at once, in a second
thread. A network needs half the time for a person among thirty, and another core has it.
A forecast counts only if the node asks for the very same histories. Otherwise the predictor is
asked again, for example after an Acknowledge made the node forget a person, or a configured fault
lost a scene. So what is foreseen changes the time that a run takes, and nothing else: which
histories share a batch depends on the recording alone.
"""

import queue
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hri_predict.base.errors import failure
from hri_predict.contracts.predictor import Forecast, Predictor, checked
from hri_predict.contracts.source import HasTwin, Source
from hri_predict.people.people import People
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.thread_runner import PredictionRunner
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.ticks import Ticks, ticks_of

BATCH = 32
"""Histories in a batch, at least: more take no less time each."""
_TICKS = 128  # of a batch at most: an empty room must not hold the node up
_WAITING = 2  # batches ahead of the node at most
_PATIENCE_S = 0.1  # between looks whether the run has ended


@dataclass(frozen=True, slots=True)
class _Batch:
    """The ticks until ``until_ns``: time -> what the people stage said, and the forecast for it."""

    until_ns: int
    found: dict[int, tuple[PeopleSnapshot, Forecast]]


class Foreseeing(PredictionRunner):
    """Runs a predictor for a node on the virtual clock, ahead of it where it can.

    Args:
        predictor: the predictor; one that keeps no state between calls.
        ahead: what the node's people stage will say at each tick, in order; see ``foreseen``.
    """

    def __init__(self, predictor: Predictor, ahead: Iterator[PeopleSnapshot]) -> None:
        super().__init__(predictor, None)
        self._ahead = ahead
        self._asking = threading.Lock()  # a predictor need not bear two calls at once
        self._batches: queue.Queue[_Batch | None] = queue.Queue(_WAITING)
        self._batch: _Batch | None = _Batch(-1, {})  # ``None``: there are no more
        self._looking: threading.Thread | None = None
        self._ended = threading.Event()
        self.used = 0

    def stop(self) -> None:
        """End the thread; safe to call twice."""
        self._ended.set()
        if self._looking is not None:
            self._looking.join()

    def _predict(self, snapshot: PeopleSnapshot) -> Forecast | Exception:
        if self._looking is None and not self._ended.is_set():
            self._looking = threading.Thread(target=self._look, name="foreseeing", daemon=True)
            self._looking.start()
        if self._ended.is_set():  # no more batches come
            self._batch = None
        while self._batch is not None and self._batch.until_ns < snapshot.now_ns:
            self._batch = self._batches.get()
        if self._batch is not None and snapshot.now_ns in self._batch.found:
            seen, forecast = self._batch.found[snapshot.now_ns]
            if _same(seen, snapshot):
                self.used += 1
                return forecast
        with self._asking:
            return super()._predict(snapshot)

    def _look(self) -> None:
        """Run the thread: forecast batch after batch, until the recording or the run ends."""
        try:
            while not self._ended.is_set():
                snapshots: list[PeopleSnapshot] = []
                histories = 0
                while histories < BATCH and len(snapshots) < _TICKS:
                    if (snapshot := next(self._ahead, None)) is None:
                        break
                    snapshots.append(snapshot)
                    histories += len(snapshot.ids)
                if not snapshots or not self._hand_over(self._forecast(snapshots)):
                    break
        except BaseException as error:  # the node meets it in its own people stage, and says so
            failure(error)
        finally:  # else the node would wait for the next batch
            self._hand_over(None)

    def _forecast(self, snapshots: list[PeopleSnapshot]) -> _Batch:
        asked = [snapshot for snapshot in snapshots if snapshot.ids]
        found: dict[int, tuple[PeopleSnapshot, Forecast]] = {}
        if asked:
            try:
                history = np.concatenate([each.history for each in asked])
                observed = np.concatenate([each.observed for each in asked])
                with self._asking:
                    whole = self.predictor.predict(history, observed)
                start, whole = 0, checked(whole, len(history), self.predictor)
                for each in asked:
                    own = slice(start, start + len(each.ids))
                    std = None if whole.std is None else whole.std[own]
                    found[each.now_ns] = each, Forecast(whole.positions[own], std)
                    start = own.stop
            except BaseException as error:  # it is asked again, tick by tick
                failure(error)
                found = {}
        return _Batch(snapshots[-1].now_ns, found)

    def _hand_over(self, batch: _Batch | None) -> bool:
        """Whether the node may still take it."""
        while not self._ended.is_set():
            try:
                self._batches.put(batch, timeout=_PATIENCE_S)
                return True
            except queue.Full:
                continue
        return False


def foreseeing(config: Config, source: Source, start_ns: int) -> Foreseeing | None:
    """Return the runner of the configured predictor; ``None`` where looking ahead gains nothing.

    That is a predictor that takes no time, or a source whose scenes are not there yet.

    Raises:
        HriPredictError: the predictor cannot be built; one line with the remedy.
    """
    if not config.predictor.takes_long or not isinstance(source, HasTwin):
        return None
    predictor = assemble.build_predictor(config)
    people = assemble.build_people(config, source, predictor)
    ticks = ticks_of(config.node, source.rate_hz, start_ns)
    return Foreseeing(predictor, foreseen(source.twin(), people, ticks, start_ns))


def foreseen(
    source: Source, people: People, ticks: Ticks, start_ns: int
) -> Iterator[PeopleSnapshot]:
    """Yield what a people stage says at each tick of a run, as ``runtime.step_all`` steps it.

    Args:
        source: a twin of the run's source.
        people: a people stage like the node's.
        ticks: the ticks of a run that starts at ``start_ns``.
        start_ns: start of the run, node's clock.
    """
    now_ns = start_ns
    source.open(start_ns)
    while (source_ns := source.next_ns()) is not None:
        now_ns = max(now_ns, min(source_ns, ticks.due_ns))
        if source_ns <= now_ns:
            while (scene := source.poll(now_ns)) is not None:
                people.receive(scene, now_ns)
                ticks.captured()
            if source.next_ns() == source_ns:  # only a live source has nothing when it is due
                return
        if ticks.due_ns <= now_ns:
            ticks.begin(now_ns)
            yield people.snapshot(now_ns)


def _same(one: PeopleSnapshot, other: PeopleSnapshot) -> bool:
    return (
        one.ids == other.ids
        and np.array_equal(one.observed, other.observed)
        and np.array_equal(one.history, other.history)
    )
