"""``check``: basis of the zones, working distance, and the engines that compute them."""

from dataclasses import replace
from datetime import date
from typing import Any

import numpy as np

from hri_predict.base.errors import ConfigError
from hri_predict.base.installed import for_this_installation
from hri_predict.base.machine.compiled import why_not_compiled
from hri_predict.base.skeleton import CANONICAL
from hri_predict.cli.check.remedies import remedy
from hri_predict.contracts.predictor import Predictor, PredictorSettings
from hri_predict.lab.calibration.levels import levels_text
from hri_predict.run import assemble
from hri_predict.run.config import Config
from hri_predict.run.working_distance.measure import FARTHEST_M, FAST, Situation, alone, robot_of
from hri_predict.run.working_distance.seen import Seen
from hri_predict.run.working_distance.standing import standing
from hri_predict.run.working_distance.waterfall import TERMS, rest_text, waterfall
from hri_predict.zones.calibration import Calibration
from hri_predict.zones.motion_class import SPEED_CLASSES

# -- check: how old the zones' calibration is, and what it guarantees ------------------------------

OLD_DAYS = 365
"""Age above which a calibration is questioned: most cells have changed by then."""


def calibration_facts(config: Config, today: date) -> dict[str, Any] | None:
    """Age, recordings and levels of the calibration; ``None`` if the zones have none."""
    if not config.node.risk.uses_forecasts:
        return None
    calibration = assemble.build_calibration(config)
    return None if calibration is None else facts_of(calibration, today)


def facts_of(calibration: Calibration, today: date) -> dict[str, Any]:
    """See ``calibration_facts``."""
    made, site = calibration.made, calibration.site
    return {
        "made": None if made is None else made.isoformat(),
        "age_days": None if made is None else (today - made).days,
        "recordings": len(calibration.recordings),
        "site_parts": 0 if site is None else len(site.recordings),
        "levels": levels_text(calibration),
        "uncalibrated": [
            name
            for name, factors in zip(
                SPEED_CLASSES, calibration.estimated["joint"].swapaxes(0, 1), strict=True
            )
            if not np.isfinite(factors).any()
        ],
    }


def calibration_lines(facts: dict[str, Any] | None) -> list[str]:
    """Return the facts of ``calibration_facts`` as lines to read."""
    if facts is None:
        return []
    days = facts["age_days"]
    if days is None:
        age = "it does not say when it was made"
    elif days < 0:
        age = f"made on {facts['made']}, which is in the future: check this computer's date"
    else:
        age = f"made on {facts['made']}, {days} day{'' if days == 1 else 's'} ago"
        if days > OLD_DAYS:
            age += "; does it still match the people and the tracker? See hri-predict calibrate"
    site = f", moved by {facts['site_parts']} parts of a site's" if facts["site_parts"] else ""
    return [
        f"calibration: {age}; from {facts['recordings']} recordings{site}",
        *(f"  {line}" for line in facts["levels"]),
    ]


def calibration_notes(facts: dict[str, Any] | None) -> list[str]:
    """Return the gaps of a calibration: speed classes with too few recordings."""
    if facts is None or not facts["uncalibrated"]:
        return []
    return [
        f"the calibration has too few recordings of people who are "
        f"{' or '.join(facts['uncalibrated'])}; physical limits are used for them instead"
    ]


# -- check: how near a person who stands may be while the robot runs, and what that costs most -----

SHOWN = 3
"""Number of terms shown."""
_STEP_M = 0.02
_OVER_TIME = "In this mode the zones decide it, so it changes less with T_r than S_p does. "
_MOVING = ("release", "robot_state")  # terms of people who move, and of what is not known here


def distance_facts(config: Config, predictor: Predictor) -> dict[str, Any]:
    """Return the working distance of a person standing in front of the first moving robot.

    Args:
        predictor: the configured one.

    Returns:
        ``robot``, ``speed_m_s``; ``why``: reason if it is unknown, or ""; ``total_m`` (``None``:
        too far), ``costs_m`` and ``remedies`` by term, ``rest_m`` and ``rest``, what that is;
        ``basis``: what decides it, if that is not S_p.
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
        """Return the standing person; on request with all joints, or fresh."""
        joints = np.ones_like(delivered) if whole else delivered
        seen = standing(predictor, joints, age_s=0.0 if fresh else age_s, seconds=seconds)
        return replace(situation), seen

    found = waterfall(watch, np.zeros(2), step=_STEP_M, leaves=_MOVING)
    lacking = [name for name, known in zip(CANONICAL.joints, delivered, strict=True) if not known]
    return {
        "why": "",
        "robot": cell.node.robots[robot].name,
        "speed_m_s": FAST * situation.max_speed_m_s,
        "total_m": found.total_m,
        "costs_m": found.costs_m,
        "rest_m": found.rest_m,
        "rest": rest_text(cell.node.risk.mode),
        "basis": _OVER_TIME if config.node.risk.judges_over_time else "",
        "remedies": {term.key: remedy(term.key, config, lacking) for term in TERMS},
    }


def _at_once(config: Config) -> Config:
    """Return the cell without release delays, which a standing person never triggers."""
    at_once = {"release_captures": 1, "speed_rise_m_s2": 1e3}
    risk = config.node.risk.model_copy(update=at_once)
    return replace(config, node=config.node.model_copy(update={"risk": risk}))


def distance_lines(facts: dict[str, Any]) -> list[str]:
    """Return the sum and its largest terms, each with a way to reduce it."""
    if facts["why"]:
        return [f"working distance: not known: {facts['why']}"]
    at = f"at which {facts['robot']} may run at {facts['speed_m_s']:.2g} m/s"
    if facts["total_m"] is None:
        return [f"working distance: a person who stands, {at}, is over {FARTHEST_M:g} m away"]
    costs_m = facts["costs_m"]
    costly = [term for term in TERMS if costs_m[term.key] > _STEP_M / 2]
    largest = sorted(costly, key=lambda term: -costs_m[term.key])[:SHOWN]
    ranked = "Largest other terms:" if largest else "No other term costs 1 cm or more."
    return [
        f"working distance: {facts['total_m']:.2f} m from the base to a person who stands in full "
        f"view, {at}; "
        f"{facts['rest_m']:.2f} m of it are {facts['rest']}. {facts['basis']}"
        f"People at work, or half hidden by a bench, must stay farther away: hri-predict simulate "
        f"--distance measures how far, and its terms rank differently. {ranked}",
        *(
            f"  {100 * costs_m[t.key]:.0f} cm: {t.text}; {facts['remedies'][t.key]}"
            for t in largest
        ),
    ]


# -- check: what computes the networks and the risk stage, and how far it is from torch ------------


def engine_facts(predictor: Predictor, settings: PredictorSettings) -> list[dict[str, Any]]:
    """Engine of each of a predictor's networks, and deviation from torch; none for a baseline."""
    members, names = getattr(predictor, "members", [predictor]), settings.runs()
    if len(names) != len(members):
        names = (settings.name,) * len(members)
    found = []
    for network, member in zip(names, members, strict=True):
        engine = getattr(member, "engine", None)
        if hasattr(engine, "differs_m"):  # the user's own may mean another thing by it
            keys = ("name", "differs_m", "why")
            found.append({"network": network, **{key: getattr(engine, key) for key in keys}})
    return found


def engine_lines(facts: list[dict[str, Any]]) -> list[str]:
    """Return a line for each network."""
    return [
        f"network {engine['network']}: computed by {engine['name']}"
        + (
            (f", because {engine['why']}" if engine["why"] else "")
            if engine["name"] == "torch"
            else f", within {1e3 * engine['differs_m']:.1g} mm of torch"
        )
        for engine in facts
    ]


def loops_line() -> str:
    """Return whether the risk stage's loops are compiled; if not, with the reason."""
    why = why_not_compiled()
    if not why:
        return "risk stage: compiled loops"
    because = for_this_installation(why)
    return f"risk stage: arrays, which take about three times as long, because {because}"
