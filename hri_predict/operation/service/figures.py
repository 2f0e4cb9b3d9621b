"""Metrics of the node: results of the newest tick, and counters.

The loop's thread only stores the newest tick and, once a second, the counters; the server's thread
builds the metrics from them. If the loop has stopped, its values no longer describe the room: the
level is then *unknown*, whatever the last tick reported.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import accumulate
from typing import Any

from hri_predict.contracts.link import Link
from hri_predict.contracts.source import live_part
from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.node import Node
from hri_predict.operation.monitoring.pace import TICK_BOUNDS_S, Pace
from hri_predict.operation.service.exposition import Family, Sample
from hri_predict.protocol.messages import Advice, Level, NodeState

COUNT_S = 1.0
"""Interval at which the counters are read."""


class Figures(Listener):
    """Metrics and health of one run.

    Args:
        node, source, links, pace: the parts that have counters.
        robots: names of the robots.
        version: version of hri-predict.
        healthy_s: maximum age of the last tick of a healthy loop, seconds.
        others: returns the counters of further parts; called once a second in the loop's thread.
        monotonic_s: the machine's monotonic clock.
    """

    def __init__(
        self,
        *,
        node: Node,
        source: object,
        links: Sequence[Link],
        pace: Pace,
        robots: Sequence[str],
        version: str,
        healthy_s: float,
        others: Callable[[], Mapping[str, int]],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node, self._source, self._links, self._pace = node, source, links, pace
        self._robots, self._version, self._others = robots, version, others
        self._monotonic_s = monotonic_s
        self.healthy_s = healthy_s
        self._newest: tuple[Tick, float] | None = None  # replaced as a whole: two threads use it
        self._events: Mapping[str, int] = {}
        self._counted_s: float | None = None

    def on_tick(self, tick: Tick) -> None:
        """Store a tick."""
        now_s = self._monotonic_s()
        self._newest = (tick, now_s)
        if self._counted_s is None or now_s - self._counted_s >= COUNT_S:
            self._counted_s = now_s
            people = tick.snapshot.counters if tick.snapshot is not None else {}
            own = {
                "assess_failures": self._node.assess_failures,
                "listener_failures": self._node.listener_failures,
                "acknowledges": self._node.acknowledges,
                "acknowledges_refused": self._node.acknowledges_refused,
                "load_sheds": self._node.shedding.sheds,
                "strange_states": self._node.strange_states,
                "source_failures": self._pace.source_failures,
            }
            for why, count in self._node.acknowledges_not_counted.items():
                own[f"acknowledges_{why}"] = count
            self._events = {**self._node.robot_counters, **people, **self._others(), **own}

    def health(self) -> tuple[bool, dict[str, Any]]:
        """Return whether the loop is running, and details as JSON-compatible data."""
        if self._newest is None:
            return False, {"ok": False, "why": "no tick yet"}
        tick, at_s = self._newest
        age_s = max(self._monotonic_s() - at_s, 0.0)
        is_well = age_s <= self.healthy_s and tick.status.node_state is not NodeState.STOPPING
        levels = {self._robots[a.robot]: a.level.name.lower() for a in tick.advices}
        return is_well, {
            "ok": is_well,
            "node_state": tick.status.node_state.name.lower(),
            "reason": tick.status.reason.name.lower(),
            "last_tick_age_s": round(age_s, 3),
            "within_s": self.healthy_s,
            "levels": levels if is_well else dict.fromkeys(levels, "unknown"),
            "version": self._version,
        }

    def families(self) -> Iterator[Family]:
        """Return all metrics with their current values."""
        yield _gauge("hri_build_info", "The running version.", [({"version": self._version}, 1)])
        newest = self._newest
        is_well, _ = self.health()
        yield _gauge("hri_healthy", "Whether the loop is running, as in /healthz.", [({}, is_well)])
        if newest is not None:
            yield from self._of_tick(newest[0], self._monotonic_s() - newest[1], is_well)
        yield from self._of_loop()
        yield from self._of_links()
        yield _counters(
            "hri_source_events_total",
            "Messages that a live source received and refused.",
            self._heard(),
        )
        yield _counters(
            "hri_events_total",
            "Counters of the other parts, as in the summary of a run.",
            [({"event": name}, count) for name, count in sorted(self._events.items())],
        )

    def _of_tick(self, tick: Tick, since_s: float, is_well: bool) -> Iterator[Family]:
        state = tick.status.node_state if is_well else NodeState.UNKNOWN
        yield _gauge(
            "hri_node_state",
            "1 for the current state of the node.",
            [({"state": s.name.lower()}, s is state) for s in NodeState],
        )
        yield _gauge(
            "hri_robot_level",
            "1 for the advised level.",
            [
                (
                    self._robot(a) | {"level": level.name.lower()},
                    level is (a.level if is_well else Level.UNKNOWN),
                )
                for a in tick.advices
                for level in Level
            ],
        )
        advices = tick.advices if is_well else ()
        yield _gauge(
            "hri_robot_speed_limit_meters_per_second",
            "Speed limit of the robot; absent if there is no limit or it is unknown.",
            [(self._robot(a), a.speed_limit_m_s) for a in advices if a.speed_limit_m_s is not None],
        )
        yield _gauge(
            "hri_robot_separation_meters",
            "Distance from the robot to the nearest body; absent if there is no person or it is "
            "unknown.",
            [(self._robot(a), a.separation_m) for a in advices if a.separation_m is not None],
        )
        captured = tick.status.capture_ns
        age: _Values = [] if captured is None else [({}, (tick.now_ns - captured) * 1e-9 + since_s)]
        yield _gauge("hri_input_age_seconds", "Time since the newest scene was captured.", age)
        seen = tick.snapshot if is_well else None
        yield _gauge(
            "hri_people",
            "Number of observed people.",
            [] if seen is None else [({}, len(seen.ids))],
        )
        yield _gauge(
            "hri_people_lost",
            "Number of people who are out of view and may still be in the cell.",
            [] if seen is None else [({}, len(seen.lost))],
        )

    def _of_loop(self) -> Iterator[Family]:
        pace = self._pace
        bounds = [*map(str, TICK_BOUNDS_S), "+Inf"]
        counts = list(accumulate(pace.within))
        buckets = [
            Sample(value=count, labels={"le": bound}, suffix="_bucket")
            for bound, count in zip(bounds, counts, strict=True)
        ]
        ends = [
            Sample(value=pace.total_s, suffix="_sum"),
            Sample(value=counts[-1], suffix="_count"),
        ]
        yield Family(
            name="hri_tick_duration_seconds",
            kind="histogram",
            help="Duration of ticks.",
            samples=[*buckets, *ends],
        )
        yield _counters("hri_ticks_total", "Ticks.", [({}, pace.ticks)])
        yield _counters(
            "hri_ticks_late_total",
            "Ticks that finished after the next tick was due.",
            [({}, pace.late_ticks)],
        )
        yield _counters("hri_ticks_missed_total", "Missed ticks.", [({}, pace.missed_ticks)])

    def _of_links(self) -> Iterator[Family]:
        yield _gauge(
            "hri_link_connected",
            "Whether the link's device is open.",
            [({"link": link.name}, link.connected) for link in self._links],
        )
        yield _counters(
            "hri_link_events_total",
            "Messages or frames that a link sent, received, refused and lost.",
            [
                ({"link": link.name, "event": name}, count)
                for link in self._links
                for name, count in asdict(link.counters).items()
                if not name.startswith("bytes_")
            ],
        )
        for way in ("sent", "received"):
            yield _counters(
                f"hri_link_{way}_bytes_total",
                f"Bytes {way} on a link.",
                [({"link": k.name}, getattr(k.counters, f"bytes_{way}")) for k in self._links],
            )

    def _heard(self) -> list[tuple[dict[str, str], float]]:
        live = live_part(self._source)
        counts = {} if live is None else asdict(live.counters)
        return [({"event": n}, c) for n, c in counts.items() if isinstance(c, int)]

    def _robot(self, advice: Advice) -> dict[str, str]:
        return {"robot": self._robots[advice.robot]}


_Values = Sequence[tuple[dict[str, str], float]]


def _gauge(name: str, text: str, values: _Values) -> Family:
    samples = [Sample(labels=labels, value=_plain(value)) for labels, value in values]
    return Family(name=name, kind="gauge", help=text, samples=samples)


def _counters(name: str, text: str, values: _Values) -> Family:
    samples = [Sample(labels=labels, value=value) for labels, value in values]
    return Family(name=name, kind="counter", help=text, samples=samples)


def _plain(value: float) -> float:
    return int(value) if isinstance(value, bool) else float(value)
