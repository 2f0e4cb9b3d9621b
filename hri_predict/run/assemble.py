"""Builds a node and everything connected to it from a validated configuration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hri_predict.base.clock import Clock
from hri_predict.base.errors import ConfigError
from hri_predict.base.machine.realtime import can_have_process
from hri_predict.base.settings import Region
from hri_predict.contracts import registry
from hri_predict.contracts.link import (
    Link,
    LinkLoad,
    LinkSettings,
    Simulatable,
    Transport,
    check_load,
)
from hri_predict.contracts.predictor import Predictor, PredictorSettings
from hri_predict.contracts.repetition import messages_hz
from hri_predict.contracts.source import HasTwin, Source
from hri_predict.node.node import Listener, Node
from hri_predict.node.publisher import Publisher
from hri_predict.node.repeats import Repeats
from hri_predict.people.merging.source import MergedSource
from hri_predict.people.people import People
from hri_predict.predictors.building import predictor_of
from hri_predict.predictors.process.remote import Job
from hri_predict.predictors.process.runner import ProcessRunner
from hri_predict.predictors.thread_runner import Prediction, PredictionRunner
from hri_predict.protocol.wire import StateShape
from hri_predict.recording.played_link import played_links
from hri_predict.risk.delay_budget import DelayBudget
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.levels.latches import random_latch_id
from hri_predict.robots.model import RobotModel, load_robot
from hri_predict.robots.tracker import RobotTracker
from hri_predict.run.advised import advised, of_robots, with_age_limit
from hri_predict.run.config import Config
from hri_predict.run.each_robot import each_robot
from hri_predict.run.places import check_places
from hri_predict.run.ticks import phase_of
from hri_predict.zones.calibration import Calibration, calibration_for

LATE_FRACTION = 0.5  # of a cycle: a prediction that takes longer is late


@dataclass(frozen=True, kw_only=True)
class Assembly:
    """A node and everything connected to it, built but not started."""

    config: Config
    clock: Clock
    source: Source
    links: tuple[Link, ...]
    prediction: Prediction
    robots: tuple[RobotModel, ...]
    trackers: tuple[RobotTracker, ...]
    node: Node
    last_latch_id: int = 0


def build_source(config: Config, with_faults: bool = True) -> Source:
    """Build the configured source, wrapped in the configured faults."""
    cls = registry.load("sources", config.source.kind)
    with config.naming_lines(), registry.building(f"source '{config.source.kind}'"):
        source = cls(config.source, config.base_dir)
    if isinstance(source, MergedSource):
        source.judge_by(config.node.people)
    if config.source.faults and with_faults:
        return registry.load("faults", "source")(source, config.source.faults, seed=0)
    return source


def build_again(config: Config, source: Source) -> Source:
    """Return a second source like ``source``, but without faults."""
    return source.twin() if isinstance(source, HasTwin) else build_source(config, with_faults=False)


def build_predictor(config: Config) -> Predictor:
    """Build the configured predictor."""
    with config.naming_lines():
        return predictor_of(config.predictor.resolved(config.base_dir))


def build_prediction(config: Config) -> Prediction:
    """Return the runner of the predictor in real time, in a separate process if configured.

    The caller must stop it. A process is started immediately, and can predict after
    ``wait_until_ready``.

    Raises:
        HriPredictError: the predictor cannot be built; one line with the remedy.
    """
    settings, realtime = config.predictor.resolved(config.base_dir), config.node.realtime
    deadline_s = LATE_FRACTION / config.node.rate_hz
    if not has_own_process(settings):
        return PredictionRunner(predictor_of(settings), deadline_s)
    job = Job(
        settings=settings,
        people=config.node.people.max_people,
        cpus=realtime.inference_cpus,
        lock_memory=realtime.lock_memory,
    )
    return ProcessRunner(job, deadline_s)


def has_own_process(settings: PredictorSettings) -> bool:
    """Whether a predictor gets a separate process in real time."""
    if settings.process == "auto":
        return settings.takes_long and can_have_process()
    return settings.process


def build_robots(config: Config) -> tuple[RobotModel, ...]:
    """Load the robots, in the configuration's order.

    Raises:
        RobotError, ConfigMistakes: one or several robots are wrong; one line for each.
    """
    return each_robot(config, lambda _, own: load_robot(own, config.base_dir))


def build_trackers(
    config: Config, models: Sequence[RobotModel], start_ns: int
) -> tuple[RobotTracker, ...]:
    """Return a new tracker of each robot.

    Raises:
        RobotError, ConfigMistakes: one or several motions do not fit; one line for each.
    """
    return each_robot(
        config, lambda i, own: RobotTracker(own, models[i], config.base_dir, start_ns)
    )


def build_people(config: Config, source: Source, predictor: Predictor) -> People:
    """Build the stage that tracks the people in the source's scenes."""
    return People(
        settings=config.node.people,
        joint_map=source.joint_map,
        source_settings=config.source,
        rate_hz_source=source.rate_hz,
        declares_noise=source.declares_noise,
        history_steps=predictor.history_steps,
        rate_hz_predictor=predictor.rate_hz,
    )


def build_risk(
    config: Config,
    source: Source,
    predictor: Predictor,
    trackers: Sequence[RobotTracker],
    *,
    obeyed: bool = False,
    last_latch_id: int | None = None,
    budget: DelayBudget | None = None,
    calibration: Calibration | None = None,
) -> RiskEngine:
    """Build the risk stage for these robots and the forecasts of ``predictor``.

    ``obeyed``: the robots follow its advice. ``last_latch_id``: see ``LatchIds``. ``budget``,
    ``calibration``: the delays and the calibration of the zones; by default the configuration's.
    """
    return RiskEngine(
        settings=config.node.risk,
        robots=trackers,
        skeleton=predictor.skeleton,
        absent_parts=config.node.people.absent_parts,
        named_zones=config.node.zones,
        field_of_view=config.source.field_of_view,
        budget=budget or build_budget(config, source),
        forecast_rate_hz=predictor.rate_hz,
        horizon_steps=predictor.horizon_steps,
        calibration=calibration or build_calibration(config),
        doors=_doors(config),
        obeyed=obeyed,
        floor_m=config.node.people.floor_m,
        last_latch_id=last_latch_id,
        base_dir=config.base_dir,
    )


def _doors(config: Config) -> dict[str, Region]:
    people = config.node.people
    doors = {"exits": people.exits, "entrances": people.entrances or ()}
    return {
        config.place("people", kind, i): region
        for kind, regions in doors.items()
        for i, region in enumerate(regions)
    }


def build_calibration(config: Config) -> Calibration | None:
    """Load the calibration of the zones; ``None`` if there is none or the mode needs none."""
    if not config.node.risk.uses_forecasts:
        return None
    settings = config.predictor.resolved(config.base_dir)
    with config.naming_lines():
        return calibration_for(settings, config.node.risk.coverage, config.base_dir)


def advised_on_links(config: Config) -> list[frozenset[int]]:
    """Return, for each opened link, the indices of the robots whose advice it carries."""
    return [frozenset(advised(config, settings)) for settings in config.opened_links]


def build_budget(config: Config, source: Source) -> DelayBudget:
    """Return the delay budget of the slowest link."""
    stale_s = config.source.stale_after_s(source.rate_hz)
    return DelayBudget.from_settings(config.node.rate_hz, config.links, stale_s)


def completed(config: Config, settings: LinkSettings) -> LinkSettings:
    """Return a link's settings with its paths, and the defaults that depend on the cell.

    Raises:
        LinkError: they do not fit the link's robots.
    """
    settings = of_robots(config, settings.resolved(config.base_dir))
    return with_age_limit(
        config, settings, lambda: build_budget(config, build_source(config, with_faults=False))
    )


def build_repeats(config: Config, source: Source, links: Sequence[Link]) -> Repeats:
    """Build the repeater of Status and Advice, which repeats as long as the delay budget covers
    it.
    """
    budget = build_budget(config, source)
    intervals_s = [settings.repeat_s for settings in config.opened_links]
    return Repeats(links, intervals_s, budget.encoding_s + budget.cycle_s)


def build_link(
    config: Config,
    settings: LinkSettings,
    clock: Clock,
    *,
    port: str | None = None,
    transport: Transport[Any] | None = None,
) -> Link:
    """Build one link; ``port`` replaces the configured port, ``transport`` the whole transport.

    Raises:
        ConfigError: the link has ``simulate:`` but no simulated controller is running.
    """
    cls = registry.load("links", settings.kind)
    if settings.simulate is not None and port is None and transport is None:
        raise ConfigError(
            f"link '{settings.name}' has 'simulate:' but no simulated controller is running; "
            f"use hri-predict run or demo, or remove 'simulate'"
        )
    if port is not None:
        if not isinstance(cls, Simulatable):
            raise ConfigError(f"link {settings.name}: kind '{settings.kind}' cannot be simulated")
        settings = settings.model_copy(update={cls.port_field: port})
    settings = completed(config, settings)
    robots = advised(config, settings)
    shapes = state_shapes(config, robots)
    with registry.building(f"link '{settings.name}'"):
        rate_hz = _checked_rate_hz(config, settings)
        if settings.faults:
            faulty = registry.load("faults", "link")
            inner = transport if transport is not None else cls.make_transport(settings)
            transport = faulty(inner=inner, faults=settings.faults, clock=clock, seed=0)
        return cls(settings, clock, transport, rate_hz=rate_hz, robots=robots, shapes=shapes)


def _checked_rate_hz(config: Config, settings: LinkSettings) -> float:
    """Return the maximum rate of Status and Advice.

    Raises:
        LinkError: the link does not carry that rate.
    """
    node = config.node
    key = "rate_hz" if node.ticks == "fixed" else "max_rate_hz"
    once = settings.model_copy(update={"repeat_hz": 0})
    check_load(
        load_of(config, once), lambda hz: f"lower {key} from {node.largest_rate_hz:g} to {int(hz)}"
    )

    def slower(hz: float) -> str:
        # of a cycle of fixed length, a whole number is sent; of another, at most twice as many
        fits_hz = hz // node.rate_hz * node.rate_hz if node.ticks == "fixed" else hz / 2
        fits_hz = fits_hz if fits_hz > node.rate_hz else 0
        return (
            f"lower repeat_hz from {1 / settings.repeat_s:.3g} to {int(fits_hz)} (and raise "
            "silence_timeout_s, also in the controller)"
        )

    load = load_of(config, settings)
    check_load(load, slower)
    return load.rate_hz


def load_of(config: Config, settings: LinkSettings) -> LinkLoad:
    """Return the load of a link with its advised robots.

    Raises:
        LinkError: this kind of link cannot carry the RobotState of one of them.
    """
    settings = of_robots(config, settings)
    robots, node = advised(config, settings), config.node
    cls = registry.load("links", settings.kind)
    rate_hz = messages_hz(settings.repeat_s, node.rate_hz, node.largest_rate_hz)
    return cls.load(settings, rate_hz, robots, state_shapes(config, robots))


def state_shapes(config: Config, robots: Sequence[int]) -> list[StateShape]:
    """Return the properties that determine the length of each robot's RobotState."""
    models = build_robots(config)
    shapes = ((models[i].reported, models[i].mobile is not None) for i in robots)
    return [StateShape(*shape) for shape in shapes]


def build(
    config: Config,
    clock: Clock,
    *,
    source: Source | None = None,
    ports: Mapping[str, str] | None = None,
    transports: Mapping[str, Transport[Any]] | None = None,
    links: Sequence[Link] | None = None,
    deadline: bool = True,
    prediction: Prediction | None = None,
    shadow: bool = False,
    last_latch_id: int | None = None,
    listeners: Sequence[Listener] = (),
) -> Assembly:
    """Build everything without opening or starting anything.

    ``prediction`` runs the predictor; without it, the predictor is built in this process. ``links``
    replaces the configured links; each of them carries the advice for every robot. ``listeners`` is
    kept, not copied: the caller may add more until the first tick.

    Raises:
        HriPredictError: a part cannot be built; one line with the remedy.
    """
    node = config.node
    source = source or build_source(config)
    if prediction is None:
        deadline_s = LATE_FRACTION / node.rate_hz if deadline else None
        prediction = PredictionRunner(build_predictor(config), deadline_s)
    robots = build_robots(config)
    check_places(config, robots)
    trackers = build_trackers(config, robots, clock.now_ns())
    prediction.wait_until_ready()
    predictor = prediction.predictor
    people = build_people(config, source, predictor)
    configured: tuple[Link, ...] = tuple(
        build_link(
            config,
            link,
            clock,
            port=(ports or {}).get(link.name),
            transport=(transports or {}).get(link.name),
        )
        for link in (config.opened_links if links is None else ())
    )
    recorded: int | None = getattr(source, "last_latch_id", None)
    last_latch_id = random_latch_id() if last_latch_id is None else last_latch_id
    last_latch_id = last_latch_id if recorded is None else recorded
    obeyed = bool(configured) and not shadow
    risk = build_risk(
        config, source, predictor, trackers, obeyed=obeyed, last_latch_id=last_latch_id
    )
    reporting = [r.name for r in node.robots if r.motion.kind == "state"]
    links = tuple(links or ()) or configured or played_links(source, clock, reporting)
    everybody = frozenset(range(len(robots)))
    advised = advised_on_links(config) if configured else [everybody for _ in links]
    repeats = build_repeats(config, source, configured) if configured else None
    phase = phase_of(node, clock) if deadline else None
    publisher = Publisher(links, advised, predictor, shadow, repeats=repeats, phase=phase)
    index = registry.names("predictors").index(config.predictor.name)
    return Assembly(
        config=config,
        clock=clock,
        source=source,
        links=links,
        prediction=prediction,
        robots=robots,
        trackers=trackers,
        node=Node(
            people=people,
            prediction=prediction,
            risk=risk,
            robots=trackers,
            links=links,
            advised=advised,
            publisher=publisher,
            predictor_index=index,
            listeners=listeners,
            supervised_restart=config.node.risk.restart == "supervised",
        ),
        last_latch_id=last_latch_id,
    )
