"""``check``: how near a person who stands may be while the robot runs, and what that costs most."""

from dataclasses import replace
from typing import Any

import numpy as np

from hri_predict.base.errors import ConfigError
from hri_predict.contracts.predictor import Predictor
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.working_distance.measure import FARTHEST_M, FAST, Situation, alone, robot_of
from hri_predict.run.working_distance.seen import Seen
from hri_predict.run.working_distance.standing import standing
from hri_predict.run.working_distance.waterfall import TERMS, waterfall

SHOWN = 3
"""Number of terms that are shown."""
_STEP_M = 0.02
_MOVING = ("release", "robot_state")  # terms of people who move, and of what is not known here


def distance_facts(config: Config, predictor: Predictor) -> dict[str, Any]:
    """The working distance of a person who stands in front of the first robot that moves.

    Args:
        predictor: the configured one.

    Returns:
        ``robot``, ``speed_m_s``; ``why``: why nothing is known, or ""; ``total_m`` (``None``: too
        far), ``costs_m`` by term, ``rest_m``.
    """
    cell = _at_once(alone(config))
    source = assemble.build_source(config)
    delivered = source.joint_map.mapped
    try:
        robot = robot_of(cell, None)
        situation = Situation.of(cell, source, predictor, robot)
        seconds = situation.path.duration_s
    except ConfigError as error:
        return {"why": str(error)}
    fixed = cell.node.ticks == "fixed"
    least_s = cell.source.min_latency_s
    age_s = least_s + (0.5 / source.rate_hz if fixed else 0.0)

    def watch(whole: bool, fresh: bool) -> tuple[Situation, Seen]:
        """The standing person; with all joints, or fresh, if asked for."""
        joints = np.ones_like(delivered) if whole else delivered
        seen = standing(predictor, joints, age_s=0.0 if fresh else age_s, seconds=seconds)
        return replace(situation), seen

    found = waterfall(watch, np.zeros(2), step=_STEP_M, leaves=_MOVING)
    return {
        "why": "",
        "robot": cell.node.robots[robot].name,
        "speed_m_s": FAST * situation.max_speed_m_s,
        "total_m": found.total_m,
        "costs_m": found.costs_m,
        "rest_m": found.rest_m,
    }


def _at_once(config: Config) -> Config:
    """The cell with releases that do not wait: a person who stands gives no cause to."""
    at_once = {"release_captures": 1, "speed_rise_m_s2": 1e3}
    risk = config.node.risk.model_copy(update=at_once)
    return replace(config, node=config.node.model_copy(update={"risk": risk}))


def distance_lines(facts: dict[str, Any]) -> list[str]:
    """The sum and its largest terms, each with what makes it smaller."""
    if facts["why"]:
        return [f"working distance: not known: {facts['why']}"]
    at = f"at which {facts['robot']} may run at {facts['speed_m_s']:.2g} m/s"
    if facts["total_m"] is None:
        return [f"working distance: a person who stands, {at}, is over {FARTHEST_M:g} m away"]
    costs_m = facts["costs_m"]
    largest = sorted(TERMS, key=lambda term: -costs_m[term.key])[:SHOWN]
    return [
        f"working distance: {facts['total_m']:.2f} m from the base to a person who stands, {at}; "
        f"{facts['rest_m']:.2f} m of it are the robot's reach and the body; measure people at work "
        f"by hri-predict simulate --distance. Most of the rest:",
        *(f"  {100 * costs_m[t.key]:.0f} cm: {t.text}; {t.remedy}" for t in largest),
    ]
