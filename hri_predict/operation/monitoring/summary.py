"""The summary of a run: counted while it runs, shown as a table or as JSON.

The keys of ``Summary.as_dict`` are a contract with users' scripts.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from hri_predict.base.quantities.units import rounded
from hri_predict.contracts.link import Link
from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.node import Node
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.operation.monitoring.source_report import source_table
from hri_predict.people.clock.clock_alignment import ClockEstimate
from hri_predict.protocol.messages import LEVELS, Advice, Level


class LevelCounter(Listener):
    """Counts changes to *slow* and *stop* per robot, and keeps the minimum separation.

    Attributes:
        ticks_at, seconds_at: by the level's name, for all robots together. An advice is valid until
            the next tick; ticks may differ in length.
        unknown_because: ticks by the reason's name.
    """

    def __init__(self) -> None:
        self._levels: dict[int, Level] = {}
        self._advices: Sequence[Advice] = ()
        self._since_ns = 0
        self.slowdowns = self.stops = 0
        self.min_separation_m: float | None = None
        self.ticks_at: dict[str, int] = {}
        self.seconds_at: dict[str, float] = {}
        self.unknown_because: dict[str, int] = {}
        self.clock: ClockEstimate | None = None

    def on_tick(self, tick: Tick) -> None:
        """Count the advice of one tick."""
        if tick.snapshot is not None:
            self.clock = tick.snapshot.clock or self.clock
        self._add_seconds((tick.now_ns - self._since_ns) * 1e-9)
        self._advices, self._since_ns = tick.advices, tick.now_ns
        for advice in tick.advices:
            was = self._levels.get(advice.robot)
            if advice.level is not was:
                # a change from stop or unknown to slow is a release, not a slowdown
                milder = was is not None and was.rank < Level.SLOW.rank
                self.slowdowns += advice.level is Level.SLOW and milder
                self.stops += advice.level is Level.STOP
                self._levels[advice.robot] = advice.level
            name = advice.level.name.lower()
            self.ticks_at[name] = self.ticks_at.get(name, 0) + 1
            if advice.level is Level.UNKNOWN:
                why = advice.reason.name.lower()
                self.unknown_because[why] = self.unknown_because.get(why, 0) + 1
            near = advice.separation_m
            if near is not None and (self.min_separation_m is None or near < self.min_separation_m):
                self.min_separation_m = near

    def _add_seconds(self, lasted_s: float) -> None:
        for advice in self._advices:
            name = advice.level.name.lower()
            self.seconds_at[name] = self.seconds_at.get(name, 0.0) + lasted_s


@dataclass(kw_only=True)
class Summary:
    """The results of a run. ``as_dict`` returns them for JSON."""

    frames_in: int
    ticks: int
    late_ticks: int
    tick_ms: dict[str, float]
    publish_phase_ms: float | None
    links: list[dict[str, Any]]
    min_separation_m: float | None
    slowdowns: int
    stops: int
    contacts: int | None
    contacts_standing: int | None
    ticks_at: dict[str, int] = field(default_factory=dict)
    seconds_at: dict[str, float] = field(default_factory=dict)
    unknown_because: dict[str, int] = field(default_factory=dict)
    counted: dict[str, int] = field(default_factory=dict)
    controllers: list[dict[str, Any]] = field(default_factory=list)
    node_state: str = ""
    shadow: bool = False
    self_check: dict[str, Any] | None = None
    source: dict[str, Any] = field(default_factory=dict)
    recording: dict[str, Any] | None = None
    evidence: dict[str, Any] | None = None
    alerts: list[dict[str, Any]] = field(default_factory=list)
    predictor: str | None = None
    too_slow: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for ``--json``."""
        return asdict(self)

    def print(self, console: Console) -> None:
        """Print the summary as tables."""
        if self.too_slow:  # first: it makes other faults, which the tables name
            console.print(self.too_slow, highlight=False, markup=False, soft_wrap=True)
        console.print(self._run_table())
        if self.source.get("live") is not None:
            console.print(source_table(self.source))
        if self.links:
            console.print(self._link_table())
            for line in filter(None, map(_link_trouble, self.links)):
                console.print(line, highlight=False, markup=False)
        if self.controllers:
            console.print(self._controller_table())
        for hook in self.alerts:
            console.print(_alerts(hook), highlight=False, markup=False, soft_wrap=True)

    def _run_table(self) -> Table:
        table = Table(title="Summary", title_justify="left", show_header=False)
        near = "-" if self.min_separation_m is None else f"{self.min_separation_m:.2f} m"
        tick = self.tick_ms
        rows = [
            ("frames in", str(self.frames_in)),
            ("ticks (late)", f"{self.ticks} ({self.late_ticks})"),
            (
                "tick p50 / p99 / max",
                f"{tick['p50']:.2f} / {tick['p99']:.2f} / {tick['max']:.2f} ms",
            ),
            ("smallest separation", near),
            ("slowdowns, stops", f"{self.slowdowns}, {self.stops}"),
            ("time at each level", _shares(self.seconds_at)),
            ("reasons for unknown", _counts(self.unknown_because)),
            ("contacts, moving robot", "-" if self.contacts is None else str(self.contacts)),
            (
                "contacts, standing robot",
                "-" if self.contacts_standing is None else str(self.contacts_standing),
            ),
            ("counters", _counts(self.counted)),
        ]
        if self.publish_phase_ms is not None:
            rows.insert(3, ("publish phase", f"{self.publish_phase_ms:.2f} ms after a tick is due"))
        if self.predictor is not None:
            rows.insert(0, ("predictor", self.predictor))
        if self.shadow:
            rows.insert(0, ("shadow mode", "links sent unknown"))
        if self.recording is not None:
            rows.insert(-1, ("recording", _recording(self.recording)))
        if self.evidence is not None:
            rows.insert(-1, ("evidence", _evidence(self.evidence)))
        if self.self_check is not None:
            rows.insert(-1, ("forecasts that held", _held(self.self_check)))
        for row in rows:
            table.add_row(*row)
        return table

    def _link_table(self) -> Table:
        table = Table(title="Links", title_justify="left")
        for name in _LINK_COLUMNS:
            table.add_column(
                name.replace("_", " "),
                justify="left" if name == "name" else "right",
                no_wrap=name not in ("name", "crc_errors"),  # these wrap on a narrow screen
                overflow="fold",
            )
        for link in self.links:
            table.add_row(*(str(link[name]) for name in _LINK_COLUMNS))
        return table

    def _controller_table(self) -> Table:
        table = Table(title="Controllers, by their own count", title_justify="left")
        table.add_column("")
        for controller in self.controllers:
            table.add_column(str(controller["name"]), justify="right")
        for name in self.controllers[0]:
            values = [controller[name] for controller in self.controllers]
            if name != "name" and any(values) and not isinstance(values[0], list | dict):
                label = _COUNTED_BY_PARTS if name == "messages" else name.replace("_", " ")
                table.add_row(label, *(_short(value) for value in values))
        return table


_COUNTED_BY_PARTS = "messages (each frame of a zone or pose is one)"


def summarise(
    *,
    node: Node,
    pace: Pace,
    links: Sequence[Link],
    levels: LevelCounter,
    counters: dict[str, int],
) -> Summary:
    """Build the summary from the counters of one run; the referee adds the contacts."""
    ticks = np.array(pace.tick_ms or [0.0])
    counted = {name: count for name, count in counters.items() if count}
    extra = {
        "missed_ticks": pace.missed_ticks,
        "source_failures": pace.source_failures,
        "assess_failures": node.assess_failures,
        "listener_failures": node.listener_failures,
        "strange_states": node.strange_states,
        "acknowledges": node.acknowledges,
        "acknowledges_refused": node.acknowledges_refused,
        **{f"acknowledges_{why}": n for why, n in node.acknowledges_not_counted.items()},
        "load_sheds": node.shedding.sheds,
        **{
            f"ticks_without_{kind.__name__.lower()}s": ticks
            for kind, ticks in node.shedding.without.items()
        },
        **node.robot_counters,
    }
    counted |= {name: count for name, count in extra.items() if count}
    phase = node.publish_phase
    return Summary(
        frames_in=node.frames_in,
        ticks=pace.ticks,
        late_ticks=pace.late_ticks,
        tick_ms={
            "p50": round(float(np.percentile(ticks, 50)), 3),
            "p99": round(float(np.percentile(ticks, 99)), 3),
            "max": round(float(ticks.max()), 3),
        },
        publish_phase_ms=None if phase is None else round(phase.phase_s * 1e3, 3),
        links=[_link_row(link, pace.connected.get(link.name, False)) for link in links],
        min_separation_m=rounded(levels.min_separation_m),
        slowdowns=levels.slowdowns,
        stops=levels.stops,
        contacts=None,
        contacts_standing=None,
        ticks_at={name: levels.ticks_at[name] for name in _LEVELS if name in levels.ticks_at},
        seconds_at={
            name: round(levels.seconds_at[name], 3) for name in _LEVELS if name in levels.seconds_at
        },
        unknown_because=levels.unknown_because,
        counted=counted,
        node_state=node.state.name.lower(),
        self_check=node.self_check(),
        too_slow=pace.too_slow,
    )


_LEVELS = tuple(level.name.lower() for level in LEVELS)


def _link_row(link: Link, connected: bool) -> dict[str, Any]:
    """Return a link's row; ``connected`` is its state when the run ended."""
    counters = asdict(link.counters)
    return {
        "name": link.name,
        "messages": counters.pop("messages_sent"),
        "bytes": counters.pop("bytes_sent"),
        "crc_errors": counters.pop("crc_errors"),
        "received": counters.pop("messages_received"),
        **counters,
        "connected": connected,
        "last_error": link.last_error,
    }


_LINK_COLUMNS = ["name", "messages", "bytes", "received", "crc_errors", "superseded", "reconnects"]
_QUIET = {*_LINK_COLUMNS, "bytes_received", "connected", "echoes"}


def _link_trouble(link: dict[str, Any]) -> str:
    """Return one line with a link's other counters and last error; empty if there are none."""
    counts = {n: c for n, c in link.items() if isinstance(c, int) and c and n not in _QUIET}
    parts = [] if link["connected"] else ["not connected at the end"]
    parts += [_counts(counts)] if counts else []
    if link["last_error"]:
        parts.append(f"last error: {link['last_error']}")
    return f"{link['name']}: {'; '.join(parts)}" if parts else ""


def _recording(report: dict[str, Any]) -> str:
    lost = f", {report['dropped']} lost" if report["dropped"] else ""
    ended = f"; incomplete: {report['error']}" if report["error"] else ""
    files = f" in {report['files']} files" if report["files"] != 1 else ""
    return f"{report['path']}: {report['written']} messages{files}{lost}{ended}"


def _evidence(report: dict[str, Any]) -> str:
    kinds = {"stop": "stops", "near_miss": "near misses", "fault": "faults"}
    counts = ", ".join(f"{kinds[kind]} {n}" for kind, n in report["events"].items())
    lost = report["dropped"] + report["failures"]
    wrong = f", {lost} lost" if lost else ""
    return (
        f"{counts or 'no event'}; {report['kept']} kept{wrong}; hash {report['newest_hash'][:16]}"
    )


def _alerts(hook: dict[str, Any]) -> str:
    """Return one line about an alert hook."""
    counts = {name.replace("_", " "): n for name, n in hook.items() if isinstance(n, int)}
    told = {name: n for name, n in counts.items() if n or name == "delivered"}
    last = f"; last error: {hook['last_error']}" if hook["last_error"] else ""
    return f"alerts by {hook['name']}: {_counts(told)}{last}"


def _shares(seconds_at: dict[str, float]) -> str:
    total = sum(seconds_at.values()) or 1.0
    return ", ".join(f"{name} {100 * s / total:.0f} %" for name, s in seconds_at.items()) or "-"


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {n}" for name, n in counts.items()) or "-"


def _held(check: dict[str, Any]) -> str:
    """Return the result of the live self-check in one line."""
    ticks = check["ticks"] or 1
    widened = f"zones widened {100 * check['ticks_widened'] / ticks:.0f} %"
    outside = f"motion out of distribution {100 * check['ticks_unlike'] / ticks:.0f} % of the time"
    covered = check["covered"]
    held = "-" if covered is None else f"{100 * covered:.1f} %"
    drift = check["drift"]
    fits = "; the calibration no longer fits" if drift["drifting"] else ""
    fits = fits or ("; for a time the calibration did not fit" if drift["raised"] else "")
    return f"{held} of {check['judged_in_use']}; {widened}, {outside}{fits}"


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
