"""One run from start to end: node, links, and where simulated, the cell at their other ends."""

import contextlib
import logging
import threading
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hri_predict import assemble, registry
from hri_predict.alerts import Alerts
from hri_predict.clock import Clock, MonotonicClock, VirtualClock
from hri_predict.config import Config
from hri_predict.discovery.announcer import Announcer, node_properties
from hri_predict.errors import ConfigError
from hri_predict.recording import Recorder, RecordingInfo
from hri_predict.runtime import Pace, run_real_time, run_virtual, stop_on_signals
from hri_predict.source import Source, live_part
from hri_predict.source_report import source_report
from hri_predict.summary import LevelCounter, Summary, summarise
from hri_predict.tick import Listener, Tick

VIRTUAL_START_NS = 1_000_000_000


class View(Listener):
    """A listener that shows each tick, and wants to know what was built."""

    def bind(self, assembly: assemble.Assembly) -> None:
        """Called once, before the first tick."""


@dataclass(frozen=True)
class Options:
    """How to run a configuration.

    Attributes:
        factor: node seconds per wall second; ``None`` as fast as possible, on the virtual clock.
        duration_s: stop after so many node seconds.
        until_exhausted: stop when the source has no more.
        record: file to record into.
        shadow: tell the links *unknown* whatever the advice is.
        view: shows each tick (called in the loop's thread: must be quick).
    """

    factor: float | None = 1.0
    duration_s: float | None = None
    until_exhausted: bool = False
    record: Path | None = None
    shadow: bool = False
    view: View | None = None


class _AlertListener(Listener):
    def __init__(self, alerts: Alerts) -> None:
        self._alerts = alerts

    def on_tick(self, tick: Tick) -> None:
        self._alerts.observe(tick.advices)
        if tick.assessment is not None:
            self._alerts.observe_zones(tick.assessment.named_zones)


def run(config: Config, options: Options, stop: threading.Event | None = None) -> Summary:
    """Run ``config`` and return what came of it.

    Raises:
        HriPredictError: it cannot start; one line with the remedy.
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
            with stop_on_signals(stop):
                return session.run_real_time(stop)
        return session.run_real_time(stop)
    finally:
        session.close()


def _cell(config: Config, clock: Clock, options: Options) -> Any | None:
    """The simulated cell, where a link asks for one."""
    simulated = [link for link in config.opened_links if link.simulate is not None]
    real = [link.name for link in config.opened_links if link.simulate is None]
    if options.factor is None and real:
        raise ConfigError(
            f"link {real[0]} is real hardware, which has only one speed: run at --speed 1, leave "
            f"the links out (--no-links), or give it a 'simulate:' block"
        )
    if not simulated:
        return None
    assemble.build_robots(config)  # what is wrong with one is named by its key, as without a cell
    cls = registry.load("cells", "mock")
    return cls(simulated, config.node.robots, config.base_dir, clock, options.factor or 1.0)


class _Session:
    def __init__(self, config: Config, options: Options, clock: Clock, cell: Any | None) -> None:
        self.config, self.options, self.clock, self.cell = config, options, clock, cell
        self.levels = LevelCounter()
        names = [robot.name for robot in config.node.robots]
        self.alerts = Alerts(
            config.node.alerts,
            names,
            clock,
            config.base_dir,
            threaded=options.factor is not None,
        )
        self.reports: Sequence[Any] | None = None
        self.recorder: Recorder | None = None
        self.announcer: Announcer | None = None
        self.referee: _Referee | None = None

    def build(self, **ends: Any) -> assemble.Assembly:
        """Build everything; the recording is created last, when nothing else can fail any more."""
        virtual = self.options.factor is None
        path = self._record_path()
        source = assemble.build_source(self.config)
        listeners: list[Listener] = [self.levels, _AlertListener(self.alerts)]
        if self.options.view is not None:
            listeners.append(self.options.view)
        assembly = assemble.build(
            self.config,
            self.clock,
            source=source,
            deadline=not virtual,
            shadow=self.options.shadow,
            listeners=listeners,
            **ends,
        )
        if self.options.view is not None:
            self.options.view.bind(assembly)
        if self.cell is not None and live_part(source) is None:  # of live people nobody has a copy
            self.referee = _Referee(self.config, assembly, self.cell)
        if path is not None:
            self.recorder = Recorder(path, self._recording_info(source), threaded=not virtual)
            listeners.append(self.recorder)
            for link in assembly.links:
                link.on_sent = self.recorder.sent
        return assembly

    def _record_path(self) -> Path | None:
        """The file to record into.

        Raises:
            ConfigError: it is the recording that is played, or the configuration.
        """
        config = self.config
        path = self.options.record or (
            config.base_dir / config.node.record if config.node.record else None
        )
        played = getattr(config.source, "path", None)
        if path is None:
            return None
        if _same(path, config.path):
            raise ConfigError(f"record {path}: is the configuration; name another file")
        if isinstance(played, str) and any(
            _same(path, there) for there in (config.base_dir / played, Path(played))
        ):  # a relative one may be found in either place
            raise ConfigError(f"record {path}: is the recording that is played; name another")
        return path

    def _recording_info(self, source: Source) -> RecordingInfo:
        return RecordingInfo(
            joint_map=source.joint_map,
            rate_hz=source.rate_hz,
            declares_noise=source.declares_noise,
            config=self.config.text,
            predictor=self.config.predictor.name,
            forecast_rate_hz=self.config.predictor.rate_hz,
        )

    def run_real_time(self, stop: threading.Event) -> Summary:
        ports = self.cell.start() if self.cell is not None else {}
        assembly = self.build(ports=ports)
        self.alerts.start()
        if self.config.node.discovery is not None:
            said = node_properties(self.config)
            self.announcer = Announcer(self.config.node.discovery, said)
            self.announcer.start()
        pace = run_real_time(
            assembly,
            stop,
            duration_s=self.options.duration_s,
            until_exhausted=self.options.until_exhausted,
            each_tick=self.referee.observe if self.referee is not None else None,
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
        counters = dict(self.levels.people_counters)
        self.close()
        counters["alerts_dropped"] = self.alerts.dropped
        counters["alert_failures"] = self.alerts.failures
        if self.recorder is not None:
            counters["recorder_dropped"] = self.recorder.dropped
        result = summarise(assembly.node, pace, assembly.links, self.levels, counters)
        if self.referee is not None:
            self.referee.add_to(result)
        result.source = source_report(
            self.config.source.kind, assembly.source, self.levels.clock, self.clock.now_ns()
        )
        result.controllers = [asdict(report) for report in self.reports or ()]
        return result

    def close(self) -> None:
        """End what was started; safe to call twice."""
        if self.announcer is not None:
            self.announcer.stop()
        if self.cell is not None and self.reports is None:
            self.reports = self.cell.stop()
        self.alerts.stop()
        if self.recorder is not None:
            self.recorder.close()


def _same(a: Path, b: Path) -> bool:
    """Whether two names are of one file that is there."""
    try:
        return a.samefile(b)
    except OSError:  # one is not there, or its name is too long
        return False


@contextlib.contextmanager
def _said_already() -> Iterator[None]:
    """No warnings: what a copy of the source would say, the source has said."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


class _Referee:
    """Compares true people (a clean copy of the source) with the true robot (from the cell).

    The node never sees any of it.
    """

    def __init__(self, config: Config, assembly: assemble.Assembly, cell: Any) -> None:
        self._cell = cell
        with _said_already():
            source = assemble.build_source(config, with_faults=False)
        self._people = cell.true_people(source)
        self._referee = cell.referee(assembly.robots)
        self._opened = False

    def observe(self, now_ns: int) -> None:
        """Judge the time since the last tick."""
        if not self._opened:  # at the first tick: the node's own copy was opened at its time
            self._people.open(now_ns)
            self._opened = True
        self._referee.observe(now_ns, self._people.at(now_ns), self._cell.robot_truth(now_ns))

    def add_to(self, summary: Summary) -> None:
        """Put the verdict into the summary."""
        summary.contacts = self._referee.contacts
        summary.contacts_standing = self._referee.contacts_standing
        if self._referee.min_separation_m is not None:
            summary.min_separation_m = round(self._referee.min_separation_m, 4)
