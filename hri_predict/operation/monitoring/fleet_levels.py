"""State of a cell on a page: its worst known level, and the reason."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hri_predict.operation.monitoring.fleet import SILENT, UNKNOWN, CellRow, RobotRow
from hri_predict.protocol.messages import LEVELS

GONE = "GONE"
"""Level shown for a cell without messages: its actual level is unknown."""
WORST_FIRST = [level.name for level in reversed(LEVELS)]
WORST_FIRST.insert(WORST_FIRST.index("UNKNOWN"), GONE)
_LIVE = ("running", "degraded")
_WHY = {SILENT: "no advice for this robot", UNKNOWN: "its capture is too old"}


@dataclass(frozen=True, slots=True)
class CellLevel:
    """A level and its reason; ``robot`` is ``None`` for the whole cell."""

    robot: int | None
    level: str
    reason: str
    limit_m_s: float | None = None


def findings(row: CellRow) -> list[CellLevel]:
    """Return the known state of a cell and each of its robots; at least one.

    For a cell with an untrusted report, only this fact is returned, because its robots' levels are
    unknown.
    """
    if row.state == SILENT:
        return [CellLevel(None, GONE, row.why)]
    if row.state == UNKNOWN:
        return [CellLevel(None, "UNKNOWN", row.why or "the node's state is unknown")]
    found = [_of(robot) for robot in row.robots]
    if row.state not in _LIVE:
        is_fault = row.state == "fault"
        why = "the node reports a fault" if is_fault else f"the node is {row.state}"
        found.insert(0, CellLevel(None, "FAULT" if is_fault else "UNKNOWN", row.why or why))
    return found or [CellLevel(None, "UNKNOWN", "no advice for any robot yet")]


def worst(found: Sequence[CellLevel]) -> CellLevel:
    """Return the most severe finding; the first if several are equal."""
    return min(found, key=lambda each: WORST_FIRST.index(each.level))


def tile(row: CellRow) -> dict[str, Any]:
    """Return plain data of a cell for a page, which shows level, reason and limit first."""
    found = findings(row)
    shown = worst(found)
    which = f"robot {shown.robot}: " if shown.robot is not None and len(row.robots) > 1 else ""
    return {
        "name": f"{row.site}/{row.cell}",
        "level": shown.level,
        "reason": which + shown.reason,
        "limit_m_s": shown.limit_m_s,
        "note": f"degraded: {row.why}" if row.state == "degraded" else "",
        "node": row.state,
        "people": row.people,
        "age_s": row.age_s,
        "heard_s": row.heard_s,
        "lost": row.lost,
        "refused": row.refused,
        "robots": [_details(robot) for robot in row.robots],
    }


def _details(robot: RobotRow) -> dict[str, Any]:
    shown = _of(robot)
    return {
        "robot": robot.robot,
        "level": shown.level,
        "reason": shown.reason,
        "limit_m_s": shown.limit_m_s,
        "separation_m": robot.separation_m,
    }


def _of(robot: RobotRow) -> CellLevel:
    level = GONE if robot.level == SILENT else robot.level.upper()
    reason = _WHY.get(robot.reason, robot.reason)
    return CellLevel(robot.robot, level, reason, robot.speed_limit_m_s)
