"""A tile never shows a cell as better than the worst that is known of it."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.operation.monitoring.fleet import SILENT, UNKNOWN, CellRow, RobotRow
from hri_predict.operation.monitoring.fleet_levels import GONE, WORST_FIRST, findings, tile, worst

LEVELS = ("clear", "warn", "slow", "stop", "unknown", "fault", SILENT)
STATES = ("running", "degraded", "starting", "stopping", "fault", SILENT, UNKNOWN)


def robot(level: str, index: int = 0) -> RobotRow:
    return RobotRow(robot=index, level=level, reason=level, speed_limit_m_s=0.5, separation_m=None)


def row(state: str = "running", *levels: str, why: str = "") -> CellRow:
    robots = tuple(robot(level, i) for i, level in enumerate(levels))
    return CellRow(
        site="plant",
        cell="press",
        state=state,
        why=why,
        people=1,
        age_s=0.1,
        heard_s=0.1,
        robots=robots,
        lost=0,
        refused=0,
    )


@given(st.sampled_from(STATES), st.lists(st.sampled_from(LEVELS), max_size=4))
def test_clear_needs_a_node_that_runs_and_all_robots_clear(state: str, levels: list[str]) -> None:
    shown = tile(row(state, *levels))
    is_clear = state in ("running", "degraded") and bool(levels) and set(levels) == {"clear"}
    assert (shown["level"] == "CLEAR") == is_clear
    assert shown["level"] in WORST_FIRST


def test_the_worst_robot_decides_level_reason_and_limit() -> None:
    cell = row("running", "clear", "slow")
    robots = (cell.robots[0], replace(cell.robots[1], reason="near", speed_limit_m_s=0.25))
    shown = tile(replace(cell, robots=robots))
    assert (shown["level"], shown["reason"], shown["limit_m_s"]) == ("SLOW", "robot 1: near", 0.25)


def test_of_a_cell_that_is_not_trusted_no_robot_says_anything() -> None:
    (found,) = findings(row(SILENT, SILENT, why="no messages"))
    assert (found.robot, found.level, found.reason) == (None, GONE, "no messages")
    (found,) = findings(row(UNKNOWN, UNKNOWN, why="two nodes use one key"))
    assert (found.level, found.reason) == ("UNKNOWN", "two nodes use one key")


@pytest.mark.parametrize(
    ("state", "levels", "level", "reason"),
    [
        ("running", (), "UNKNOWN", "no advice for any robot yet"),
        ("running", (SILENT,), GONE, "no advice for this robot"),
        ("running", ("unknown",), "UNKNOWN", "its capture is too old"),
        ("starting", ("clear",), "UNKNOWN", "the node is starting"),
        ("fault", ("clear",), "FAULT", "the node reports a fault"),
    ],
)
def test_each_gap_is_said_in_plain_words(
    state: str, levels: tuple[str, ...], level: str, reason: str
) -> None:
    found = worst(findings(row(state, *levels)))
    assert (found.level, found.reason) == (level, reason)


def test_a_degraded_node_is_noted_beside_its_level() -> None:
    shown = tile(row("degraded", "clear", why="the predictor was late"))
    assert shown["note"] == "degraded: the predictor was late"
    assert not tile(row("running", "clear"))["note"]
