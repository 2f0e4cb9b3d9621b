"""The floor in cells."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Region
from hri_predict.commissioning.playback import BASE_M, Grid

ONE = np.array([[0.0, 0.0, 2.0]])
coordinates = st.floats(-3, 3)


def cell_of(grid, x, y):
    """The cell; ``None`` beside the grid, which an ulp inside its far edge is, too: sums round."""
    column, row = (
        int(np.floor((v - o) / grid.cell_m)) for v, o in zip((x, y), grid.origin, strict=True)
    )
    inside = 0 <= column < grid.columns and 0 <= row < grid.rows
    return row * grid.columns + column if inside else None


def test_the_area_is_the_circle_without_the_base():
    found = Grid(0.1, ONE).result()
    assert len(found.area) * 0.01 == pytest.approx(np.pi * (2.0**2 - BASE_M**2), rel=0.02)
    assert found.coverage == 0.0
    assert found.outside == []


def test_two_robots_share_one_floor_and_machines_and_view_take_from_it():
    two = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0]])
    whole = len(Grid(0.25, two).result().area)
    assert whole > len(Grid(0.25, ONE).result().area)
    machine = np.array([[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]])
    assert len(Grid(0.25, two, exclude=[machine]).result().area) == whole - 16
    view = Region(polygon=[[-9, 0], [9, 0], [9, 9], [-9, 9]])
    half = Grid(0.25, two, view=view).result()
    assert len(half.area) == len(half.outside) == whole / 2


@given(st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=20))
@example([(np.nextafter(2.0, 0.0), 0.0)])
def test_each_observed_joint_is_in_its_cell_and_once_a_tick(points):
    grid = Grid(0.25, ONE)
    joints = np.array([[x, y, 1.0] for x, y in points])
    observed = np.arange(len(points)) % 2 == 0
    grid.see(joints, observed)
    found = grid.result()
    inside = {
        cell_of(found, x, y) for (x, y), there in zip(points, observed, strict=True) if there
    } - {None}
    assert found.seen == dict.fromkeys(sorted(inside), 1)
    assert found.coverage == len(inside & set(found.area)) / len(found.area)


def test_who_vanished_is_where_the_body_was_seen_last():
    grid = Grid(0.25, ONE)
    grid.lose(np.array([[1.0, 1.1, 0.5], [1.2, 1.1, 1.5], [np.nan] * 3]))
    grid.lose(np.full((3, 3), np.nan))
    found = grid.result()
    assert found.lost == {cell_of(found, 1.1, 1.1): 1}


@pytest.mark.parametrize(
    ("cell_m", "exclude", "why"),
    [
        (0.01, [], "at most 40000"),
        (0.25, [np.array([[-9.0, -9.0], [9, -9], [9, 9], [-9, 9]])], "no cell is left"),
    ],
)
def test_too_many_cells_or_none_are_refused(cell_m, exclude, why):
    with pytest.raises(ConfigError, match=why):
        Grid(cell_m, ONE, exclude=exclude)
