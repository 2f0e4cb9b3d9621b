"""The plan in characters: everything that is near is on it, and nothing absurd shrinks it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from hri_predict.base.geometry import Capsules
from hri_predict.cli.terminal.view import FARTHEST_M, CharacterPlan, Extent


def rows_of(plan):
    return plan.text().plain.split("\n")


@given(
    arrays.arrays(float, (4, 3), elements=st.floats(-FARTHEST_M + 2, FARTHEST_M - 2)),
    st.integers(20, 120),
    st.integers(8, 50),
)
def test_every_point_of_the_room_is_on_the_plan(points, columns, rows):
    extent = Extent(np.zeros((1, 2)))
    extent.include(points)
    for point in points:
        plan = CharacterPlan(extent, columns, rows)
        plan.dots(point[None], "o", "")
        lines = rows_of(plan)
        assert [len(line) for line in lines] == [columns] * rows
        assert "o" in "".join(lines)


def test_x_points_right_and_y_points_up():
    plan = CharacterPlan(Extent(np.zeros((1, 2))), 41, 21)
    plan.dots(np.array([[1.5, 0.0, 1.0]]), "x", "")
    plan.dots(np.array([[0.0, 1.5, 1.0]]), "y", "")
    plan.dots(np.zeros((1, 3)), "0", "")
    place = {
        mark: next(
            (row, line.index(mark)) for row, line in enumerate(rows_of(plan)) if mark in line
        )
        for mark in "xy0"
    }
    assert place["x"][1] > place["0"][1]
    assert abs(place["x"][0] - place["0"][0]) <= 1
    assert place["y"][0] < place["0"][0]


def test_an_impossible_or_missing_place_does_not_change_the_plan():
    extent = Extent(np.array([[1.0, 2.0]]))
    before = (extent.low.copy(), extent.high.copy())
    extent.include(np.array([[1e6, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 1.0, 1.0]]))
    np.testing.assert_array_equal((extent.low, extent.high), before)


def test_the_plan_only_grows():
    extent = Extent(np.zeros((0, 2)))
    extent.include(np.array([[5.0, 0.0, 1.0]]))
    high = extent.high[0]
    extent.include(np.array([[1.0, 0.0, 1.0]]))
    assert extent.high[0] == high > 5.0


def test_a_zone_covers_what_lies_under_it():
    plan = CharacterPlan(Extent(np.zeros((1, 2))), 40, 20)
    plan.capsules(
        Capsules(np.array([[-1.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 1.0]]), np.array([0.3])),
        "·",
        "",
    )
    widest = max(line.count("·") for line in rows_of(plan))
    assert widest * plan.column_m >= 2.0
