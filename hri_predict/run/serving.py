"""Operational parts of a real-time run: systemd, monitoring, reload."""

import logging
import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from typing import Any

from hri_predict.base.errors import ConfigError, HriPredictError, failure
from hri_predict.node.listeners import Listener
from hri_predict.operation.foxglove.live import FoxgloveLive
from hri_predict.operation.monitoring.alerts import Alerts
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.operation.service import logs
from hri_predict.operation.service.figures import Figures
from hri_predict.operation.service.notify import Notifier
from hri_predict.operation.service.server import MetricsServer
from hri_predict.operation.service.settings import MetricsSettings
from hri_predict.operation.service.watched import Watched
from hri_predict.recording.folder.folder import Folder
from hri_predict.recording.mcap.clocks import SystemClocks
from hri_predict.recording.mcap.places import RecordingFiles
from hri_predict.recording.mcap.to_dict import counters_of
from hri_predict.run.assemble import Assembly
from hri_predict.run.config import Config, NodeSettings
from hri_predict.run.recording import info_of

# -- reads the configuration again while the node runs, and takes what may change safely -----------
#
# What decides about robots and people, or opens a device, never changes under a running node: it
# was checked, and commissioned, as a whole. Such keys are named, and wait for a restart.

log = logging.getLogger(__name__)

Takes = Callable[[NodeSettings], Callable[[], None]]
"""Checks new settings, raising HriPredictError if they are wrong, and returns a function that
applies them and never fails.
"""


class Reload:
    """Reload of a service on SIGHUP.

    Args:
        config: the current configuration.
        load: reads the configuration again, as at the start.
        parts: key or dotted key of the configuration -> function that receives it with all nested
            keys. They are called in this order.
        notifier: notified when a reload starts and ends.

    Attributes:
        count, failures: number of reloads, and of those without effect because the new file is
            wrong.
    """

    def __init__(
        self,
        config: Config,
        load: Callable[[], Config],
        parts: Mapping[str, Takes],
        notifier: Notifier | None = None,
    ) -> None:
        self._load, self._parts, self._notifier = load, parts, notifier
        self._running: dict[str, Any] = config.node.model_dump()
        self.count = self.failures = 0
        self._asked: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Wait for ``ask`` in a thread, because reading a configuration takes longer than a
        tick.
        """
        self._thread = threading.Thread(target=self._work, name="reload", daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """Request a reload. A signal handler may call this, because ``SimpleQueue.put`` is
        reentrant.
        """
        self._asked.put(True)

    def close(self) -> None:
        """Stop reloading; safe to call twice."""
        if self._thread is not None:
            self._asked.put(False)
            self._thread.join(2.0)
            self._thread = None

    def now(self) -> None:
        """Read the file; apply the settings that may change, or nothing if the file has a
        mistake.
        """
        self.count += 1
        if self._notifier is not None:
            self._notifier.reloading()
        try:
            said = self._take(self._load())
        except HriPredictError as error:
            self.failures += 1
            first, *others = str(error).splitlines()
            more = f" (and {len(others)} more: hri-predict check)" if others else ""
            said = [f"nothing changed: {first}{more}"]
        except BaseException as error:  # the node continues as it was
            failure(error)
            self.failures += 1
            said = [f"nothing changed: {type(error).__name__}: {error}"]
        for line in said:
            log.warning("reload: %s", line)
        if self._notifier is not None:
            self._notifier.ready(f"reload: {'; '.join(said)}")

    def _take(self, new: Config) -> list[str]:
        wanted = new.node.model_dump()
        changed = list(differences(self._running, wanted))
        taken = {key: part for key in changed if (part := self._part_of(key)) is not None}
        parts = [part for part in self._parts if part in taken.values()]
        put_in_force = [self._parts[part](new.node) for part in parts]
        for each in put_in_force:
            each()
        for part in parts:
            _copy(part.split("."), wanted, self._running)
        said = [f"{key}: changed" for key in taken]
        said += [f"{key}: needs a restart" for key in changed if key not in taken]
        return said or ["nothing differs"]

    def _part_of(self, key: str) -> str | None:
        fits = (part for part in self._parts if key == part or key.startswith(f"{part}."))
        return next(fits, None)

    def _work(self) -> None:
        while self._asked.get():
            self.now()


def differences(old: Any, new: Any, at: str = "") -> Iterator[str]:
    """Return the dotted keys that differ; if a list's length changed, the list's own key."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            where = f"{at}.{key}" if at else str(key)
            if key not in old or key not in new:
                yield where
            else:
                yield from differences(old[key], new[key], where)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from differences(a, b, f"{at}.{i}")
    elif old != new:
        yield at


def _copy(keys: list[str], source: dict[str, Any], target: dict[str, Any]) -> None:
    for key in keys[:-1]:
        source, target = source[key], target[key]
    target[keys[-1]] = source[keys[-1]]


# --------------------------------------------------------------------------------------------------

RECORD_LIMITS = ("max_minutes", "max_mb", "keep_days", "budget_gb", "min_free_gb")
"""Keys of ``record`` that can be changed while a folder of recordings is in use."""


class Serving:
    """The service functions of one run.

    Args:
        config: configuration of the run.
        notifier: the service manager, if it expects reports of the node's state.
        reread: reads the configuration again, for SIGHUP; ``None``: SIGHUP stops the node.

    Attributes:
        pace: statistics of the loop.
        hangup: action on SIGHUP; ``None``: stop the node.
    """

    def __init__(
        self, config: Config, notifier: Notifier | None, reread: Callable[[], Config] | None
    ) -> None:
        self._config, self._notifier = config, notifier
        self._settings: MetricsSettings | None = None
        self._server: MetricsServer | None = None
        self._figures: Figures | None = None
        self._foxglove: FoxgloveLive | None = None
        # in this order: metrics last, because to check them opens a socket
        self._parts: dict[str, Callable[[NodeSettings], Callable[[], None]]] = {"log": _take_log}
        self._reload = Reload(config, reread, self._parts, notifier) if reread else None
        self.hangup = self._reload.ask if self._reload is not None else None
        self.pace = Pace()

    def listeners(
        self,
        assembly: Assembly,
        others: Callable[[], Mapping[str, int]],
        place: RecordingFiles | None,
        alerts: Alerts,
    ) -> list[Listener]:
        """Start; return listeners of the node, to be added after all other listeners.

        ``others`` returns counters of further parts; ``place`` is the path of the recording;
        ``alerts`` accepts new settings.

        Raises:
            ConfigError: the metrics' or Foxglove's port is in use, or its package is missing.
        """
        settings, found = self._config.node.metrics, list[Listener]()
        if (shown := self._config.node.foxglove) is not None:
            self._foxglove = FoxgloveLive(
                shown,
                info_of(self._config, assembly.source, assembly),
                clocks=SystemClocks(assembly.clock),
                counters=self.recorded(assembly),
            )
            found.append(self._foxglove)
        robots = [robot.name for robot in assembly.robots]
        if settings is not None or self._reload is not None:
            self._figures = Figures(
                node=assembly.node,
                source=assembly.source,
                links=assembly.links,
                pace=self.pace,
                robots=robots,
                version=version("hri-predict"),
                healthy_s=0.0,
                others=lambda: {**others(), **self._counters()},
            )
            found.append(self._figures)
            self._take_metrics(self._config.node)()
        if self._reload is not None:
            if isinstance(place, Folder):
                self._parts |= {f"record.{key}": _takes_limits(place) for key in RECORD_LIMITS}
            self._parts["alerts"] = lambda node: alerts.take(node.alerts)
            self._parts["metrics"] = self._take_metrics
            self._reload.start()
        if self._notifier is not None:
            found.append(Watched(self._notifier, robots))
        return found

    def recorded(self, assembly: Assembly) -> Callable[[], Mapping[str, Any]]:
        """Return the function that gives the counters for recordings."""

        def counters() -> Mapping[str, Any]:
            late = assembly.prediction.counters.get("predictor_late", 0)
            loop = {
                "late_ticks": self.pace.late_ticks,
                "missed_ticks": self.pace.missed_ticks,
                "predictor_late": late,
            }
            return counters_of(assembly.node, assembly.links, loop)

        return counters

    def close(self) -> None:
        """Stop all started parts; safe to call twice."""
        if self._reload is not None:
            self._reload.close()
        if self._server is not None:
            self._server.close()
            self._server = None
        if self._foxglove is not None:
            self._foxglove.close()

    @property
    def lost(self) -> dict[str, int]:
        """Return the counters of items that Foxglove did not receive, for the summary."""
        return {} if self._foxglove is None else self._foxglove.counts()

    def _take_metrics(self, node: NodeSettings) -> Callable[[], None]:
        """Listen at the new address of ``metrics``, and close the old server once the change is
        certain.
        """
        settings, figures, before = node.metrics, self._figures, self._settings
        assert figures is not None
        server = self._server
        if settings is None:
            server = None
        elif before is None or (settings.host, settings.port) != (before.host, before.port):
            server = self._metrics_at(settings, figures)

        def put_in_force() -> None:
            if settings is not None:
                figures.healthy_s = settings.healthy_periods / self._config.node.rate_hz
            if self._server is not None and self._server is not server:
                self._server.close()
            self._server, self._settings = server, settings

        return put_in_force

    def _metrics_at(self, settings: MetricsSettings, figures: Figures) -> MetricsServer:
        """Listen at a new address of ``metrics``.

        The old server gives way first if it has the same port, because a port of all addresses is
        in use while a server has it at one of them. It returns if the new one cannot listen.
        """
        before = self._settings
        if self._server is None or before is None or settings.port != before.port:
            return MetricsServer(settings, figures)
        self._server.close()
        try:
            return MetricsServer(settings, figures)
        except ConfigError:
            self._server = MetricsServer(before, figures)
            raise

    def _counters(self) -> dict[str, int]:
        counts = logs.counters()
        if self._reload is not None:
            counts |= {"reloads": self._reload.count, "reload_failures": self._reload.failures}
        if self._notifier is not None:
            counts["notifications_lost"] = self._notifier.lost
        if (server := self._server) is not None:
            counts |= {"metrics_refused": server.refused, "metrics_failed": server.failed}
        return counts


def _take_log(node: NodeSettings) -> Callable[[], None]:
    return lambda: logs.use(node.log)


def _takes_limits(folder: Folder) -> Callable[[NodeSettings], Callable[[], None]]:
    def take(node: NodeSettings) -> Callable[[], None]:
        settings = node.record
        assert settings is not None  # else the key 'record' itself differs
        return lambda: folder.limit(settings)

    return take
