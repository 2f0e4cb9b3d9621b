"""Tracked people, tick by tick: computed once, then moved to each distance.

Forecasts and zones do not depend on robots or on a person's position on the floor: the stages are
equivariant under rotations about z and translations on the floor. So a person passes through the
real stages once, and the result is moved to each distance.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules, transform
from hri_predict.contracts.predictor import Forecast, Predictor
from hri_predict.contracts.source import Source
from hri_predict.people.people import People
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.thread_runner import PredictionRunner
from hri_predict.protocol.reasons import Reason
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.run.ticks import Ticks, ticks_of
from hri_predict.zones.body_zones import BodyZones

BATCH = 16
"""Most people forecast at once: as many as the networks are warmed up for. ``average`` takes 6.2 ms
of a core per person, 10.5 one at a time, and no less in larger batches."""


@dataclass(frozen=True, eq=False)
class Seen:
    """K ticks of people and their forecasts.

    Attributes:
        snapshots: (K) tracked people.
        forecasts: (K); ``None`` without a forecast.
        reasons: (K) why there is no forecast; empty if there is one.
    """

    snapshots: list[PeopleSnapshot] = field(default_factory=list)
    forecasts: list[Forecast | None] = field(default_factory=list)
    reasons: list[tuple[Reason, ...]] = field(default_factory=list)

    def ticks(self) -> Iterator[tuple[PeopleSnapshot, Forecast | None, tuple[Reason, ...]]]:
        """The arguments of ``RiskEngine.zones``, tick by tick."""
        return zip(self.snapshots, self.forecasts, self.reasons, strict=True)


def watch(
    config: Config, source: Source, predictor: Predictor, seconds: float | None = None
) -> Seen:
    """Run people and predictor over the scenes of a source, as the node would.

    No robot acts on the people, so all are known before the first forecast, and many ticks are
    forecast at once. ``seconds``: duration; ``None``: until the source's end.
    """
    people = assemble.build_people(config, source, predictor)
    runner = PredictionRunner(predictor, deadline_s=None)
    found = Seen()
    ticks = ticks_of(config.node, source.rate_hz, VIRTUAL_START_NS)
    for tick_ns in _ticks(source, people, ticks):
        if seconds is not None and tick_ns - VIRTUAL_START_NS > seconds * 1e9:
            break
        found.snapshots.append(people.snapshot(tick_ns))
    for batch in _batches(found.snapshots):
        for forecast, reason in _predicted(runner, batch):
            found.forecasts.append(forecast)
            found.reasons.append(() if reason is None else (reason,))
    return found


def _batches(snapshots: Sequence[PeopleSnapshot]) -> Iterator[list[PeopleSnapshot]]:
    """Yield consecutive ticks with at most ``BATCH`` people together, or a single tick."""
    batch: list[PeopleSnapshot] = []
    for snapshot in snapshots:
        if batch and sum(len(each.ids) for each in (*batch, snapshot)) > BATCH:
            yield batch
            batch = []
        batch.append(snapshot)
    if batch:
        yield batch


def _predicted(
    runner: PredictionRunner, batch: Sequence[PeopleSnapshot]
) -> list[tuple[Forecast | None, Reason | None]]:
    """Return what ``runner`` gives for each of these ticks."""
    together = replace(
        batch[0],
        ids=tuple(i for each in batch for i in each.ids),
        history=np.concatenate([each.history for each in batch]),
        observed=np.concatenate([each.observed for each in batch]),
    )
    forecast, _ = runner.run(together)
    if forecast is None:  # perhaps because of one window: the others have forecasts
        return [runner.run(each) for each in batch]
    ends = np.cumsum([len(each.ids) for each in batch])[:-1]
    positions = np.split(forecast.positions, ends)
    stds = [None] * len(batch) if forecast.std is None else np.split(forecast.std, ends)
    return [(Forecast(*each), None) for each in zip(positions, stds, strict=True)]


def _ticks(source: Source, people: People, ticks: Ticks) -> Iterator[int]:
    """Yield the ticks up to the last scene; as in the node's loop, arrived scenes are processed
    first.
    """
    source.open(VIRTUAL_START_NS)
    now_ns = VIRTUAL_START_NS
    while (due_ns := source.next_ns()) is not None:
        if due_ns > ticks.due_ns:
            now_ns = max(now_ns, ticks.due_ns)
            ticks.begin(now_ns)
            yield now_ns
            continue
        scene = source.poll(due_ns)
        assert scene is not None
        now_ns = due_ns
        people.receive(scene, due_ns)
        ticks.captured()
        if ticks.due_ns <= now_ns and source.next_ns() is None:
            yield now_ns


def moved_zones(bodies: BodyZones, matrix: Floats, person: int = 0) -> BodyZones:
    """Return the zones after a rigid motion (4, 4), with ``person`` added to every id."""
    zones = bodies.zones
    capsules = _moved_capsules(zones.capsules, matrix)
    same = bodies.paths is zones.capsules
    return replace(
        bodies,
        zones=replace(zones, ids=tuple(i + person for i in zones.ids), capsules=capsules),
        paths=capsules if same else _moved_capsules(bodies.paths, matrix),
        toward=None if bodies.toward is None else bodies.toward.moved(matrix),
    )


def _moved_capsules(capsules: Capsules, matrix: Floats) -> Capsules:
    return Capsules(transform(matrix, capsules.a), transform(matrix, capsules.b), capsules.radius)


def shifted_zones(bodies: BodyZones, by_m: Floats) -> BodyZones:
    """Return the zones moved by (3,) metres; faster than ``moved_zones``."""
    zones = bodies.zones
    capsules, toward = _shifted(zones.capsules, by_m), bodies.toward
    if toward is not None:
        toward = toward._replace(mid=toward.mid + by_m, path=toward.path + by_m)
    same = bodies.paths is zones.capsules
    return replace(
        bodies,
        zones=replace(zones, capsules=capsules),
        paths=capsules if same else _shifted(bodies.paths, by_m),
        toward=toward,
    )


def _shifted(capsules: Capsules, by_m: Floats) -> Capsules:
    return Capsules(capsules.a + by_m, capsules.b + by_m, capsules.radius)
