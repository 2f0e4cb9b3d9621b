"""Reaction time measured by echo: each Advice repeats the counter of the newest RobotState.

The controller measures the time from sending a state to receiving its echo. The node measures the
time between reading the state from the wire and writing its echo. The difference is the delay of
the link in both directions; the delay budget assumes ``delay_s`` for each. The node cannot measure
the wire alone: without the controller's figures this test stays open.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hri_predict.base.clock import Clock
from hri_predict.commissioning.bench import bench
from hri_predict.commissioning.report import Echo, LinkEcho, Times
from hri_predict.contracts import registry
from hri_predict.contracts.link import Transport
from hri_predict.protocol.messages import Advice, RobotState
from hri_predict.run.config import Config

LEAST_ECHOES = 20
"""Minimum number of echoes for a statement about the worst case."""
SETTLE_S = 1.0
"""Initial time that is ignored, because both sides are still starting."""
MOST_MS = 2000
"""Longer times share the last bin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredElsewhere:
    """Round trips measured by the controller's programmer, in milliseconds."""

    p50_ms: float
    p99_ms: float
    max_ms: float


@dataclass(slots=True)
class Tap:
    """A wire that records the time of each read and write, and otherwise acts as the inner wire."""

    inner: Transport[Any]
    clock: Clock
    read_units: list[tuple[int, Any]] = field(default_factory=list)
    written: list[tuple[int, Any]] = field(default_factory=list)

    def open(self) -> None:
        """See ``Transport``."""
        self.inner.open()

    def write(self, unit: Any) -> None:
        """Write, and record the start time: time spent in the device belongs to the link."""
        now_ns = self.clock.now_ns()
        self.inner.write(unit)
        self.written.append((now_ns, unit))

    def read(self, timeout_s: float) -> list[Any]:
        """Read, and record the time of arrival."""
        units = self.inner.read(timeout_s)
        now_ns = self.clock.now_ns()
        self.read_units += [(now_ns, unit) for unit in units]
        return units

    def close(self) -> None:
        """See ``Transport``."""
        self.inner.close()

    def __getattr__(self, name: str) -> Any:
        """Return a member that this kind of wire has in addition to those of ``Transport``."""
        return getattr(self.inner, name)


def measure_echo(
    config: Config, seconds: float, clock: Clock, elsewhere: Mapping[str, MeasuredElsewhere]
) -> Echo:
    """Run the node in shadow mode (no robot may move) and measure each link.

    Args:
        config: the configuration; mock controllers report each round trip.
        seconds: duration.
        clock: the node's.
        elsewhere: link's name -> round trips measured by its controller's programmer.

    Raises:
        HriPredictError: a link or a controller cannot be started.
    """
    taps: dict[str, Tap] = {}

    def tapped(name: str, wire: Transport[Any]) -> Tap:
        taps[name] = Tap(wire, clock)
        return taps[name]

    with bench(_asking(config), clock, tapped) as end:
        end.run(seconds=SETTLE_S + seconds, listeners=(), shadow=True)
        reports = {report.name: report.round_trips for report in end.reports()}
    links = [
        _of_link(
            config,
            i,
            taps[link.name],
            round_trips=reports.get(link.name),
            elsewhere=elsewhere.get(link.name),
        )
        for i, link in enumerate(config.links)
        if link.advises
    ]
    return Echo(seconds=seconds, links=links)


def judge_echo(echo: Echo) -> tuple[list[str], list[str]]:
    """Return failures and checks without a result, one line each."""
    failed, missing = [], []
    for link in echo.links:
        if not link.states:
            missing.append(f"link {link.link}: no RobotState arrived, so there was nothing to echo")
        elif not link.echoes:
            missing.append(f"link {link.link}: no advice repeated a RobotState; measure for longer")
        elif link.both_ways_ms is None:
            missing.append(
                f"link {link.link}: only its controller can measure the round trip; supply its "
                f"figures (echo.measured.{link.link})"
            )
        elif link.measured_by == "controller" and link.echoes < LEAST_ECHOES:
            missing.append(f"link {link.link}: only {link.echoes} echoes; measure for longer")
        if link.both_ways_ms is not None and link.both_ways_ms > link.allowed_ms:
            failed.append(
                f"link {link.link}: {link.both_ways_ms:.1f} ms on the link in both directions; the "
                f"delay budget allows {link.allowed_ms:.1f} (twice delay_s and what blocks the "
                f"wire): raise delay_s to {link.both_ways_ms / 2e3:.4f}, or find the cause"
            )
    if not echo.links:
        missing.append("the cell has no link")
    return failed, missing


def times(values_ms: Sequence[float]) -> Times | None:
    """Return the distribution of these times in milliseconds; ``None`` without any."""
    if not values_ms:
        return None
    array = np.asarray(values_ms)
    whole = np.clip(array, 0, MOST_MS).astype(int)
    return Times(
        count=len(values_ms),
        p50_ms=round(float(np.percentile(array, 50)), 3),
        p99_ms=round(float(np.percentile(array, 99)), 3),
        max_ms=round(float(array.max()), 3),
        bins=np.bincount(whole).tolist(),
    )


def _asking(config: Config) -> Config:
    """The configuration, with mock controllers that report each round trip."""
    links = tuple(
        link
        if link.simulate is None
        else link.model_copy(update={"simulate": {**link.simulate, "keep_round_trips": True}})
        for link in config.links
    )
    return replace(config, links=links)


def _of_link(
    config: Config,
    index: int,
    tap: Tap,
    *,
    round_trips: Sequence[tuple[int, float]] | None,
    elsewhere: MeasuredElsewhere | None,
) -> LinkEcho:
    """Compare what the wire carried with what the controller measured."""
    settings = config.links[index]
    cls, own = registry.load("links", settings.kind), settings.resolved(config.base_dir)
    first_ns = min((at_ns for at_ns, _ in tap.written), default=0)
    from_ns = first_ns + round(SETTLE_S * 1e9)
    came = {
        (state.robot, state.counter): at_ns
        for at_ns, state in _decoded(cls.receiver(own), tap.read_units)
        if isinstance(state, RobotState)
    }
    waited: dict[int, list[float]] = {}
    for at_ns, advice in _decoded(cls.receiver(own), tap.written):
        if not isinstance(advice, Advice) or advice.echo is None or at_ns < from_ns:
            continue
        came_ns = came.get((advice.robot, advice.echo))
        if came_ns is not None:
            waited.setdefault(advice.echo, []).append(max(0.0, (at_ns - came_ns) * 1e-6))
    in_node = times([each for several in waited.values() for each in several])
    trip, both, by = None, None, None
    if elsewhere is not None:
        trip = Times(
            count=0, p50_ms=elsewhere.p50_ms, p99_ms=elsewhere.p99_ms, max_ms=elsewhere.max_ms
        )
        # a controller times the first echo. Its longest trip is not the one that waited longest in
        # the node, so no more than the usual wait is subtracted.
        in_node = times([min(several) for several in waited.values()])
        if in_node is not None:
            both, by = max(0.0, elsewhere.max_ms - in_node.p50_ms), "integrator"
    elif round_trips:
        # what was echoed while both sides were starting is left out
        heard = [(n, 1e3 * seconds) for n, seconds in round_trips if n in waited]
        trip = times([each_ms for _, each_ms in heard])
        if heard:
            both, by = max(0.0, *_on_link(heard, waited)), "controller"
    return LinkEcho.model_validate(
        {
            "link": settings.name,
            "states": len(came),
            "echoes": len(waited),
            "in_node": in_node,
            "round_trip": trip,
            "measured_by": by,
            "both_ways_ms": None if both is None else round(both, 3),
            "allowed_ms": round(2e3 * (settings.delay_s + settings.blocking_s), 3),
        }
    )


def _on_link(
    heard: Iterable[tuple[int, float]], waited: Mapping[int, Sequence[float]]
) -> Iterable[float]:
    """Return each round trip less the time in the node, in milliseconds.

    Several Advice messages may echo one state. They arrive in order; if one was lost, it is unknown
    which, so the shortest wait is used.
    """
    trips: dict[int, list[float]] = {}
    for counter, trip_ms in heard:
        trips.setdefault(counter, []).append(trip_ms)
    for counter, several in trips.items():
        waits = waited[counter]
        whole = len(waits) == len(several)
        yield from (trip - (waits[i] if whole else min(waits)) for i, trip in enumerate(several))


def _decoded(receiver: Any, units: Iterable[tuple[int, Any]]) -> Iterable[tuple[int, Any]]:
    for at_ns, unit in units:
        for message in receiver.feed(unit):
            yield at_ns, message
