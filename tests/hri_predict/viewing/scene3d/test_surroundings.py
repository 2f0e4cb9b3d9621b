import numpy as np
import pytest

from hri_predict.viewing.levels import COLOURS, GREY
from hri_predict.viewing.room import room_of
from tests.hri_predict.viewing.staged import cell

pytest.importorskip("viser", reason="the extra viewer is not installed")


@pytest.fixture
def server():
    from hri_predict.viewing.scene3d.server import serve

    made = serve("127.0.0.1", 0)
    yield made
    made.stop()


@pytest.fixture
def facts(tmp_path):
    named = {"bench": [False, 0.8]}
    return {"room": room_of(cell(tmp_path)), "named": named, "places": [[0.5, 1.0]], "sees": True}


def drawn(server) -> list[str]:
    return [path for path in server.scene._handle_from_node_name if path.count("/") == 1]


def test_the_view_the_shadows_and_the_unseen_floor_are_drawn(server, facts):
    from hri_predict.viewing.scene3d.surroundings import Surroundings

    room = Surroundings(server)
    room.draw(facts, True)
    assert {"/shadows", "/unseen"} <= set(drawn(server))
    labels = {part.text for part in room._parts if hasattr(part, "text")}
    assert labels == {"field of view", "shadow", "bench", "camera"}
    before = room._floor.batched_positions.copy()
    room.draw(facts | {"places": [[1.5, 0.0]]}, True)
    assert not np.array_equal(room._floor.batched_positions, before)  # the person's shadow moved


def test_a_floor_that_did_not_change_is_not_sent_again(server, facts, monkeypatch):
    from hri_predict.viewing.scene3d.surroundings import Surroundings

    room = Surroundings(server)
    room.draw(facts, True)
    monkeypatch.setattr(room, "_lay", lambda tiles: pytest.fail("sent again"))
    room.draw(facts | {"named": {"bench": [True, 0.0]}}, True)


def test_a_picture_that_is_not_of_now_shows_no_free_floor(server, facts):
    from hri_predict.viewing.scene3d.surroundings import Surroundings

    room = Surroundings(server)
    room.draw(facts, True)
    seen = room._tiles[:, 2].sum()
    room.draw(facts, False)
    assert room._tiles[:, 2].sum() > 1.3 * seen


def test_a_room_that_says_nothing_has_nothing(server, facts):
    from hri_predict.viewing.scene3d.surroundings import Surroundings

    empty = facts["room"] | {"view": None, "shadows": [], "viewpoints": [], "named": []}
    room = Surroundings(server)
    room.draw(facts, True)
    room.draw(facts | {"room": empty}, True)
    assert room._parts == []
    assert "/shadows" not in drawn(server)
    assert len(room._floor.batched_positions) == 2  # of no size


def test_named_zones_have_the_colour_of_their_state(server, facts):
    from hri_predict.viewing.scene3d.solids import linear
    from hri_predict.viewing.scene3d.surroundings import Surroundings

    room = Surroundings(server)
    for state, name in (([True, 0.0], "STOP"), ([False, 0.8], "WARN"), ([False, None], "CLEAR")):
        room.draw(facts | {"named": {"bench": state}}, True)
        np.testing.assert_array_equal(room._outlines["bench"].colors[0, 0], linear(COLOURS[name]))
    room.draw(facts, False)
    np.testing.assert_array_equal(room._outlines["bench"].colors[0, 0], linear(GREY))


def test_a_zone_without_a_state_is_grey_never_green(server, facts):
    """As in pictures of a tick that failed, of the node's start, and of its end."""
    from hri_predict.viewing.scene3d.solids import linear
    from hri_predict.viewing.scene3d.surroundings import Surroundings

    room = Surroundings(server)
    room.draw(facts | {"named": {"bench": [False, None]}}, True)
    room.draw(facts | {"named": {}}, True)
    np.testing.assert_array_equal(room._outlines["bench"].colors[0, 0], linear(GREY))


def test_the_sides_of_prisms_close():
    from hri_predict.viewing.scene3d.surroundings import sides_of

    square = {"polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "z_min": 0.0, "z_max": 2.0}
    triangle = {"polygon": [[5, 0], [6, 0], [5, 1]], "z_min": 0.5, "z_max": 1.5}
    vertices, faces = sides_of([square, triangle])
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    # 32-bit floats: 1e-7 of 11 m2, times ten
    assert area == pytest.approx(4 * 2.0 + (2 + np.sqrt(2)) * 1.0, abs=1e-5)
