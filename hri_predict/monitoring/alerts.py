"""Alerts when a robot's level or a named zone changes: a line, JSON, a user's command.

The node's loop only queues a change; a separate thread writes the alert and runs the command.
"""

import errno
import json
import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from pydantic import Field

from hri_predict.clock import Clock
from hri_predict.errors import ConfigError
from hri_predict.files import refuse_named_pipe
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import NamedZoneState
from hri_predict.settings import Settings


class AlertSettings(Settings):
    """``alerts:`` in the configuration."""

    terminal: bool = Field(True, description="print a line on standard error for each change")
    file: str | None = Field(None, min_length=1, description="append JSON lines to this file")
    command: list[str] | None = Field(
        None,
        description="program and arguments to run; it reads the alert as JSON from standard input",
    )
    debounce_s: float = Field(
        1.0, ge=0, le=60, description="least time between two runs of the command"
    )
    timeout_s: float = Field(5.0, gt=0, le=600, description="end a command that runs longer")


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """One change of a robot's level, or of the reason for *unknown* or *fault*.

    ``at`` is the time of the wall clock (UTC), ``None`` on the virtual clock; ``time_s`` is the
    node's time since the start.
    """

    at: str | None
    time_s: float
    robot: str
    level: str
    was: str
    reason: str
    detail: str
    clears_when: str
    separation_m: float | None
    speed_limit_m_s: float | None

    def line(self) -> str:
        """One line for a person."""
        clears = f"; clears when {self.clears_when}" if self.clears_when else ""
        why = self.detail or f"{self.robot}: {self.reason}{clears}"
        return f"[{self.time_s:8.2f} s] {self.was} -> {self.level}: {why}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoneAlert:
    """One change of a named zone: ``empty``, ``entry predicted`` (in ``entry_s``), ``occupied``."""

    at: str | None
    time_s: float
    zone: str
    state: str
    was: str
    entry_s: float | None

    def line(self) -> str:
        """One line for a person."""
        soon = self.state == "entry predicted" and self.entry_s is not None
        when = f" in {self.entry_s * 1e3:.0f} ms" if soon and self.entry_s is not None else ""
        return f"[{self.time_s:8.2f} s] zone {self.zone}: {self.was} -> {self.state}{when}"


AnyAlert = Alert | ZoneAlert


class Alerts:
    """Watches levels and named zones, and raises an alert when one changes.

    On the virtual clock there is no thread: alerts are written at once and the command is not run.

    ``dropped`` counts alerts that were lost because the thread could not keep up. ``failures``
    counts alerts that could not be written to the file, and commands that could not run, failed
    or were ended.

    Raises:
        ConfigError: the alert file cannot be written.
    """

    def __init__(
        self,
        *,
        settings: AlertSettings,
        robots: list[str],
        clock: Clock,
        base_dir: Path,
        terminal: TextIO | None = None,
        threaded: bool = True,
    ) -> None:
        self._settings = settings
        self._robots = robots
        self._clock = clock
        self._start_ns = clock.now_ns()
        self._terminal = terminal if terminal is not None else sys.stderr
        self._threaded = threaded
        self._states: dict[int, tuple[Level, Reason | None]] = {}
        self._zones: dict[str, str] = {}
        self._queue: queue.Queue[AnyAlert | None] = queue.Queue(maxsize=256)
        self._file = alert_file(settings, base_dir)
        self._last_run_ns: int | None = None
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self.count = self.dropped = self.failures = 0

    def start(self) -> None:
        """Start the thread that writes alerts and runs the command."""
        self._thread = threading.Thread(target=self._work, name="alerts", daemon=True)
        self._thread.start()

    def observe(self, advices: tuple[Advice, ...]) -> None:
        """Take the advices of one tick; queue an alert for each changed level. Never blocks."""
        for advice in advices:
            # a new reason for unknown is news; the reason for a stop may change with every step
            why = advice.reason if advice.level in (Level.UNKNOWN, Level.FAULT) else None
            is_clear = advice.level is Level.CLEAR  # then the reason is a note
            was = self._states.get(advice.robot)
            if was == (advice.level, why):
                continue
            self._states[advice.robot] = (advice.level, why)
            self._put(
                Alert(
                    at=self._at(),
                    time_s=self._now_s(),
                    robot=self._robots[advice.robot],
                    level=advice.level.name.lower(),
                    was=was[0].name.lower() if was is not None else "none",
                    reason=advice.reason.text,
                    detail=advice.detail,
                    clears_when="" if is_clear else advice.reason.clears_when,
                    separation_m=advice.separation_m,
                    speed_limit_m_s=advice.speed_limit_m_s,
                )
            )

    def observe_zones(self, zones: Sequence[NamedZoneState]) -> None:
        """Take the named zones of one tick; queue an alert for each that changed. Never blocks."""
        for zone in zones:
            if zone.occupied:
                state = "occupied"
            else:
                state = "empty" if zone.entry_s is None else "entry predicted"
            was = self._zones.get(zone.name, "empty")
            if state != was:
                self._zones[zone.name] = state
                self._put(
                    ZoneAlert(
                        at=self._at(),
                        time_s=self._now_s(),
                        zone=zone.name,
                        state=state,
                        was=was,
                        entry_s=zone.entry_s,
                    )
                )

    def _now_s(self) -> float:
        return round((self._clock.now_ns() - self._start_ns) * 1e-9, 3)

    def _at(self) -> str | None:
        return datetime.now(UTC).isoformat(timespec="milliseconds") if self._threaded else None

    def _put(self, alert: AnyAlert) -> None:
        self.count += 1
        if not self._threaded:
            self._tell(alert)
            return
        try:
            self._queue.put_nowait(alert)
        except queue.Full:
            self.dropped += 1

    def stop(self) -> None:
        """Write the queued alerts; a command that still runs may use its time limit, no more."""
        if self._thread is None:
            return
        try:
            self._queue.put(None, timeout=1.0)
        except queue.Full:
            self.dropped += 1
        self._thread.join(timeout=self._settings.timeout_s + 1.0)
        self._thread = None

    def _work(self) -> None:
        pending: dict[str, AnyAlert] = {}  # per robot or zone: its newest change, for the command
        while True:
            try:
                alert = self._queue.get(timeout=self._debounce_left_s() if pending else None)
            except queue.Empty:
                self._run(pending.pop(next(iter(pending))))
                continue
            if alert is None:
                break
            self._tell(alert)
            if self._settings.command:
                subject = alert.robot if isinstance(alert, Alert) else f"zone {alert.zone}"
                pending[subject] = alert
        for alert in pending.values():
            self._run(alert)
        self._wait_for_command()

    def _debounce_left_s(self) -> float:
        if self._last_run_ns is None:
            return 0.0
        passed = (self._clock.now_ns() - self._last_run_ns) * 1e-9
        return max(self._settings.debounce_s - passed, 0.0)

    def _tell(self, alert: AnyAlert) -> None:
        if self._settings.terminal:
            print(alert.line(), file=self._terminal, flush=True)
        if self._file is not None:
            try:
                with self._file.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(alert)) + "\n")
            except OSError as error:
                self.failures += 1
                print(f"alert file {self._file}: {error.strerror}", file=sys.stderr)

    def _run(self, alert: AnyAlert) -> None:
        """Run the user's command; one at a time, each within its time limit."""
        self._wait_for_command()
        self._last_run_ns = self._clock.now_ns()
        assert self._settings.command
        try:
            self._process = subprocess.Popen(
                self._settings.command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL
            )
            assert self._process.stdin
            self._process.stdin.write(json.dumps(asdict(alert)).encode())
            self._process.stdin.close()
        except OSError as error:
            self.failures += 1
            print(f"alert command {self._settings.command[0]}: {error}", file=sys.stderr)

    def _wait_for_command(self) -> None:
        if self._process is None:
            return
        try:
            if self._process.wait(timeout=self._settings.timeout_s) != 0:
                self.failures += 1
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            self.failures += 1
            print("alert command took too long and was ended", file=sys.stderr)
        self._process = None


def alert_file(settings: AlertSettings, base_dir: Path) -> Path | None:
    """Return the file to append to, or ``None`` if none is configured.

    Raises:
        ConfigError: the path is a folder or a named pipe, or its folder does not exist.
    """
    if settings.file is None:
        return None
    path = base_dir / settings.file
    try:
        if path.is_dir():
            raise OSError(errno.EISDIR, "is a folder")
        if not path.parent.is_dir():
            raise OSError(errno.ENOENT, f"the folder {path.parent} does not exist")
        refuse_named_pipe(path)
    except OSError as error:
        raise ConfigError(f"alerts.file {path}: {error.strerror}; name another file") from error
    return path
