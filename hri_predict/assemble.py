"""Builds a node, and all that is connected to it, from a validated configuration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hri_predict import registry
from hri_predict.clock import Clock
from hri_predict.config import Config
from hri_predict.errors import ConfigError, HriPredictError, RobotError
from hri_predict.link import Link, LinkSettings
from hri_predict.node import Listener, Node
from hri_predict.people import People
from hri_predict.prediction import PredictionRunner
from hri_predict.predictors.base import Predictor
from hri_predict.publisher import Publisher
from hri_predict.recording.played_link import played_links
from hri_predict.risk.calibration import Calibration, calibration_for
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.robot import RobotModel, load_robot
from hri_predict.risk.robot_tracker import RobotTracker
from hri_predict.risk.settings import CoverageSettings
from hri_predict.source import Source

LATE_FRACTION = 0.5  # of a cycle: a prediction that takes longer is late


@dataclass(frozen=True)
class Assembly:
    """A node and what it is connected to, built but not started."""

    config: Config
    clock: Clock
    source: Source
    links: tuple[Link, ...]
    prediction: PredictionRunner
    robots: tuple[RobotModel, ...]
    trackers: tuple[RobotTracker, ...]
    node: Node


def build_source(config: Config, with_faults: bool = True) -> Source:
    """The configured source, wrapped in the configured faults."""
    cls = registry.load("sources", config.source.kind)
    source: Source = _built(cls, f"source '{config.source.kind}'", config.source, config.base_dir)
    if config.source.faults and with_faults:
        faulty: Source = registry.load("faults", "source")(source, config.source.faults, seed=0)
        return faulty
    return source


def build_predictor(config: Config) -> Predictor:
    """The configured predictor."""
    cls = registry.load("predictors", config.predictor.name)
    settings = config.predictor.resolved(config.base_dir)
    predictor: Predictor = _built(cls, f"predictor '{settings.name}'", settings)
    return predictor


def build_robots(config: Config) -> tuple[RobotModel, ...]:
    """The robots, in the configuration's order."""
    robots = []
    for index, settings in enumerate(config.node.robots):
        try:
            robots.append(load_robot(settings, config.base_dir))
        except RobotError as error:
            raise RobotError(f"{config.path}: robots.{index}.{error}") from error
    return tuple(robots)


def build_people(config: Config, source: Source, predictor: Predictor) -> People:
    """The stage that follows everybody in the source's scenes."""
    return People(
        config.node.people,
        source.joint_map,
        config.source,
        source.rate_hz,
        source.declares_noise,
        predictor.history_steps,
        predictor.rate_hz,
    )


def build_risk(
    config: Config, source: Source, predictor: Predictor, trackers: Sequence[RobotTracker]
) -> RiskEngine:
    """The risk stage for the forecasts of ``predictor`` and these robots."""
    return RiskEngine(
        config.node.risk,
        trackers,
        predictor.skeleton,
        config.node.people.absent_parts,
        config.node.zones,
        config.source.field_of_view,
        build_budget(config, source),
        predictor.rate_hz,
        predictor.horizon_steps,
        build_calibration(config),
    )


def build_calibration(config: Config) -> Calibration | None:
    """The calibration that the zones use; ``None`` where there is none, or no use for it."""
    if config.node.risk.mode != "predictive":
        return None
    settings = config.predictor.resolved(config.base_dir)
    return calibration_for(settings, config.node.risk.coverage, config.base_dir)


def unused_coverage(config: Config) -> str:
    """A line for the user if ``risk.coverage`` is set where nothing asks for it, or ""."""
    risk = config.node.risk
    if risk.mode == "predictive" or risk.coverage == CoverageSettings():
        return ""
    return (
        f"risk.coverage has no effect: mode {risk.mode} uses no forecast, calibrated or not; "
        f"set mode: predictive, or leave it out"
    )


def advised_on_links(config: Config) -> list[frozenset[int]]:
    """Indices of the robots that are advised on each opened link."""
    return [frozenset(_advised(config, settings)) for settings in config.opened_links]


def _built(cls: Any, what: str, *arguments: Any) -> Any:
    """Construct a source or predictor, a third party's perhaps.

    Raises:
        HriPredictError: its own, or one that names what failed in it.
    """
    try:
        return cls(*arguments)
    except HriPredictError:
        raise
    except Exception as error:
        raise ConfigError(
            f"{what} cannot be built: {type(error).__name__}: {error}; mend it, or its settings"
        ) from error


def build_budget(config: Config, source: Source) -> DelayBudget:
    """The delay budget of the worst link."""
    stale_s = config.source.stale_s or 3.0 / source.rate_hz + 0.02
    return DelayBudget.from_settings(config.node.rate_hz, config.links, stale_s)


def build_link(
    settings: LinkSettings, config: Config, clock: Clock, port: str | None, transport: Any | None
) -> Link:
    """One link; ``port`` replaces the configured device, ``transport`` the device as such.

    Raises:
        ConfigError: a simulated link has nothing at its other end.
    """
    cls = registry.load("links", settings.kind)
    if settings.simulate is not None and port is None and transport is None:
        raise ConfigError(f"link {settings.name}: nobody simulates its other end")
    if port is not None:
        settings = settings.model_copy(update={cls.port_field: port})
    settings = settings.resolved(config.base_dir)
    rate_hz, robots = config.node.rate_hz, _advised(config, settings)
    cls.check_load(settings, rate_hz, robots)
    if settings.faults:
        faulty = registry.load("faults", "link")
        inner = transport if transport is not None else cls.make_transport(settings)
        transport = faulty(inner, settings.faults, clock, seed=0)
    link: Link = cls(settings, clock, transport, rate_hz=rate_hz, robots=robots)
    return link


def _advised(config: Config, link: LinkSettings) -> list[int]:
    """Indices of the robots that are advised on a link."""
    return [
        i
        for i, robot in enumerate(config.node.robots)
        if not link.robots or robot.name in link.robots
    ]


def build(
    config: Config,
    clock: Clock,
    *,
    source: Source | None = None,
    ports: Mapping[str, str] | None = None,
    transports: Mapping[str, Any] | None = None,
    deadline: bool = True,
    shadow: bool = False,
    listeners: Sequence[Listener] = (),
) -> Assembly:
    """Build everything; nothing is opened or started yet.

    ``listeners`` is kept, not copied: until the first tick others may join.

    Raises:
        HriPredictError: some part cannot be built; one line with the remedy.
    """
    node = config.node
    source = source or build_source(config)
    predictor = build_predictor(config)
    robots = build_robots(config)
    trackers = tuple(
        RobotTracker(settings, model, config.base_dir, clock.now_ns())
        for settings, model in zip(node.robots, robots, strict=True)
    )
    people = build_people(config, source, predictor)
    risk = build_risk(config, source, predictor, trackers)
    links: tuple[Link, ...] = tuple(
        build_link(
            settings,
            config,
            clock,
            (ports or {}).get(settings.name),
            (transports or {}).get(settings.name),
        )
        for settings in config.opened_links
    ) or played_links(source, clock)
    prediction = PredictionRunner(predictor, LATE_FRACTION / node.rate_hz if deadline else None)
    everybody = frozenset(range(len(robots)))
    advised = advised_on_links(config) or [everybody for _ in links]
    publisher = Publisher(links, advised, predictor, shadow)
    index = registry.names("predictors").index(config.predictor.name)
    return Assembly(
        config=config,
        clock=clock,
        source=source,
        links=links,
        prediction=prediction,
        robots=robots,
        trackers=trackers,
        node=Node(people, prediction, risk, trackers, links, advised, publisher, index, listeners),
    )
