"""One episode, stepped through the closed loop.

Levels, publisher, link, wire, controller, arm and referee are the real ones of node and cell,
stepped as in ``hri-predict run --speed max``. People, predictor and zones are played from
``MotionTicks``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from hri_predict.base.arrays import Floats
from hri_predict.base.clock import VirtualClock
from hri_predict.contracts.cell import ControllerReport
from hri_predict.contracts.predictor import Forecast
from hri_predict.contracts.scene import Scene
from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.node import Node
from hri_predict.node.publisher import Publisher
from hri_predict.operation.monitoring.pace import Pace
from hri_predict.people.people import People
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.thread_runner import PredictionRunner
from hri_predict.protocol.messages import Level, Message
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.types import Assessment
from hri_predict.robots.model import RobotModel
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.runtime import step_all
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.zones.body_zones import BodyZones
from hri_sim.controllers.cell import MockCell
from hri_sim.referee import Bodies as BodiesNow
from hri_sim.referee import Tally, TruePeople
from hri_sim.simulation.approach import ApproachSettings, ApproachSource, exact
from hri_sim.simulation.bodies import MotionTicks, without_people
from hri_sim.simulation.cell import Cell, Variant, with_scenario
from hri_sim.simulation.course import Course, CourseReferee, SharedTruth
from hri_sim.simulation.harm import Bearable, Harm
from hri_sim.simulation.scenario import Scenario


@dataclass(kw_only=True)
class Log(Tally):
    """The true course of an episode over K ticks, and the referee's tally.

    Attributes:
        times_s: (K,) since the start.
        course: (K) people, robots and tools.
        q, path_s: robot name -> (K) joints (N,), and position along its path in seconds at full
            speed, not wrapped at the cycle's end.
        levels: (K) levels of each robot's advice.
        controllers: their reports.
        harm: consequences of touches by a moving robot.
    """

    times_s: list[float] = field(default_factory=list)
    course: Course = field(default_factory=Course)
    q: dict[str, list[Floats]] = field(default_factory=dict)
    path_s: dict[str, list[float]] = field(default_factory=dict)
    levels: list[tuple[Level, ...]] = field(default_factory=list)
    controllers: Sequence[ControllerReport] = ()
    harm: Harm | None = None

    @property
    def people(self) -> Sequence[BodiesNow]:
        """(K) id -> canonical joints (J, 3) and which are known (J,)."""
        return self.course.people


def run_episode(
    *,
    cell: Cell,
    scenario: Scenario,
    variant: Variant,
    bodies: MotionTicks,
    truth: SharedTruth | None = None,
    nobody: bool = False,
) -> Log:
    """Step one episode.

    Args:
        cell: the parts that stay the same.
        scenario: the approach.
        variant: the way to judge risk.
        bodies: the people as the node knows them, in the room frame.
        truth: true positions of the people, if shared with other episodes of the scenario.
        nobody: show the node an empty room, so that the robot works as if alone. This gives the
            unprotected course and the productivity of an empty cell.
    """
    config = with_scenario(cell.config_of(variant), scenario)
    clock = VirtualClock(VIRTUAL_START_NS)
    mock = MockCell(
        links=config.links,
        robots=config.node.robots,
        base_dir=config.base_dir,
        clock=clock,
        manned=cell.posts(config.links),
    )
    source = ApproachSource(cell_settings(config), config.base_dir)
    transports = mock.transports()
    links = tuple(
        assemble.build_link(config, link, clock, transport=transports[link.name])
        for link in config.links
    )
    trackers = cell.trackers(clock)
    advised = assemble.advised_on_links(config)
    played = _Played(bodies, variant.name, nobody)
    engine = cell.engine_of(variant, source, trackers)
    watch = _Watch()
    node = Node(
        people=_PlayedPeople(played),
        prediction=_NoPrediction(),
        risk=_PlayedRisk(engine, played),
        robots=trackers,
        links=links,
        advised=advised,
        publisher=_QuietPublisher(links, advised, cell.predictor, False),
        predictor_index=0,
        listeners=[watch],
        supervised_restart=config.node.risk.restart == "supervised",
    )
    assembly = assemble.Assembly(
        config=config,
        clock=clock,
        source=source,
        links=links,
        prediction=_NoPrediction(),
        robots=tuple(cell.models),
        trackers=tuple(trackers),
        node=node,
    )
    recorder = _Recorder(mock, truth or truth_of(cell, scenario), cell)
    step_all(assembly=assembly, pace=Pace(), beside=mock, each_tick=recorder.observe)
    if node.assess_failures or node.listener_failures:
        raise RuntimeError(f"the risk stage failed in episode {scenario.index}")
    log = recorder.log(watch, mock.stop())
    judge(log, config, cell.models)
    return log


def judge(log: Log, config: Config, models: Sequence[RobotModel]) -> None:
    """Write the referee's tally of the log's course, and what touches did, into the log."""
    log.harm = harm = Harm(_bearable(config, models))
    referee = CourseReferee(models, config.node.risk.clearance_m, None, harm.note)
    referee.judge(log.course)
    vars(log).update(referee.tally())


def truth_of(cell: Cell, scenario: Scenario) -> SharedTruth:
    """Return the true positions of a scenario's people, for all its episodes."""
    settings = exact(cell_settings(with_scenario(cell.config, scenario)))
    return SharedTruth(TruePeople(ApproachSource(settings, cell.config.base_dir)))


def _bearable(config: Config, models: Sequence[RobotModel]) -> dict[str, Bearable]:
    """Return the bearable limits of each robot that may touch people, by name, in any mode."""
    return {
        robot.name: Bearable.of(config, robot, model)
        for robot, model in zip(config.node.robots, models, strict=True)
        if robot.contact is not None
    }


def cell_settings(config: Config) -> ApproachSettings:
    """Return the configuration's source, which names the motions."""
    assert isinstance(config.source, ApproachSettings)
    return config.source


class _Played:
    """Results of the stages, by time of the tick."""

    def __init__(self, bodies: MotionTicks, variant: str, nobody: bool) -> None:
        self._bodies = bodies
        self._zones = bodies.nobody if nobody else bodies.zones[variant]
        self._at = {snapshot.now_ns: k for k, snapshot in enumerate(bodies.snapshots)}
        self.nobody = nobody

    def snapshot(self, now_ns: int) -> PeopleSnapshot:
        snapshot = self._bodies.snapshots[self._at[now_ns]]
        return without_people(snapshot) if self.nobody else snapshot

    def zones(self, now_ns: int) -> BodyZones | None:
        return self._zones[self._at[now_ns]] if self._zones else None


class _PlayedPeople(People):
    """Stands in for the tracker; the people were computed before."""

    def __init__(self, played: _Played) -> None:
        self._played = played

    def receive(self, scene: Scene, receipt_ns: int) -> None:
        """Computed before."""

    def snapshot(self, now_ns: int) -> PeopleSnapshot:
        """Return the people at ``now_ns``."""
        return self._played.snapshot(now_ns)


class _NoPrediction(PredictionRunner):
    """Stands in for the predictor; the zones were computed before."""

    def __init__(self) -> None:
        self.failures = self.late = 0

    def run(self, snapshot: PeopleSnapshot) -> tuple[Forecast | None, Reason | None]:
        """None."""
        return None, None


class _PlayedRisk(RiskEngine):
    """Stands in for the risk engine; its zones were computed before."""

    def __init__(self, engine: RiskEngine, played: _Played) -> None:
        self._engine, self._played = engine, played

    def assess(
        self, snapshot: PeopleSnapshot, forecast: Forecast | None, reasons: Sequence[Reason] = ()
    ) -> Assessment:
        """Judge the zones of this tick; only separation and levels are computed."""
        engine = self._engine
        bodies = self._played.zones(snapshot.now_ns) or engine.zones(snapshot, None)
        findings = engine.separation(bodies, engine.robots(snapshot.now_ns))
        return engine.levels(snapshot, bodies, findings)

    def acknowledge(self, latch_id: int, down_ns: int = 0) -> bool:
        """Do what the engine does."""
        return self._engine.acknowledge(latch_id, down_ns)

    def choose_set(self, link: str, number: int, at_ns: int) -> None:
        """Do what the engine does."""
        self._engine.choose_set(link, number, at_ns)


class _QuietPublisher(Publisher):
    """Omits messages that no simulated controller uses."""

    def publish(
        self, tick: Tick, leaves_out: Callable[[type[Message]], bool] = lambda _: True
    ) -> list[Message]:
        """Post advice, status and schema."""
        return super().publish(tick, lambda _: True)


class _Watch(Listener):
    """Records each tick's advice."""

    def __init__(self) -> None:
        self.levels: dict[int, tuple[Level, ...]] = {}

    def on_tick(self, tick: Tick) -> None:
        """Record the levels."""
        if tick.assessment is not None:  # not the announcements of start and end
            self.levels[tick.now_ns] = tuple(advice.level for advice in tick.advices)


class _Recorder:
    """Records the true state at each tick."""

    def __init__(self, mock: MockCell, truth: SharedTruth, cell: Cell) -> None:
        self._mock, self._truth = mock, truth
        self._cycles = {
            model.name: trajectory.duration_s
            for model, trajectory in zip(cell.models, cell.trajectories, strict=True)
        }
        self._log = Log(
            q={name: [] for name in self._cycles}, path_s={name: [] for name in self._cycles}
        )

    def observe(self, now_ns: int) -> None:
        """Record the state at a tick."""
        log, course = self._log, self._log.course
        if not course.stamps_ns:
            self._truth.open(now_ns)
        robots, paths = self._mock.robot_truth(now_ns), self._mock.path_s()
        course.stamps_ns.append(now_ns)
        course.people.append(self._truth.at(now_ns))
        course.robots.append(robots)
        course.tools.append({name: self._mock.tool_of(name) for name in robots})
        for name, cycle_s in self._cycles.items():
            log.q[name].append(robots[name][0])
            before, now = log.path_s[name], paths[name]
            if before:  # unwrap: one tick covers far less than half a cycle
                now = before[-1] + (now - before[-1] + 0.25 * cycle_s) % cycle_s - 0.25 * cycle_s
            before.append(now)

    def log(self, watch: _Watch, reports: Sequence[ControllerReport]) -> Log:
        """Return the complete log, at the end."""
        log, stamps = self._log, self._log.course.stamps_ns
        log.times_s = [(stamp - VIRTUAL_START_NS) * 1e-9 for stamp in stamps]
        log.levels = [watch.levels[stamp] for stamp in stamps]
        log.controllers = reports
        return log
