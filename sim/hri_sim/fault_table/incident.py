"""Incidents: scripted scenarios of people and faults, run on the virtual clock in every risk mode.

The whole node, the mock controllers and the referee take part, as in ``hri-predict run --speed
max``. A row of the fault table shows one fault alone; an incident shows what a fault leads to.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hri_predict.base.settings import validated
from hri_predict.contracts.link import LinkSettings
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.settings import RiskSettings
from hri_predict.run.config import Config, NodeSettings
from hri_predict.run.session import Options, View, run
from hri_sim.fault_table.outcome import FaultOutcome

Span = tuple[float, float]
"""Start and end of a time span, seconds after the start."""
ALL_MODES = ("predictive", "iso", "fixed")


@dataclass(frozen=True, kw_only=True)
class Incident:
    """A story and its conditions. In every story, a moving robot must not touch a person.

    Attributes:
        name: name in the table.
        people: scripts of the people, as in ``source.people``.
        duration_s: length of the story.
        faults: faults as on the command line.
        settings: differences from the demo's configuration; mappings are merged, key by key.
        lies: the wrong behaviour of simulated controllers, as in ``simulate.lies``.
        liars: links whose controllers lie; default: all.
        requests: requests of every simulated controller, as in ``simulate.requests``.
        simulate: differences of every ``simulate`` block from the demo's.
        modes: risk modes in which it is played.
        not_clear: time in which no robot may be advised *clear*.
        not_moving: time in which every robot must be advised to stand; *clear* is not allowed.
        moving: time in which some advice must permit motion, so that the cell stays usable.
        says: reasons that must each be given at some tick.
        never_says: reasons that must not be given.
        prepare: modifies the assembled node before it starts, for example makes a controller lie.
    """

    name: str
    people: tuple[Mapping[str, Any], ...]
    duration_s: float
    faults: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    lies: tuple[Mapping[str, Any], ...] = ()
    liars: tuple[str, ...] = ()
    requests: tuple[Mapping[str, Any], ...] = ()
    simulate: Mapping[str, Any] = field(default_factory=dict)
    modes: tuple[str, ...] = ("predictive", "iso")
    not_clear: Span | None = None
    not_moving: Span | None = None
    moving: Span | None = None
    says: tuple[Reason, ...] = ()
    never_says: tuple[Reason, ...] = ()
    prepare: Callable[[Any], None] | None = None

    @property
    def never_clear(self) -> Span | None:
        """Time span in which no robot may be *clear*."""
        return self.not_clear or self.not_moving


def run_incident(base: Config, incident: Incident) -> Iterator[FaultOutcome]:
    """Play an incident in each of its modes; yield a row of the fault table for each."""
    for mode in incident.modes:
        yield _told(configured(base, incident, mode), incident, mode)


def configured(base: Config, incident: Incident, mode: str) -> Config:
    """Return the configuration of an incident in one mode.

    Raises:
        ConfigError: its settings are wrong.
    """
    settings = dict(incident.settings)
    changes: Mapping[str, Any] = settings.pop("source", {})
    source = _merged(base.source.model_dump(), changes)
    node = validated(
        NodeSettings, _merged(base.node.model_dump(exclude_unset=True), settings), incident.name
    )
    risk = validated(
        RiskSettings, node.risk.model_dump() | {"mode": mode}, f"{incident.name}: risk"
    )
    links = tuple(_with_controller(link, incident) for link in base.links)
    config = replace(base, node=node.model_copy(update={"risk": risk}), links=links)
    people = [dict(person) for person in incident.people]
    return config.with_source(source | {"people": people}).with_faults(list(incident.faults))


def _with_controller(link: LinkSettings, incident: Incident) -> LinkSettings:
    """Return the link; the controller at its far end has the incident's lies and requests."""
    if link.simulate is None:
        return link
    lies = incident.lies if not incident.liars or link.name in incident.liars else ()
    told = {"lies": lies, "requests": incident.requests}
    changes = {key: [dict(each) for each in entries] for key, entries in told.items() if entries}
    return link.model_copy(update={"simulate": {**link.simulate, **incident.simulate, **changes}})


def _told(config: Config, incident: Incident, mode: str) -> FaultOutcome:
    watch = _Watch(incident)
    summary = run(config, Options(factor=None, duration_s=incident.duration_s, view=watch))
    wrong = watch.wrong()
    if summary.contacts:
        wrong.insert(0, f"{summary.contacts} contacts with the moving robot")
    return FaultOutcome(
        fault=f"{incident.name} ({mode})",
        expected="no contact",
        acts="node",
        reason="; ".join(wrong) or ", ".join(reason.name for reason in incident.says),
        clear_while_near=watch.count(incident.never_clear, lambda level: level is Level.CLEAR),
        fine=not wrong,
        counted=summary.counted,
    )


class _Watch(View):
    """Records each tick's level and reason for the first robot."""

    def __init__(self, incident: Incident) -> None:
        self._incident = incident
        self._ticks: list[tuple[float, Level, Reason]] = []
        self._start_ns = 0

    def bind(self, assembly: Any) -> None:
        """Record the start, and prepare the assembly as the incident requires."""
        self._start_ns = assembly.clock.now_ns()
        if self._incident.prepare is not None:
            self._incident.prepare(assembly)

    def on_tick(self, tick: Tick) -> None:
        """Record the advice for the first robot."""
        advice = tick.advices[0]
        self._ticks.append(((tick.now_ns - self._start_ns) * 1e-9, advice.level, advice.reason))

    def count(self, span: Span | None, holds: Callable[[Level], bool]) -> int:
        """Return the number of ticks in a span with one of these levels."""
        begin, end = span or (0.0, 0.0)
        return sum(begin <= t < end and holds(level) for t, level, _ in self._ticks)

    def wrong(self) -> list[str]:
        """Return the violated conditions, in words."""
        incident, found = self._incident, []
        if clear := self.count(incident.never_clear, lambda level: level is Level.CLEAR):
            found.append(f"clear in {clear} ticks of {incident.never_clear}")
        if moving := self.count(incident.not_moving, lambda level: level.may_move):
            found.append(f"motion permitted in {moving} ticks of {incident.not_moving}")
        if incident.moving and not self.count(incident.moving, lambda level: level.may_move):
            found.append(f"no motion permitted in {incident.moving}")
        given = {reason for _, _, reason in self._ticks}
        found += [f"never says {r.name}" for r in incident.says if r not in given]
        found += [f"says {r.name}" for r in incident.never_says if r in given]
        return found


def _merged(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``data`` with changes; nested mappings are merged as well."""
    result = dict(data)
    for key, value in changes.items():
        before = result.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            value = _merged(before, value)
        result[key] = value
    return result
