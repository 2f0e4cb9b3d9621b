"""Settings of a cell that are less safe than their defaults, with the effect of each."""

from hri_predict.base.quantities.safe_side import LessSafeSetting, less_safe
from hri_predict.risk.robot_constants import worst_distance
from hri_predict.robots.file import read_robot_file
from hri_predict.robots.settings import StateMotion
from hri_predict.run.advised import age_limits_s
from hri_predict.run.assemble import build_budget, build_robots, build_source
from hri_predict.run.config import Config

NEGLIGIBLE_S = 0.01 + 1e-9
"""Maximum amount by which ``motion.delay_s`` may be below the delay of its link: 1 cm at 1 m/s."""


def less_safe_settings(config: Config) -> list[LessSafeSetting]:
    """Return all settings that are less safe than their defaults, in the order of the keys.

    Raises:
        HriPredictError: a part cannot be built; one line with the remedy.
    """
    node, links = config.node, {f"links.{link.name}": link for link in config.links}
    computed = _computed(config)
    blocks = {"source": config.source, "people": node.people, "risk": node.risk}
    blocks |= {f"robots.{i}": robot for i, robot in enumerate(node.robots)}
    blocks |= {f"zones.{i}": zone for i, zone in enumerate(node.zones)}
    return [
        finding
        for at, block in (blocks | links).items()
        for finding in less_safe(block, at, computed)
    ]


def _computed(config: Config) -> dict[str, float]:
    """Return the defaults that depend on other settings, by key."""
    source = build_source(config, with_faults=False)
    rate_hz, robots, budget = source.rate_hz, build_robots(config), build_budget(config, source)
    found = {
        "source.stale_s": config.source.default_stale_s(rate_hz),
        "people.max_gap_s": max(0.1, 2.5 / rate_hz),
    }
    for name, limit_s in age_limits_s(config, budget).items():
        found[f"links.{name}.max_age_s"] = limit_s
    for i, (settings, model) in enumerate(zip(config.node.robots, robots, strict=True)):
        if config.node.risk.mode == "fixed":
            worst = worst_distance(config.node.risk, settings, model, budget)
            radius = model.reach_m + worst.total
            found["risk.fixed_radius_m"] = max(radius, found.get("risk.fixed_radius_m", 0.0))
        heaviest_kg = read_robot_file(settings.model, config.base_dir).stopping.rows[-1].payload_kg
        found[f"robots.{i}.payload_kg"] = heaviest_kg
        for k in range(len(settings.tools or ())):
            found[f"robots.{i}.tools.{k}.payload_kg"] = heaviest_kg
        if isinstance(settings.motion, StateMotion):
            carried = [
                link.delay_s
                for link in config.links
                if not link.robots or settings.name in link.robots  # an empty list means all
            ]
            delay_s = max(carried, default=0.0)
            if delay_s - settings.motion.delay_s > NEGLIGIBLE_S:
                found[f"robots.{i}.motion.delay_s"] = delay_s
    return found
