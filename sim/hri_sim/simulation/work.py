"""Blocks of episodes: one process runs one block at a time; finished blocks are not run again."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.run import config as configuration
from hri_predict.run.compared_predictors import (
    ComparedPredictor,
    asked_predictors,
    fitting,
    with_predictor,
)
from hri_predict.run.config import Config
from hri_sim.simulation import bodies as stages
from hri_sim.simulation.approach import lasts_ns, over_floor
from hri_sim.simulation.bodies import MotionTicks
from hri_sim.simulation.cell import Cell, Variant, variants
from hri_sim.simulation.episode import run_episode, truth_of
from hri_sim.simulation.free_robots import FreeRobots
from hri_sim.simulation.motion import Motion, load_motion
from hri_sim.simulation.request import SimulationRequest
from hri_sim.simulation.results.outcome import Truth, outcome, prediction
from hri_sim.simulation.scenario import Scenario, draw
from hri_sim.simulation.whole_node import disagreement

ALONE = Variant("unprotected", ())
BLOCK = 20
"""Number of episodes of one recording in a block."""

SourceValue = str | float | tuple[str, ...]
"""A value in ``source:``."""


@dataclass(frozen=True, kw_only=True)
class SimulationPlan(SimulationRequest):
    """A request for the worker processes, with the playable recordings.

    Attributes:
        checked: (predictor, episode) pairs that are repeated through the whole node.
    """

    checked: frozenset[tuple[str | None, int]]

    @property
    def names(self) -> tuple[str | None, ...]:
        """The predictors, in order; ``None``: the configuration's own."""
        return self.predictors or (None,)

    @property
    def seen(self) -> tuple[tuple[str, SourceValue], ...]:
        """Settings of the sensor: ``source:`` keys that differ from the configuration."""
        asked = {
            "tracker": self.tracker,
            "lacks": self.lacks or None,
            "hidden": self.hidden or None,
            "lost_limbs": self.lost_limbs or None,
            "noise_m": self.noise_m,
            "wander_m": self.wander_m,
        }
        return tuple((key, value) for key, value in asked.items() if value is not None)

    def loaded(self, predictor: str | None) -> Config:
        """Return the configuration with one of the predictors."""
        config = configuration.load(self.config).quiet()
        changes: dict[str, Any] = dict(self.seen)
        if self.joint_map is not None:
            changes["joint_map"] = self.joint_map
        if changes:
            config = config.with_source(config.source.model_dump() | changes)
        own = predictor is None or predictor == config.predictor.name
        if predictor is not None and not own:
            config = with_predictor(config, predictor)
        return self._with_calibration(config, own=own)

    def asked(self, predictor: str | None) -> ComparedPredictor:
        """Return one of the predictors with its label in tables."""
        if predictor is None:
            name = configuration.load(self.config).predictor.name
            return ComparedPredictor(name=name, weights=None, label=name)
        return asked_predictors(self.predictors)[self.predictors.index(predictor)]

    def _with_calibration(self, config: Config, *, own: bool) -> Config:
        """Give a predictor the calibration that was made for it.

        The file in the configuration is for its own predictor. Another predictor uses it if it
        fits, otherwise the shipped calibration or none.
        """
        coverage = config.node.risk.coverage
        base_dir = config.base_dir or Path()
        given = list(self.calibrations)
        beside = coverage.calibration
        if not own and beside is not None:
            given.append(base_dir / beside)
        found = fitting(given, config.predictor.resolved(base_dir))
        if found is None and (own or beside is None):
            return config
        changed = {"calibration": None if found is None else str(found)}
        risk = config.node.risk.model_copy(update={"coverage": coverage.model_copy(update=changed)})
        return replace(config, node=config.node.model_copy(update={"risk": risk}))


@dataclass(frozen=True, order=True)
class Block:
    """Some episodes of one recording with one predictor (its index in the plan)."""

    predictor: int
    motion: int
    part: int

    @property
    def key(self) -> str:
        """Name of the block in the file."""
        return f"{self.predictor}/{self.motion}/{self.part}"


def blocks(plan: SimulationPlan) -> list[Block]:
    """Return all blocks, in the order in which they start."""
    count = len(plan.motions)
    return [
        Block(predictor, motion, part)
        for predictor in range(len(plan.names))
        for motion in range(min(count, plan.episodes))
        for part in range(-(-len(range(motion, plan.episodes, count)) // BLOCK))
    ]


def episodes(plan: SimulationPlan, block: Block) -> list[int]:
    """Return the numbers of the block's episodes: approaches use the recordings in turn."""
    count = len(plan.motions)
    mine = range(block.motion, plan.episodes, count)
    return list(mine[block.part * BLOCK : (block.part + 1) * BLOCK])


def run_block(plan: SimulationPlan, block: Block) -> dict[str, Any]:
    """Run every variant of each episode of a block; return plain data."""
    cell, modes = _cell(plan, block.predictor)
    free = _free(plan, block.predictor)
    motions = _company(plan, block)
    rows: dict[str, Any] = {"outcomes": [], "predictions": [], "checks": []}
    for index in episodes(plan, block):
        scenario = scenario_of(plan, cell, index, motions)
        together = _bodies(plan, block.predictor, scenario)
        shared = truth_of(cell, scenario)
        played: dict[str, Any] = {
            "cell": cell, "scenario": scenario, "bodies": together, "truth": shared,
        }  # fmt: skip
        alone = free.log(scenario, together, shared)
        truth = Truth.of(alone, cell.models)
        known: dict[str, Any] = {
            "cell": cell, "scenario": scenario, "alone": alone, "truth": truth,
        }  # fmt: skip
        rows["outcomes"].append({"variant": ALONE.name} | asdict(outcome(log=alone, **known)))
        rows["predictions"].append(asdict(prediction(bodies=together, **known)))
        for variant in modes:
            log = run_episode(variant=variant, **played)
            rows["outcomes"].append({"variant": variant.name} | asdict(outcome(log=log, **known)))
            checked = (plan.names[block.predictor], index) in plan.checked
            if checked and not variant.is_foreknown:  # a node does not know the future
                said = disagreement(cell, scenario, variant, log)
                rows["checks"].append(
                    {"index": index, "variant": variant.name, "disagreement": said}
                )
    return rows


def scenario_of(plan: SimulationPlan, cell: Cell, index: int, motions: Sequence[str]) -> Scenario:
    """Return the scenario of one episode."""
    return draw(
        seed=plan.seed,
        index=index,
        motions=_read(cell, motions),
        workspace=cell.workspace,
        lead_in_s=cell.source.lead_in_s,
    )


def _read(cell: Cell, motions: Sequence[str]) -> list[Motion]:
    source, base_dir = cell.source, cell.config.base_dir
    return [load_motion(name, source.rate_hz, base_dir, source.joint_map) for name in motions]


def _company(plan: SimulationPlan, block: Block) -> list[str]:
    """Return the motions of this block's people: its own recording, and others drawn at random."""
    rng = np.random.default_rng([plan.seed, block.motion, block.part])
    others = rng.choice(plan.motions, plan.people - 1)
    return [plan.motions[block.motion], *(str(name) for name in others)]


def _bodies(plan: SimulationPlan, predictor: int, scenario: Scenario) -> MotionTicks:
    parts = [
        stages.moved(_computed(plan, predictor, name, scenario.lead_in_s), over_floor(at), p)
        for p, (name, at) in enumerate(zip(scenario.motions, scenario.places, strict=True))
    ]
    cell, _ = _cell(plan, predictor)
    return stages.joined(parts, lasts_ns(_read(cell, scenario.motions), scenario.lead_in_s))


@lru_cache(maxsize=2)
def _cell(plan: SimulationPlan, predictor: int) -> tuple[Cell, list[Variant]]:
    config = plan.loaded(plan.names[predictor])
    return Cell(config), variants(config, plan.modes, plan.coverages)


@lru_cache(maxsize=2)
def _free(plan: SimulationPlan, predictor: int) -> FreeRobots:
    cell, modes = _cell(plan, predictor)
    return FreeRobots(cell, modes[0])


@lru_cache(maxsize=8)
def _computed(plan: SimulationPlan, predictor: int, motion: str, lead_in_s: float) -> MotionTicks:
    cell, modes = _cell(plan, predictor)
    return stages.compute(cell=cell, motions=[motion], lead_in_s=lead_in_s, variants=modes)
