"""The cell of a simulation: configuration, risk variants, robots, and motions, read once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hri_predict.base.clock import Clock
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.contracts.link import LinkSettings
from hri_predict.contracts.predictor import Predictor
from hri_predict.contracts.source import Source
from hri_predict.risk.engine import RiskEngine
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.tracker import RobotTracker
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.zones.calibration import Calibration
from hri_sim.controllers.station import Drive, Post, posts
from hri_sim.simulation.approach import ApproachSettings
from hri_sim.simulation.scenario import Scenario, Workspace

FOREKNOWN = "foreknown"
"""Mode ``predictive`` with the true future instead of a forecast; see ``foreknown``."""


@dataclass(frozen=True)
class Variant:
    """One way to judge risk; variants are compared on the same approaches.

    Attributes:
        name: the mode, and its coverage if it differs from the configuration's.
        risk: overrides of ``risk:``.
    """

    name: str
    risk: tuple[tuple[str, Any], ...]

    @property
    def is_foreknown(self) -> bool:
        """Whether it uses the true future, which gives a bound for real nodes."""
        return self.name == FOREKNOWN


def variants(config: Config, modes: Sequence[str], coverages: Sequence[float]) -> list[Variant]:
    """Return the given modes (``foreknown`` may be one), and ``predictive`` at each coverage.

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
    """Return the configuration with the variant's risk settings.

    Raises:
        ConfigError: the mode or coverage is not valid.
    """
    # no PLC chooses a set in a simulation: all zones ask, at full speed
    data = config.node.risk.model_dump() | {"sets": []} | dict(variant.risk)
    risk = validated(RiskSettings, data, f"--mode {variant.name}: risk")
    return replace(config, node=config.node.model_copy(update={"risk": risk}))


def with_scenario(config: Config, scenario: Scenario) -> Config:
    """Return the configuration that plays one scenario, with its losses on the wire."""
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


def manned(config: Config) -> tuple[list[Post], list[Drive]]:
    """Return the post at the far end of each link, and each robot's drive.

    Raises:
        ConfigError: a link or a robot is not simulated, so that no referee could judge it.
    """
    if not config.links or any(link.simulate is None for link in config.links):
        raise ConfigError(
            f"{config.path}: links: every link needs a 'simulate:' block, because a simulation "
            f"has no hardware (see the shipped simulate.yaml)"
        )
    found = posts(config.links, config.node.robots, config.base_dir)
    drives = {post.robot.name: post.drive for post in found if post.drive is not None}
    for robot in config.node.robots:
        if robot.name not in drives:
            raise ConfigError(
                f"{config.path}: robot '{robot.name}' has no simulated drive; add a link with "
                f"'simulate: {{role: drive}}'"
            )
    return found, [drives[robot.name] for robot in config.node.robots]


_MOVED = (("people", "exits"), ("people", "entrances"), ("source", "field_of_view"))
"""Settings of places that the people stage compares with bodies, before an episode moves them."""


def _demand_movable(config: Config) -> None:
    """Check that no setting ties people to places: each episode draws theirs around the robots.

    Nor may the source have faults, which only the repeated episodes of the whole node would have.

    Raises:
        ConfigError: one does.
    """
    source = config.source
    if not np.allclose(source.room_from_source.matrix(), np.eye(4), atol=1e-9):
        raise ConfigError(
            f"{config.place('source', 'room_from_source')}: a simulation draws people's places "
            f"around the robots, in the room frame; remove this key"
        )
    if source.faults:
        raise ConfigError(
            f"{config.place('source', 'faults')}: a simulation of approaches has no faults of the "
            f"source; remove this key"
        )
    for block, key in _MOVED:
        if getattr(source if block == "source" else config.node.people, key):
            raise ConfigError(
                f"{config.place(block, key)}: a simulation computes people before it moves them to "
                f"their places, where this key would not count; remove it"
            )


def _start(link: LinkSettings) -> dict[str, Any]:
    simulate = link.simulate or {}
    return {key: simulate[key] for key in ("start_s", "fault_seed")}


class Cell:
    """The parts shared by all episodes with one predictor.

    Attributes:
        config: without a scenario.
        predictor: built once.
        models, trajectories: the robots' models and trajectories, in the configuration's order.
        workspace: the space that the robots sweep.
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
        _demand_movable(config)
        self.config = config
        self._known: dict[str, tuple[Config, Calibration | None]] = {}
        self._posts, drives = manned(config)
        self.predictor = predictor or assemble.build_predictor(config)
        self.models = [drive.model for drive in drives]
        self.trajectories = [drive.trajectory for drive in drives]
        self.workspace = Workspace.of(list(zip(self.models, self.trajectories, strict=True)))

    @property
    def source(self) -> ApproachSettings:
        """The source of the configuration."""
        assert isinstance(self.config.source, ApproachSettings)
        return self.config.source

    def config_of(self, variant: Variant) -> Config:
        """Return ``with_risk`` for a variant, validated once."""
        return self._of(variant)[0]

    def engine_of(
        self, variant: Variant, source: Source, trackers: Sequence[RobotTracker]
    ) -> RiskEngine:
        """Return a new risk stage of a variant, whose calibration is read once.

        Raises:
            ConfigError: the source's rate or the configuration does not allow it.
        """
        config, calibration = self._of(variant)
        return assemble.build_risk(
            config, source, self.predictor, trackers, calibration=calibration
        )

    def _of(self, variant: Variant) -> tuple[Config, Calibration | None]:
        if variant.name not in self._known:
            config = with_risk(self.config, variant)
            self._known[variant.name] = config, assemble.build_calibration(config)
        return self._known[variant.name]

    def posts(self, links: Sequence[LinkSettings]) -> list[Post]:
        """Return the controllers' posts at the far ends of these links, at a scenario's start."""
        return [
            replace(post, link=link, settings=post.settings.model_copy(update=_start(link)))
            for post, link in zip(self._posts, links, strict=True)
        ]

    def trackers(self, clock: Clock) -> list[RobotTracker]:
        """Return new trackers of all robots."""
        return list(assemble.build_trackers(self.config, self.models, clock.now_ns()))
