"""The cell of a simulation: configuration, risk variants, robots, and motions, read once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from hri_predict import assemble
from hri_predict.clock import Clock
from hri_predict.config import Config
from hri_predict.errors import ConfigError
from hri_predict.link import LinkSettings
from hri_predict.predictors.base import Predictor
from hri_predict.risk.robot import RobotModel
from hri_predict.risk.robot_tracker import RobotTracker
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.trajectory import Trajectory
from hri_predict.settings import validated
from hri_sim.simulation.approach import ApproachSettings
from hri_sim.simulation.scenario import Scenario, Workspace
from hri_sim.station import Post, posts

FOREKNOWN = "foreknown"
"""Mode ``predictive`` with the true future instead of a forecast; see ``foreknown``."""


@dataclass(frozen=True)
class Variant:
    """One way to judge risk: what is compared on the same approaches.

    Attributes:
        name: the mode, and its coverage where that is not the configuration's.
        risk: overrides of ``risk:``.
    """

    name: str
    risk: tuple[tuple[str, Any], ...]

    @property
    def is_foreknown(self) -> bool:
        """Whether it judges the true future: a bound, which no node can be run with."""
        return self.name == FOREKNOWN


def variants(config: Config, modes: Sequence[str], coverages: Sequence[float]) -> list[Variant]:
    """The modes asked for (``foreknown`` may be among them), and ``predictive`` at each coverage.

    Raises:
        ConfigError: an unknown mode or coverage.
    """
    chosen = list(modes) or ([] if coverages else [config.node.risk.mode])
    found = [
        Variant(mode, (("mode", "predictive" if mode == FOREKNOWN else mode),)) for mode in chosen
    ]
    for level in coverages:
        coverage = config.node.risk.coverage.model_dump() | {"level": level}
        risk = (("mode", "predictive"), ("coverage", coverage))
        found.append(Variant(f"predictive {level:.4g}", risk))
    for variant in found:
        with_risk(config, variant)
    names = [variant.name for variant in found]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"--mode {name}: given twice; name each once")
    return found


def with_risk(config: Config, variant: Variant) -> Config:
    """The configuration with the variant's risk settings.

    Raises:
        ConfigError: the settings know no such mode or coverage.
    """
    data = config.node.risk.model_dump() | dict(variant.risk)
    risk = validated(RiskSettings, data, f"--mode {variant.name}: risk")
    return replace(config, node=config.node.model_copy(update={"risk": risk}))


def with_scenario(config: Config, scenario: Scenario) -> Config:
    """The configuration that plays one scenario, its losses on the wire included."""
    assert isinstance(config.source, ApproachSettings)
    source = config.source.model_copy(
        update={
            "motions": list(scenario.motions),
            "places": [list(place) for place in scenario.places],
            "lead_in_s": scenario.lead_in_s,
        }
    )
    links = []
    for i, link in enumerate(config.links):
        simulate = dict(link.simulate or {})
        simulate |= {"start_s": scenario.phase_s, "fault_seed": scenario.link_seed + i}
        links.append(link.model_copy(update={"simulate": simulate}))
    return replace(config, source=source, links=tuple(links))


def _start(link: LinkSettings) -> dict[str, Any]:
    simulate = link.simulate or {}
    return {key: simulate[key] for key in ("start_s", "fault_seed")}


class Cell:
    """What stays the same from one episode to the next, for one predictor.

    Attributes:
        config: without a scenario.
        predictor: built once.
        models, trajectories: of the robots, in the configuration's order.
        workspace: what they sweep.
    """

    def __init__(self, config: Config, predictor: Predictor | None = None) -> None:
        """Read the robots.

        Raises:
            HriPredictError: the configuration does not describe a closed loop.
        """
        if not isinstance(config.source, ApproachSettings):
            raise ConfigError(
                f"{config.path}: source.kind is '{config.source.kind}'; a simulation needs "
                f"'approach' (see the shipped simulate.yaml)"
            )
        if not config.links or any(link.simulate is None for link in config.links):
            raise ConfigError(
                f"{config.path}: links: every link needs a 'simulate:' block, for a simulation has "
                f"no hardware (see the shipped simulate.yaml)"
            )
        self.config = config
        self.predictor = predictor or assemble.build_predictor(config)
        self._posts = posts(config.links, config.node.robots, config.base_dir)
        drives = {p.robot.name: p.drive for p in self._posts if p.drive is not None}
        self.models: list[RobotModel] = []
        self.trajectories: list[Trajectory] = []
        for robot in config.node.robots:
            if robot.name not in drives:
                raise ConfigError(
                    f"{config.path}: robot '{robot.name}' has no simulated drive; add a link with "
                    f"'simulate: {{role: drive}}'"
                )
            self.models.append(drives[robot.name].model)
            self.trajectories.append(drives[robot.name].trajectory)
        self.workspace = Workspace.of(list(zip(self.models, self.trajectories, strict=True)))

    @property
    def source(self) -> ApproachSettings:
        """The configuration's source."""
        assert isinstance(self.config.source, ApproachSettings)
        return self.config.source

    def posts(self, links: Sequence[LinkSettings]) -> list[Post]:
        """The posts at the far ends of these links: the configuration's, a scenario's start."""
        return [
            replace(post, link=link, settings=post.settings.model_copy(update=_start(link)))
            for post, link in zip(self._posts, links, strict=True)
        ]

    def trackers(self, clock: Clock) -> list[RobotTracker]:
        """Fresh trackers of all robots."""
        return [
            RobotTracker(settings, model, self.config.base_dir, clock.now_ns())
            for settings, model in zip(self.config.node.robots, self.models, strict=True)
        ]
