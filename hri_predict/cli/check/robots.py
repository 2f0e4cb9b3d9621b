"""``check``: limits of contact and effects of tools for each robot."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from hri_predict.base.arrays import Bools
from hri_predict.base.skeleton import CANONICAL
from hri_predict.risk.contact.judges import fixtures_of, segment_limits
from hri_predict.risk.contact.limits import FOLLOWS, NEVER, ContactTable, load_table
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import RobotModel
from hri_predict.robots.settings import RobotSettings

# -- check: how fast each robot that may touch people may touch which part of the body -------------

Robots = Sequence[tuple[RobotSettings, RobotModel]]
_ABOVE_BASE_M = 0.1
"""Distance along the base's z axis that is certainly inside the robot, not in its stand."""


def contact_facts(risk: RiskSettings, robots: Robots, base_dir: Path | None) -> dict[str, Any]:
    """Return the limits by robot and part of the body; empty unless the mode is ``hybrid``."""
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
    """Notes for cells in which a robot may touch people."""
    allowed = [(robot, model) for robot, model in robots if robot.contact is not None]
    if not allowed:
        return []
    names = ", ".join(robot.name for robot, _ in allowed)
    if risk.mode != "hybrid":
        return [f"contact: allowed of {names} has no effect: risk.mode is {risk.mode}, not hybrid"]
    table = load_table(risk.contact.table, base_dir)
    said = " ".join(table.source.split())
    notes = [
        f"CONTACT IS ALLOWED: {names} may touch people. Measure force and pressure on the robot "
        f"before people work next to it (ISO 10218-2:2025), as described in docs/guides/contact.md",
        f"contact limits: {said}",
    ]
    for robot, model in allowed:
        if model.contact is not None:
            source = " ".join(model.contact.source.split())
            notes.append(f"robot {robot.name}: mass and area of contact: {source}")
        notes += _milder_than_shipped(table, robot.name, model)
        notes += _around(risk, robot)
    if risk.contact.own_speed == "left_out":
        notes.append(
            "risk.contact.own_speed left_out: the speed of a body part is not subtracted, so a "
            "person who moves into the robot may hit it faster than the limits allow"
        )
    if risk.contact.fixtures is None:
        notes.append(
            "no risk.contact.fixtures: only the floor and the table under a robot count as "
            "surfaces that it may clamp people against; list machines, walls and racks"
        )
    return notes


def unseen_ends_note(risk: RiskSettings, mapped: Bools) -> list[str]:
    """Return a note that the robot stops near hands and feet if the tracker does not deliver them.

    Args:
        risk: risk settings of the configuration.
        mapped: (J,) canonical joints that the source's joint map gives.
    """
    ends = ("l_hand", "r_hand", "l_foot", "r_foot")
    unseen = [name for name in ends if not mapped[CANONICAL.index(name)]]
    if risk.mode != "hybrid" or risk.contact.own_speed == "left_out" or not unseen:
        return []
    return [
        f"contact: {', '.join(unseen)} not delivered by the tracker, so their speed is unknown: a "
        f"robot within reach of them stops (risk.contact.own_speed left_out: it may continue)"
    ]


def _milder_than_shipped(table: ContactTable, robot: str, model: RobotModel) -> list[str]:
    assert model.contact is not None  # the robot would not have been loaded
    area, shipped = model.contact.area_cm2, load_table(None, None)
    milder = [
        region.replace("_", " ")
        for region, limits in table.regions.items()
        if region not in NEVER
        and any(
            limits.speed_m_s(model.effective_kg, area, clamped=clamped)
            > shipped.regions[region].speed_m_s(model.effective_kg, area, clamped=clamped)
            for clamped in (False, True)
        )
    ]
    if not milder:
        return []
    return [
        f"robot {robot}: risk.contact.table lets it touch {', '.join(milder)} faster than the "
        f"shipped table (ISO/TS 15066) does"
    ]


def _around(risk: RiskSettings, robot: RobotSettings) -> list[str]:
    """Return a note on fixtures that contain the robot, near which any person counts as clamped."""
    if robot.room_from_robot is None:  # on a base that moves; refused elsewhere
        return []
    above = robot.room_from_robot.matrix()[:3] @ (0.0, 0.0, _ABOVE_BASE_M, 1.0)
    return [
        f"risk.contact.fixtures: robot {robot.name} stands in or behind {fixture.name}, so every "
        f"person next to it counts as clamped; point a plane's normal to the free side, or make "
        f"a box smaller"
        for fixture in risk.contact.fixtures or ()
        if fixture.distance(above) <= 0
    ]


def contact_table(name: str, facts: dict[str, Any]) -> Table:
    """The limits of one robot."""
    table = Table(
        title=f"Contact with robot {name}: {facts['effective_kg']:g} kg effective, "
        f"{facts['area_cm2']:g} cm2; clamped against {', '.join(facts['fixtures'])}",
        title_justify="left",
    )
    table.add_column("part of the body")
    table.add_column("decisive region")
    table.add_column("free, m/s", justify="right")
    table.add_column("clamped, m/s", justify="right")
    for part, limits in facts["parts"].items():
        speeds = [limits["free_m_s"], limits["clamped_m_s"]]
        shown = [f"{v:.2f}" if v > 0 else "never" for v in speeds]
        table.add_row(part, limits["region"].replace("_", " "), *shown)
    return table


# -- effect of each tool on a robot, and the worst case: a part of check -------------------------

WORST = "worst case"


def tool_facts(
    robots: Sequence[RobotModel], settings: Sequence[RobotSettings]
) -> dict[str, dict[str, Any]]:
    """By robot and tool: number, reach (m), and stop from full speed (s, m); the worst last.

    A robot without tools is left out.
    """
    found: dict[str, dict[str, Any]] = {}
    for model, entry in zip(robots, settings, strict=True):
        if entry.tools is None:
            continue
        numbers = {tool.name: tool.number for tool in entry.tools}
        rows = {name: _facts(own, entry, numbers[name]) for name, own in model.tools.items()}
        found[model.name] = {**rows, WORST: _facts(model, entry, None)}
    return found


def _facts(model: RobotModel, entry: RobotSettings, number: int | None) -> dict[str, Any]:
    time_s, distance_m = model.stopping(entry.max_speed_m_s)
    return {
        "number": number,
        "stopping_s": time_s,
        "stopping_m": distance_m,
        "reach_m": model.reach_m,
    }


def tool_tables(found: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """A table for each robot with tools."""
    tables = []
    for robot, tools in found.items():
        table = Table(title=f"Tools of {robot}, at full speed", title_justify="left")
        table.add_column("tool")
        for column in ("number", "T_s, ms", "S_s, mm", "reach, m"):
            table.add_column(column, justify="right")
        for name, facts in tools.items():
            number = "-" if facts["number"] is None else str(facts["number"])
            table.add_row(
                f"{name}: none is confirmed" if name == WORST else name,
                number,
                f"{1e3 * facts['stopping_s']:.0f}",
                f"{1e3 * facts['stopping_m']:.0f}",
                f"{facts['reach_m']:.2f}",
            )
        tables.append(table)
    return tables


def base_notes(settings: Sequence[RobotSettings]) -> list[str]:
    """Return notes for the integrator of a robot with a moving base or with tools."""
    notes = []
    for entry in settings:
        if entry.base is not None:
            notes.append(
                f"robot {entry.name}: its base moves; its speed is the arm's speed relative to the "
                f"base plus the base's speed, and RobotState must give the pose of the base"
            )
        notes += [
            f"robot {entry.name}: tool {tool.name} has no number, so RobotState cannot name it; it "
            f"is used only for the worst case"
            for tool in entry.tools or ()
            if tool.number is None
        ]
    return notes
