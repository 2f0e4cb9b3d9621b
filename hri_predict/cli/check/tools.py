"""Effect of each tool on a robot, and the worst of all: a part of ``check``."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from hri_predict.robots.model import RobotModel
from hri_predict.robots.settings import RobotSettings

WORST = "worst of all"


def tool_facts(
    robots: Sequence[RobotModel], settings: Sequence[RobotSettings]
) -> dict[str, dict[str, Any]]:
    """By robot and tool: its number, reach (m), and stop from full speed (s, m); the worst last.

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
    """Notes for the person who wires a robot with a moving base or with tools."""
    notes = []
    for entry in settings:
        if entry.base is not None:
            notes.append(
                f"robot {entry.name}: its base moves; its speed counts as the arm's against the "
                f"base plus the base's, and RobotState must say where the base is"
            )
        notes += [
            f"robot {entry.name}: tool {tool.name} has no number, so RobotState cannot name it; it "
            f"only counts in the worst of all"
            for tool in entry.tools or ()
            if tool.number is None
        ]
    return notes
