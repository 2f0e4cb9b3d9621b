"""``check``: how fast each robot that may touch people may touch which part of the body."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from hri_predict.risk.contact.judges import fixtures_of, segment_limits
from hri_predict.risk.contact.limits import FOLLOWS, load_table
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import RobotModel, RobotSettings
from hri_predict.skeleton import CANONICAL

Robots = Sequence[tuple[RobotSettings, RobotModel]]


def contact_facts(risk: RiskSettings, robots: Robots, base_dir: Path | None) -> dict[str, Any]:
    """The limits by robot and part of the body; empty in other modes than ``hybrid``."""
    if risk.mode != "hybrid":
        return {}
    names = [n for n in CANONICAL.segment_names if not n.startswith("r_")]
    found: dict[str, Any] = {}
    for robot, model in robots:
        if robot.contact is None or model.contact is None:
            continue
        limits = segment_limits(risk, model, names, base_dir)
        found[robot.name] = {
            "effective_kg": model.effective_kg,
            "area_cm2": model.contact.area_cm2,
            "fixtures": ["floor", *(f.name for f in fixtures_of(risk, robot))],
            "parts": {
                name.removeprefix("l_"): {
                    "region": region,
                    "free_m_s": free / FOLLOWS,
                    "clamped_m_s": clamped / FOLLOWS,
                }
                for name, region, free, clamped in zip(
                    names,
                    limits.region,
                    limits.transient_m_s.tolist(),
                    limits.clamped_m_s.tolist(),
                    strict=True,
                )
            },
        }
    return found


def contact_notes(risk: RiskSettings, robots: Robots, base_dir: Path | None) -> list[str]:
    """What whoever lets a robot touch people must know."""
    allowed = [(robot, model) for robot, model in robots if robot.contact is not None]
    if not allowed:
        return []
    names = ", ".join(robot.name for robot, _ in allowed)
    if risk.mode != "hybrid":
        return [f"contact: allowed of {names} has no effect: risk.mode is {risk.mode}, not hybrid"]
    said = " ".join(load_table(risk.contact.table, base_dir).source.split())
    notes = [
        f"CONTACT IS ALLOWED: {names} may touch people. Measure force and pressure on the robot "
        f"before anybody works beside it (ISO 10218-2:2025); docs/guides/contact.md says how",
        f"contact limits: {said}",
    ]
    for robot, model in allowed:
        if model.contact is not None:
            source = " ".join(model.contact.source.split())
            notes.append(f"robot {robot.name}: mass and area of contact: {source}")
    if risk.contact.fixtures is None:
        notes.append(
            "no risk.contact.fixtures: only the floor and the table that a robot stands on count "
            "as what it may clamp people against; list machines, walls and racks"
        )
    return notes


def contact_table(name: str, facts: dict[str, Any]) -> Table:
    """The limits of one robot."""
    table = Table(
        title=f"Contact with robot {name}: {facts['effective_kg']:g} kg effective, "
        f"{facts['area_cm2']:g} cm2; clamped against {', '.join(facts['fixtures'])}",
        title_justify="left",
    )
    table.add_column("part of the body")
    table.add_column("region that decides")
    table.add_column("free, m/s", justify="right")
    table.add_column("clamped, m/s", justify="right")
    for part, limits in facts["parts"].items():
        speeds = [limits["free_m_s"], limits["clamped_m_s"]]
        shown = [f"{v:.2f}" if v > 0 else "never" for v in speeds]
        table.add_row(part, limits["region"].replace("_", " "), *shown)
    return table
