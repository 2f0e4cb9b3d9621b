"""What counts as less safe, and what is only different."""

from dataclasses import replace

import pytest

from hri_predict.commissioning.compare import compare
from hri_predict.commissioning.playback import AdviceRow, Played
from hri_predict.commissioning.report import GridResult, Walk
from hri_predict.commissioning.walk import advice_by_robot

GRID = GridResult(
    cell_m=0.25, origin=[0.0, 0.0], columns=4, rows=4, area=[0, 1, 2, 5], outside=[],
    seen={0: 3, 1: 1}, lost={},
)  # fmt: skip
ROW = AdviceRow(
    time_s=0.0, robot="arm", level="slow", reason="person_near", separation_m=1.0,
    predicted_m=0.8, limit_m_s=0.4,
)  # fmt: skip
LEVELS = ["clear", "slow", "stop", "stop", "slow"]


def rows(levels=LEVELS, **changes):
    return [
        replace(ROW, time_s=round(0.04 * k, 6), level=level, **changes)
        for k, level in enumerate(levels)
    ]


def played(new=None, grid=GRID, lost=0):
    return Played(rows=rows() if new is None else new, grid=grid, people_lost=lost, seconds=1.0)


def walk(lost=1):
    return Walk(
        recording="w", recording_sha256="", advices="a", advices_sha256="", seconds=1.0,
        least_coverage=0.4, exclude=[], grid=GRID, robots=advice_by_robot(played()),
        people_lost=lost,
    )  # fmt: skip


def compared(new=None, **more):
    return compare(walk(), rows(), played(new, **{"lost": 1} | more))


def test_the_same_is_the_same():
    assert compared() == type(compared())([], [])


@pytest.mark.parametrize(
    ("new", "line"),
    [
        (rows(["clear", "slow", "slow", "stop", "slow"]), "a milder level in 1 of 5"),
        (rows(["clear", "slow", "stop", "stop", "clear"]), "first at 0.16 s: slow -> clear"),
        (rows(limit_m_s=0.5), "a higher speed limit in 5 of 5 advices, by up to 0.100 m/s"),
        (
            rows(separation_m=None),
            "no person is seen where one was in 5 of 5 advices; first at 0.00 s",
        ),
        (rows(predicted_m=None), "no person is predicted where one was in 5 of 5"),
        (rows(["slow"] * 5), "no stop any more; the first was at 0.08 s"),
        (rows(["clear", "slow", "slow", "stop", "stop"]), "first stop 0.08 s -> 0.12 s"),
        ([], "robot arm: it no longer gets advice"),
    ],
)
def test_what_permits_more_is_less_safe(new, line):
    assert any(line in each for each in compared(new).worse)


@pytest.mark.parametrize(
    ("new", "line"),
    [
        (rows(["slow", "slow", "stop", "stop", "slow"]), "a stricter level in 1 of 5"),
        (rows(["clear", "slow", "unknown", "stop", "slow"]), "a stricter level in 1 of 5"),
        (rows(limit_m_s=0.3), "a lower speed limit in 5 of 5"),
        (rows(separation_m=0.7), "a different separation in 5 of 5 advices, by up to 0.300 m"),
        (rows(predicted_m=0.9), "a different predicted separation in 5 of 5 advices, by up to 0.1"),
        (rows(reason="person_lost"), "a different reason in 5 advices"),
        ([*rows(), *rows([], robot="b"), replace(ROW, robot="b")], "robot b: is new"),
    ],
)
def test_what_permits_no_more_is_told_and_no_fault(new, line):
    found = compared(new)
    assert any(line in each for each in found.other)
    # a stop that another level takes the place of, which stops as well, is later in name alone
    assert [each for each in found.worse if "first stop" not in each] == []


def test_rounding_of_another_processor_is_no_difference():
    near = rows(limit_m_s=0.401, separation_m=1.001, predicted_m=0.799)
    assert compared(near).worse == []


def test_floor_that_is_not_seen_any_more_is_less_safe_wherever_the_grid_begins():
    moved = GRID.model_copy(
        update={
            "origin": [-0.25, 0.0], "columns": 5, "area": [1, 2, 3, 7], "seen": {1: 3},
        }
    )  # fmt: skip
    found = compared(grid=moved)
    assert found.worse == ["people are no longer seen in 1 cells of the floor"]
    more = GRID.model_copy(update={"seen": {0: 1, 1: 1, 2: 1}})
    assert compared(grid=more).worse == []
    larger = GRID.model_copy(update={"area": [0, 1, 2, 5, 6, 7, 9, 10]})
    found = compared(grid=larger)
    assert found.worse == []
    assert found.unwalked == [
        "floor around the robots: 4 -> 8 cells; people were seen in 2 (50.0 %) -> 2 (25.0 %) of "
        "them; the walk asks for 40 %: walk again with this configuration, over all of this "
        "floor"
    ]


@pytest.mark.parametrize(("lost", "worse"), [(0, False), (2, True)])
def test_more_people_lost_is_less_safe(lost, worse):
    assert bool(compared(lost=lost).worse) is worse


def test_another_rate_is_compared_in_time():
    fast = [r for row in rows() for r in (row, replace(row, time_s=row.time_s + 0.02))]
    assert compared(fast).worse == []
