"""Alerts when a robot's level or a named zone changes: a log line, JSON, and hooks.

The node's loop only queues a change. A thread writes the line and the file; each hook has its own
thread (``hri_predict.operation.alerting``).
"""

import errno
import json
import os
import queue
import sys
import threading
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TextIO

from pydantic import Field

from hri_predict.base.clock import Clock
from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import demand_kind
from hri_predict.base.settings import Settings
from hri_predict.operation.alerting.alert import Alert, ZoneAlert, as_data, more
from hri_predict.operation.alerting.command import CommandHook
from hri_predict.operation.alerting.hooks import Hooks
from hri_predict.operation.alerting.kinds import KINDS, AnyHook
from hri_predict.operation.alerting.sender import HookContext
from hri_predict.operation.alerting.settings import HookSettings
from hri_predict.operation.monitoring.flapping import Change, Flapping
from hri_predict.operation.monitoring.remote import REMEDY, WATCH_S, Remote
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import NamedZoneState

_WRITE_S = 1.0
"""Maximum time to write the queue when the node stops."""


class AlertSettings(Settings):
    """``alerts:`` in the configuration."""

    terminal: bool = Field(True, description="print a line on standard error for each change")
    file: str | None = Field(None, min_length=1, description="append JSON lines to this file")
    command: list[str] | None = Field(
        None,
        description="program and arguments to run; it reads the alert as JSON from standard input",
    )
    debounce_s: float = Field(
        1.0, ge=0, le=60, description="minimum time between two runs of the command for one robot"
    )
    timeout_s: float = Field(5.0, ge=0.1, le=600, description="kill a command that runs longer")
    to: list[AnyHook] = Field(
        [], max_length=16, description=f"further receivers: {', '.join(KINDS)}"
    )

    @property
    def hooks(self) -> list[HookSettings]:
        """All receivers besides terminal and file, ``command`` first."""
        if not self.command:
            return list(self.to)
        first = CommandHook(
            kind="command",
            command=self.command,
            debounce_s=self.debounce_s,
            timeout_s=self.timeout_s,
            rate_per_minute=6000,
        )
        return [first, *self.to]


class Alerts:
    """Watches levels and named zones, and raises an alert when one changes.

    An alternating level is reported with the number of its changes (``Flapping``); the file
    contains every change. A robot far from all observed people also raises one alert (``Remote``).

    On the virtual clock there is no thread: alerts are written synchronously and hooks do not send.

    ``dropped`` counts alerts that were not written because the thread could not keep up.
    ``failures`` counts lines that could not be written to file or terminal, and failed attempts of
    hooks.

    Raises:
        ConfigError: the alert file cannot be written, or a hook cannot be used.
    """

    def __init__(
        self,
        *,
        settings: AlertSettings,
        robots: list[str],
        zones: Sequence[str] = (),
        clock: Clock,
        base_dir: Path,
        cell: str = "cell",
        terminal: TextIO | None = None,
        threaded: bool = True,
    ) -> None:
        self._settings = settings
        self._robots = robots
        self._zone_names = tuple(zones)
        self._clock = clock
        self._start_ns = clock.now_ns()
        self._terminal = terminal if terminal is not None else sys.stderr
        self._threaded = threaded
        self._states: dict[int, tuple[Level, Reason | None, Reason | None]] = {}
        self._zones: dict[str, str] = {}
        self._remote = Remote()
        self._flapping = Flapping()
        self._queue: queue.Queue[tuple[Change | None, Change | None] | None]
        self._queue = queue.Queue(maxsize=256)
        self._file = alert_file(settings, base_dir)
        self._thread: threading.Thread | None = None
        place = HookContext(base_dir=base_dir, cell=cell)
        self._base_dir = base_dir
        self._hooks = Hooks(settings.hooks if threaded else [], place)
        self.count = self.dropped = self._write_failures = 0

    @property
    def failures(self) -> int:
        """Number of failed writes and failed attempts of hooks."""
        return self._write_failures + self._hooks.failures

    def report(self) -> list[dict[str, Any]]:
        """Return the hooks' rows in the summary."""
        return self._hooks.report()

    def take(self, settings: AlertSettings) -> Callable[[], None]:
        """Check new settings, and return a function that applies them while the node runs.

        Raises:
            ConfigError: as for the constructor; nothing has changed.
        """
        file = alert_file(settings, self._base_dir)
        exchange = self._hooks.exchange(settings.hooks)

        def put_in_force() -> None:
            self._settings, self._file = settings, file
            exchange()

        return put_in_force

    def start(self) -> None:
        """Start the threads that write alerts and deliver them."""
        self._thread = threading.Thread(target=self._work, name="alerts", daemon=True)
        self._thread.start()
        self._hooks.start()

    def observe(self, advices: tuple[Advice, ...], reasons: Sequence[Reason] = ()) -> None:
        """Process the advice of one tick; queue an alert for each changed level.

        Never blocks. ``reasons`` are those of Status; a reason with ``is_news`` raises an alert at
        any level.
        """
        for held in self._flapping.due(self._now_s()):
            self._hand_over(None, held)
        condition = next((reason for reason in reasons if reason.row.is_news), None)
        for advice in advices:
            self._watch_distance(advice)
            # a new reason for unknown is news; the reason for a stop may change with every step
            why = advice.reason if advice.level in (Level.UNKNOWN, Level.FAULT) else None
            is_clear = advice.level is Level.CLEAR  # then the reason is a note
            was = self._states.get(advice.robot)
            if was == (advice.level, why, condition):
                continue
            self._states[advice.robot] = (advice.level, why, condition)
            begins = condition is not None and (was is None or was[2] is not condition)
            reason, detail = advice.reason, advice.detail
            if begins and condition is not None:
                reason = condition
                others = [detail] if detail and condition.text not in detail else []
                told = f"{self._robots[advice.robot]}: {condition.text}"
                detail = "; ".join([told, f"clears when {condition.clears_when}", *others])
            self._put(
                Alert(
                    at=self._at(),
                    time_s=self._now_s(),
                    robot=self._robots[advice.robot],
                    level=advice.level.name.lower(),
                    was=was[0].name.lower() if was is not None else "none",
                    reason=reason.text,
                    detail=detail,
                    clears_when="" if is_clear and not begins else reason.clears_when,
                    separation_m=advice.separation_m,
                    speed_limit_m_s=advice.speed_limit_m_s,
                )
            )

    def _watch_distance(self, advice: Advice) -> None:
        """Report a robot that is far from every observed person."""
        away_m = self._remote.observe(advice, self._now_s())
        if away_m is None:
            return
        robot, level = self._robots[advice.robot], advice.level.name.lower()
        self._put(
            Alert(
                at=self._at(),
                time_s=self._now_s(),
                robot=robot,
                level=level,
                was=level,
                reason="no person was seen near it",
                detail=f"{robot}: no person was seen nearer than {away_m:.1f} m within "
                f"{WATCH_S:g} s; {REMEDY}",
                clears_when="",
                separation_m=advice.separation_m,
                speed_limit_m_s=advice.speed_limit_m_s,
            )
        )

    def observe_zones(self, zones: Sequence[NamedZoneState] | None) -> None:
        """Process the named zones of one tick; queue an alert for each changed zone. Never
        blocks.

        ``None``: the tick has no states. People may be anywhere, so each zone is occupied, as for
        an untrusted input; else the last "empty" would stand through a fault.
        """
        if zones is None:
            zones = [NamedZoneState(name, True, 0.0) for name in self._zone_names]
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

    def _put(self, change: Change) -> None:
        self.count += 1
        self._hand_over(change, self._flapping.take(change))

    def _hand_over(self, change: Change | None, reported: Change | None) -> None:
        """Write every change to the file, and pass the reported ones to terminal and hooks."""
        if not self._threaded:
            self._tell(change, reported)
            return
        if reported is not None:
            self._hooks.put(reported)
        try:
            self._queue.put_nowait((change, reported))
        except queue.Full:
            self.dropped += 1

    def stop(self) -> None:
        """Write the queued alerts and let each hook try once more, within its time limit."""
        for held in self._flapping.rest():
            self._hand_over(None, held)
        if self._thread is None:
            return
        begun = time.monotonic()
        self._hooks.stop()
        try:
            self._queue.put(None, timeout=_WRITE_S)
        except queue.Full:
            self.dropped += 1
        self._thread.join(timeout=_WRITE_S)
        self._hooks.join(begun)
        self._thread = None

    def _work(self) -> None:
        while (item := self._queue.get()) is not None:
            self._tell(*item)

    def _tell(self, change: Change | None, reported: Change | None) -> None:
        if self._file is not None and change is not None:
            try:
                _append(self._file, json.dumps(as_data(change)).encode() + b"\n")
            except OSError as error:
                self._write_failures += 1
                self._print(f"alert file {self._file}: {error.strerror}", sys.stderr)
        if self._settings.terminal and reported is not None:
            self._print(reported.line() + more(reported.held_back), self._terminal)

    def _print(self, line: str, stream: TextIO) -> None:
        """Print a line, or count the failure: a full disk must not stop the alerts."""
        try:
            print(line, file=stream, flush=True)
        except (OSError, ValueError):  # ValueError: it was closed
            self._write_failures += 1


def _append(path: Path, line: bytes) -> None:
    """Append a line completely or not at all, after ending a last line cut short by a kill.

    Raises:
        OSError: it cannot be written.
    """
    with path.open("a+b", buffering=0) as file:
        end = file.seek(0, os.SEEK_END)
        if end:
            file.seek(-1, os.SEEK_END)
            line = line if file.read(1) == b"\n" else b"\n" + line
        if file.write(line) < len(line):  # the disk is full now: a part of a line says nothing
            file.truncate(end)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def alert_file(settings: AlertSettings, base_dir: Path) -> Path | None:
    """Return the file to append to, or ``None`` if none is configured.

    Raises:
        ConfigError: the path is not a file, or its folder does not exist.
    """
    if settings.file is None:
        return None
    path = base_dir / settings.file
    with OsErrorAs(ConfigError, f"alerts.file {path}", "name another file"):
        demand_kind(path)
        if not path.parent.is_dir():
            raise OSError(errno.ENOENT, f"the folder {path.parent} does not exist")
    return path
