"""Parts of a run in real time for those who operate it: systemd, monitoring, reload."""

from collections.abc import Callable, Mapping
from importlib.metadata import version

from hri_predict.node.listeners import Listener
from hri_predict.operation.monitoring.alerts import Alerts
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.operation.service import logs
from hri_predict.operation.service.figures import Figures
from hri_predict.operation.service.notify import Notifier
from hri_predict.operation.service.server import MetricsServer
from hri_predict.operation.service.settings import MetricsSettings
from hri_predict.operation.service.watched import Watched
from hri_predict.recording.folder.folder import Folder
from hri_predict.recording.mcap.places import RecordingFiles
from hri_predict.run.assemble import Assembly
from hri_predict.run.config import Config, NodeSettings
from hri_predict.run.reload import Reload

RECORD_LIMITS = ("max_minutes", "max_mb", "keep_days", "budget_gb", "min_free_gb")
"""Keys of ``record`` that a folder of recordings takes while it is in use."""


class Serving:
    """The service's side of one run.

    Args:
        config: configuration of the run.
        notifier: the service manager, if it wants reports of the node's state.
        reread: reads the configuration again, for SIGHUP; ``None``: SIGHUP ends the node.

    Attributes:
        pace: of the loop.
        hangup: action on SIGHUP; ``None``: it ends the node.
    """

    def __init__(
        self, config: Config, notifier: Notifier | None, reread: Callable[[], Config] | None
    ) -> None:
        self._config, self._notifier = config, notifier
        self._settings: MetricsSettings | None = None
        self._server: MetricsServer | None = None
        self._figures: Figures | None = None
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
        """Start; return what listens to the node, to be added after all other listeners.

        ``others`` counts what further parts did; ``place`` is where the run is recorded; ``alerts``
        takes new settings.

        Raises:
            ConfigError: the metrics' port is in use.
        """
        settings, found = self._config.node.metrics, list[Listener]()
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

    def close(self) -> None:
        """Stop what was started; safe to call twice."""
        if self._reload is not None:
            self._reload.close()
        if self._server is not None:
            self._server.close()
            self._server = None

    def _take_metrics(self, node: NodeSettings) -> Callable[[], None]:
        """Listen where ``metrics`` says now, and stop listening elsewhere once that is sure."""
        settings, figures, before = node.metrics, self._figures, self._settings
        assert figures is not None
        server = self._server
        if settings is None:
            server = None
        elif before is None or (settings.host, settings.port) != (before.host, before.port):
            server = MetricsServer(settings, figures)

        def put_in_force() -> None:
            if settings is not None:
                figures.healthy_s = settings.healthy_periods / self._config.node.rate_hz
            if self._server is not None and self._server is not server:
                self._server.close()
            self._server, self._settings = server, settings

        return put_in_force

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
