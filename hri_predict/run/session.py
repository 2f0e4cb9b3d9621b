"""One run from start to end: the node, its links, and the simulated cell, if any."""

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hri_predict.base.clock import Clock, MonotonicClock, VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.contracts.cell import Cell, ControllerReport
from hri_predict.contracts.source import Source, live_part
from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.memory import Memory
from hri_predict.operation.evidence.keeper import Evidence
from hri_predict.operation.monitoring.alerts import Alerts
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.operation.monitoring.source_report import source_counts, source_report
from hri_predict.operation.monitoring.summary import LevelCounter, Summary, summarise
from hri_predict.operation.service.notify import Notifier
from hri_predict.predictors.thread_runner import Prediction
from hri_predict.protocol.discovery.announcer import Announcer, node_properties
from hri_predict.recording import Recorder, RecordingInfo
from hri_predict.recording.folder.settings import RecordSettings
from hri_predict.recording.mcap.clocks import Clocks
from hri_predict.recording.mcap.items import Items
from hri_predict.recording.mcap.places import RecordingFiles
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.foreseeing import foreseeing
from hri_predict.run.recording import clocks_of, info_of, where_to_record
from hri_predict.run.runtime import run_real_time, run_virtual, stop_on_signals
from hri_predict.run.serving import Serving
from hri_predict.run.starting import SlowStart, ended_by_signals, memory_of

VIRTUAL_START_NS = 1_000_000_000


class View(Listener):
    """A listener that displays each tick, for which it needs the assembly."""

    def bind(self, assembly: assemble.Assembly) -> None:
        """Receive the assembly; called once, before the first tick."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a run.

    Attributes:
        factor: node seconds per wall second; ``None``: as fast as possible on the virtual clock.
        duration_s: stop after this many node seconds.
        until_exhausted: stop when the source is exhausted.
        record: file or folder to record into, instead of the configuration's.
        overwrite: replace the file if it exists.
        shadow: send *unknown* on the links regardless of the advice.
        keep_state: use the state file of the configuration (``state``), in real time only.
        state: use this state file instead, at any speed.
        last_latch_id: latches are numbered from the next id on; ``None``: from a random number, so
            that an Acknowledge from another run matches no latch.
        view: displays each tick; called by the loop's thread, so it must be fast.
        notifier: receiver of reports on the node's state (systemd), in real time only.
        reread: reads the configuration again, for SIGHUP; ``None``: SIGHUP stops the node.
    """

    factor: float | None = 1.0
    duration_s: float | None = None
    until_exhausted: bool = False
    record: Path | None = None
    overwrite: bool = False
    shadow: bool = False
    keep_state: bool = False
    state: Path | None = None
    last_latch_id: int | None = None
    view: View | None = None
    notifier: Notifier | None = None
    reread: Callable[[], Config] | None = None


class _AlertListener(Listener):
    def __init__(self, alerts: Alerts) -> None:
        self._alerts = alerts

    def on_tick(self, tick: Tick) -> None:
        found = tick.assessment
        self._alerts.observe(tick.advices, () if found is None else found.reasons)
        self._alerts.observe_zones(None if found is None else found.named_zones)


def run(config: Config, options: Options, stop: threading.Event | None = None) -> Summary:
    """Run ``config`` and return the summary.

    Raises:
        HriPredictError: the run cannot start; one line with the remedy.
    """
    virtual = options.factor is None
    clock: Clock = (
        VirtualClock(VIRTUAL_START_NS) if virtual else MonotonicClock(options.factor or 1.0)
    )
    cell = _cell(config, clock, options)
    session = _Session(config, options, clock, cell)
    try:
        if virtual:
            return session.run_virtual()
        stop = stop or threading.Event()
        if threading.current_thread() is threading.main_thread():
            with stop_on_signals(stop, session.serving.hangup):
                return session.run_real_time(stop)
        return session.run_real_time(stop)
    finally:
        session.close()


def _cell(config: Config, clock: Clock, options: Options) -> Cell | None:
    """Build the simulated cell if a link has ``simulate:``, otherwise return ``None``."""
    simulated = [link for link in config.opened_links if link.simulate is not None]
    real = [link.name for link in config.opened_links if link.simulate is None]
    if options.factor is None and real:
        raise ConfigError(
            f"link {real[0]} is real hardware, which runs only in real time: leave the links out "
            f"(--no-links), give the link a 'simulate:' block, or use --speed 1"
        )
    if not simulated:
        return None
    assemble.build_robots(config)  # so that an error names the robot's key, as without a cell
    cls = registry.load("cells", "mock")
    return cls(
        links=simulated,
        robots=config.node.robots,
        base_dir=config.base_dir,
        clock=clock,
        factor=options.factor or 1.0,
    )


class _Session:
    def __init__(self, config: Config, options: Options, clock: Clock, cell: Cell | None) -> None:
        self.config, self.options, self.clock, self.cell = config, options, clock, cell
        self.levels, self.slow_start = LevelCounter(), SlowStart()
        self.alerts = Alerts(
            settings=config.node.alerts,
            robots=[robot.name for robot in config.node.robots],
            zones=[zone.name for zone in config.node.zones],
            clock=clock,
            base_dir=config.base_dir,
            cell=config.path.stem,
            threaded=options.factor is not None,
        )
        self.serving = Serving(config, options.notifier, options.reread)
        self.reports: Sequence[ControllerReport] | None = None
        self.recorder: Recorder | None = None
        self.evidence: Evidence | None = None
        self.announcer: Announcer | None = None
        self.referee: _Referee | None = None
        self.source: Source | None = None
        self.memory: Memory | None = None
        self.prediction: Prediction | None = None

    def build(self, **ends: Any) -> assemble.Assembly:
        """Build everything; create the recording last, when no other step can fail."""
        virtual = self.options.factor is None
        settings, place = self._where_to_record()
        self.source = source = assemble.build_source(self.config)
        if virtual:
            self.prediction = foreseeing(self.config, source, self.clock.now_ns())
        listeners: list[Listener] = [self.slow_start, self.levels, _AlertListener(self.alerts)]
        if self.options.view is not None:
            listeners.append(self.options.view)
        assembly = assemble.build(
            self.config,
            self.clock,
            source=source,
            deadline=not virtual,
            prediction=self.prediction,
            shadow=self.options.shadow,
            # two recordings on the virtual clock have the same bytes
            last_latch_id=0 if virtual and place is not None else self.options.last_latch_id,
            listeners=listeners,
            **ends,
        )
        if self.options.view is not None:
            self.options.view.bind(assembly)
        if self.cell is not None and live_part(source) is None:  # live people have no copy
            self.referee = _Referee(self.config, assembly, self.cell)
        self._remember(assembly, listeners)
        info = info_of(self.config, source, assembly)
        clocks = clocks_of(self.clock, self.options.factor, VIRTUAL_START_NS)
        if place is not None and settings is not None:
            self.recorder = Recorder(
                place,
                info,
                threaded=not virtual,
                rates=settings.rates,
                counters=self.serving.recorded(assembly),
                clocks=clocks,
            )
            listeners.append(self.recorder)
        self._keep_evidence(assembly, info, clocks, listeners)
        takers = [each for each in (self.recorder, self.evidence) if each is not None]
        if takers:  # else whoever views the run may listen
            for link in assembly.links:
                link.on_sent = _to_all(takers)
        if not virtual:  # last: who watches the loop must see whatever holds it up
            listeners += self.serving.listeners(assembly, self.counters, place, self.alerts)
        return assembly

    def _where_to_record(self) -> tuple[RecordSettings | None, RecordingFiles | None]:
        """Return the recorder's settings and path, if any; see ``run.recording``."""
        return where_to_record(self.config, self.options.record, self.options.overwrite)

    def _keep_evidence(
        self,
        assembly: assemble.Assembly,
        info: RecordingInfo,
        clocks: Clocks,
        listeners: list[Listener],
    ) -> None:
        """Keep evidence, if this is a live run and the configuration asks for it.

        Raises:
            ConfigError: the folder cannot be used.
        """
        settings = self.config.node.evidence
        if settings is None or self.options.factor is None or not self.options.keep_state:
            return
        self.evidence = Evidence(
            settings,
            self.config.base_dir,
            info,
            robots=[robot.name for robot in assembly.robots],
            links=[robot.capsule_names for robot in assembly.robots],
            clocks=clocks,
        )
        listeners.append(self.evidence)

    def _remember(self, assembly: assemble.Assembly, listeners: list[Listener]) -> None:
        """Use the state file, if this run has one.

        Raises:
            ConfigError: another node uses it, or its folder cannot be used.
        """
        threaded = self.options.factor is not None
        self.memory = memory_of(
            self.config,
            assembly.node,
            instead=self.options.state,
            keep=self.options.keep_state and threaded,
            threaded=threaded,
        )
        if self.memory is not None:
            self.memory.open()
            listeners.append(self.memory)

    def run_real_time(self, stop: threading.Event) -> Summary:
        self.prediction = assemble.build_prediction(self.config)  # gets ready beside what follows
        ports = self.cell.start() if self.cell is not None else {}
        with ended_by_signals(stop):
            assembly = self.build(ports=ports)
        self.alerts.start()
        if self.config.node.discovery is not None:
            said = node_properties(
                node=self.config.node.discovery.name or self.config.path.stem,
                source=self.config.source.kind,
                predictor=self.config.predictor.name,
                rate_hz=self.config.node.rate_hz,
                links={link.name: link.kind for link in self.config.opened_links},
            )
            self.announcer = Announcer(self.config.node.discovery, said)
            self.announcer.start()
        pace = run_real_time(
            assembly=assembly,
            stop=stop,
            duration_s=self.options.duration_s,
            until_exhausted=self.options.until_exhausted,
            each_tick=self.referee.observe if self.referee is not None else None,
            pace=self.serving.pace,
        )
        return self.summary(assembly, pace)

    def run_virtual(self) -> Summary:
        transports = self.cell.transports() if self.cell is not None else {}
        assembly = self.build(transports=transports)
        pace = run_virtual(
            assembly,
            self.cell,
            duration_s=self.options.duration_s,
            each_tick=self.referee.observe if self.referee is not None else None,
        )
        return self.summary(assembly, pace)

    def summary(self, assembly: assemble.Assembly, pace: Pace) -> Summary:
        people = dict(assembly.node.people_counters)  # of scenes after the last tick, too
        self.close()
        result = summarise(
            node=assembly.node,
            pace=pace,
            links=assembly.links,
            levels=self.levels,
            counters=people | dict(assembly.prediction.counters) | self.counters(),
        )
        result.shadow = self.options.shadow
        result.predictor = self.config.predictor.name
        if self.referee is not None:
            self.referee.add_to(result)
        result.source = source_report(
            self.config.source.kind, assembly.source, self.levels.clock, self.clock.now_ns()
        )
        result.alerts = self.alerts.report()
        if self.recorder is not None:
            result.recording = self.recorder.report()
        if self.evidence is not None:
            result.evidence = self.evidence.report()
        result.controllers = [asdict(report) for report in self.reports or ()]
        return result

    def counters(self) -> dict[str, int]:
        """Return the counters besides the node's: forecasts, and items not written to disk."""
        counted = dict(self.prediction.counters) if self.prediction is not None else {}
        counted |= {"alerts_dropped": self.alerts.dropped, "alert_failures": self.alerts.failures}
        counted |= self.serving.lost | source_counts(self.source)
        if self.memory is not None:
            counted["state_write_failures"] = self.memory.failures
        if self.recorder is not None:
            counted["recorder_dropped"] = self.recorder.dropped
        if self.evidence is not None:
            counted["evidence_dropped"] = self.evidence.dropped
            counted["evidence_failures"] = self.evidence.failures
        return counted

    def close(self) -> None:
        """Stop all started parts; safe to call twice."""
        self.slow_start.over()
        if self.prediction is not None:
            self.prediction.stop()
        if self.announcer is not None:
            self.announcer.stop()
        if self.cell is not None and self.reports is None:
            self.reports = self.cell.stop()
        self.alerts.stop()
        self.serving.close()
        if self.memory is not None:
            self.memory.close()
        if self.recorder is not None:
            self.recorder.close()
        if self.evidence is not None:
            self.evidence.close()


def _to_all(takers: Sequence[Items]) -> Callable[[str, Any, int], None]:
    """Return a function that passes a link's sent messages to each of these."""

    def sent(link: str, unit: Any, now_ns: int) -> None:
        for taker in takers:
            taker.sent(link, unit, now_ns)

    return sent


@contextlib.contextmanager
def _said_already() -> Iterator[None]:
    """Suppress warnings, because a copy of the source would repeat the source's warnings."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


class _Referee:
    """Compares the true people (a clean copy of the source) with the true robots (of the cell).

    The node has no access to these true values.
    """

    def __init__(self, config: Config, assembly: assemble.Assembly, cell: Cell) -> None:
        self._cell = cell
        with _said_already():
            source = assemble.build_again(config, assembly.source)
        self._people = cell.true_people(source)
        self._referee = cell.referee(assembly.robots)
        self._opened = False

    def observe(self, now_ns: int) -> None:
        """Check the interval since the last tick for contacts."""
        if not self._opened:  # at the first tick, as the node's own source was
            self._people.open(now_ns)
            self._opened = True
        self._referee.observe(now_ns, self._people.at(now_ns), self._cell.robot_truth(now_ns))

    def add_to(self, summary: Summary) -> None:
        """Add the contacts to the summary."""
        summary.contacts = self._referee.contacts
        summary.contacts_standing = self._referee.contacts_standing
        if self._referee.min_separation_m is not None:
            summary.min_separation_m = round(self._referee.min_separation_m, 4)
