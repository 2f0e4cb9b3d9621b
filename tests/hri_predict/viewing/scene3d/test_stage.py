from typing import Any

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL
from hri_predict.viewing.levels import COLOURS, FORECAST, GREY, LOST, PERSON
from hri_predict.viewing.packing import bodies_of
from hri_predict.viewing.picture import Picture, empty_shapes

pytest.importorskip("viser", reason="the extra viewer is not installed")


@pytest.fixture
def server():
    from hri_predict.viewing.scene3d.server import serve

    made = serve("127.0.0.1", 0)
    yield made
    made.stop()


ROOM: dict[str, Any] = {"cell": "c", "named": [], "view": None, "shadows": [], "viewpoints": []}
ROOM |= {"sees_free_space": False, "walls": None, "floor_m": 0.0}


def picture(level: str = "SLOW") -> Picture:
    """One person here, one lost: zones of both at two times, and a robot of one capsule."""
    joints = np.random.default_rng(1).uniform(0, 2, (2, len(CANONICAL.joints), 3))
    bodies = bodies_of(joints)
    robot = {"name": "arm", "level": level, "capsules": 1, "separation_m": 0.7}
    robot |= {"line": [[0.0, 0, 1], [1.0, 0, 1]], "apart": "0.70 m"}
    facts = {"people": [4, 9], "tracked": 1, "zones": [4, 9], "times_s": [0.0, 1.0]}
    facts |= {"robots": [robot], "named": {"bench": [True, 0.0]}}
    square = {"polygon": [[0, 0], [1, 0], [1, 1]], "z_min": 0.0, "z_max": 1.0}
    facts |= {"places": [[1.0, 1.0]], "sees": True}
    facts["room"] = ROOM | {"named": [{"name": "bench", **square}], "view": square}
    zones = np.stack((bodies, bodies + np.float32(0.1)), axis=1)
    shapes = {"bodies": bodies, "forecast": zones[:1], "zones": zones}
    return Picture(facts, **{**empty_shapes(), **shapes, "robots": bodies[0, :1]})


def shown(handle) -> set[tuple[int, ...]]:
    return {tuple(int(c) for c in row) for row in handle.batched_colors}


def as_light(*colours) -> set[tuple[int, ...]]:
    """These colours as a batch is given them: in linear light."""
    from hri_predict.viewing.scene3d.solids import linear

    return {tuple(int(c) for c in linear(rgb)) for rgb in colours}


def test_people_lost_people_and_robots_have_their_colours(server):
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture(), 1.0)
    assert shown(stage._solid._parts[0]) == as_light(PERSON, LOST, COLOURS["SLOW"])
    assert shown(stage._clear._parts[0]) == as_light(FORECAST, LOST, COLOURS["SLOW"])
    assert len(stage._solid._parts[1].batched_positions) == 2 * len(CANONICAL.segments) + 1
    words = {label.text for label in stage._tags._labels.values() if label.visible}
    assert words == {"person 4", "person 9 (lost)", "arm: SLOW", "0.70 m"}
    np.testing.assert_allclose(stage._tags._lines.points, [[[0, 0, 1], [1, 0, 1]]])
    assert {tuple(c) for c in stage._tags._lines.colors[0]} == as_light(COLOURS["SLOW"])


def test_what_is_not_known_is_grey(server):
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture("CLEAR"), 0.5, known=False)
    assert shown(stage._solid._parts[0]) == shown(stage._clear._parts[0]) == as_light(GREY)
    outline = stage._surroundings._outlines["bench"]
    assert {tuple(c) for c in outline.colors.reshape(-1, 3)} == as_light(GREY)


def test_zones_are_drawn_at_the_time_that_was_asked_for(server):
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture(), 0.0)
    now = stage._clear._parts[1].batched_positions[-1].copy()
    stage.draw(picture(), 1.0)
    then = stage._clear._parts[1].batched_positions[-1]
    np.testing.assert_allclose(then - now, 0.1, atol=1e-5)  # 32-bit floats at 2 m


def test_a_room_without_anybody_is_drawn_after_a_full_one(server):
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture(), 0.5)
    empty = picture()
    robots = [{**empty.facts["robots"][0], "capsules": 0, "line": None}]
    facts = {**empty.facts, "people": [], "tracked": 0, "zones": [], "robots": robots}
    facts["room"] = ROOM
    stage.draw(Picture({**facts, "named": {}}, **empty_shapes()), 0.5)
    assert len(stage._solid._parts[1].batched_positions) == 1  # one that is out of sight
    assert stage._tags._lines.points.max() <= 0  # out of sight
    assert not any(label.visible for label in stage._tags._labels.values())
    assert stage._surroundings._parts == []
