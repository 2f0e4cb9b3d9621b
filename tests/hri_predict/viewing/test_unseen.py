import numpy as np
import pytest

from hri_predict.people.lost.free_space import CELL_M
from hri_predict.viewing.room import room_of
from hri_predict.viewing.scene3d.surroundings import UnseenFloor
from tests.hri_predict.viewing.staged import cell


@pytest.fixture
def room(tmp_path):
    """A view of 5.8 x 5 m with a pallet's shadow, seen by one camera in a corner."""
    return room_of(cell(tmp_path))


def covers(tiles: np.ndarray, x: float, y: float) -> bool:
    apart = np.abs(tiles[:, :2] - [x, y])
    return bool((apart <= 0.5 * tiles[:, 2:]).all(axis=1).any())


def test_a_shadow_is_unseen_and_the_open_floor_is_not(room):
    tiles = UnseenFloor(room).tiles([], sees=True)
    assert covers(tiles, 2.9, 2.1)  # in the pallet's shadow
    assert covers(tiles, 4.1, 0.0)  # at the edge of the view: half a body may stand outside
    assert not covers(tiles, 0.5, 0.5)


def test_a_person_hides_the_floor_behind_from_the_camera(room):
    camera, person = np.array(room["viewpoints"][0][:2]), np.array([0.5, 1.0])
    behind = person + (person - camera) * 0.5
    floor = UnseenFloor(room)
    assert not covers(floor.tiles([], sees=True), *behind)
    tiles = floor.tiles([person.tolist()], sees=True)
    assert covers(tiles, *behind)
    assert not covers(tiles, *(person + (camera - person) * 0.5))  # in front


def test_without_viewpoints_anybody_may_hide_everything(room):
    floor = UnseenFloor(room | {"viewpoints": []})
    assert not covers(floor.tiles([], sees=True), 0.5, 0.5)
    whole = floor.tiles([[3.0, 0.0]], sees=True)
    assert covers(whole, 0.5, 0.5)
    assert covers(whole, 3.5, -1.0)


def test_scenes_that_prove_nothing_show_no_free_floor(room):
    tiles = UnseenFloor(room).tiles([], sees=False)
    xy = np.asarray(room["view"]["polygon"])
    width, depth = np.ptp(xy, axis=0)
    area = (tiles[:, 2] * tiles[:, 3]).sum()
    # cells count by their middles: up to half a cell is missing, or too much, along the edge
    assert area == pytest.approx(width * depth, abs=CELL_M * (width + depth))


@pytest.mark.parametrize(
    "other",
    [
        {"sees_free_space": False},
        {"view": None},
        {"view": {"polygon": [[0, 0], [900, 0], [0, 900]], "z_min": 0, "z_max": 3}},
    ],
)
def test_where_no_free_space_is_seen_nothing_is_drawn(room, other):
    assert len(UnseenFloor(room | other).tiles([[0, 0]], sees=False)) == 0


def test_there_are_few_tiles(room):
    """They go to each browser whenever somebody moves on by a cell."""
    assert len(UnseenFloor(room).tiles([[0.5, 1.0]], sees=True)) < 100  # 480 cells
