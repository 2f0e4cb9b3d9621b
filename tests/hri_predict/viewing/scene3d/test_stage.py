from dataclasses import replace
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


def shown(solids) -> set[tuple[int, ...]]:
    """The colours of the capsules that are seen."""
    _, middles = solids._parts[-1]
    return {tuple(int(c) for c in row) for row in middles.batched_colors[ENDS:]}


ENDS = 2
"""Of each batch, the first two points are never seen: they hold its middle."""


def as_light(*colours) -> set[tuple[int, ...]]:
    """These colours as a batch is given them: in linear light."""
    from hri_predict.viewing.scene3d.solids import linear

    return {tuple(int(c) for c in linear(rgb)) for rgb in colours}


def test_people_lost_people_and_robots_have_their_colours(server):
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture(), 1.0)
    assert shown(stage._solid) == as_light(PERSON, LOST, COLOURS["SLOW"])
    assert shown(stage._ghosts) == as_light(FORECAST)
    assert shown(stage._zones) == as_light(LOST, COLOURS["SLOW"])
    drawn = stage._solid._parts[-1][1].batched_positions[ENDS:]
    assert len(drawn) == 2 * len(CANONICAL.segments) + 1
    words = {label.text for label in stage._tags._labels.values() if label.visible}
    assert words == {"person 4", "person 9 (lost)", "arm: SLOW", "0.70 m"}
    np.testing.assert_allclose(stage._tags._lines.points, [[[0, 0, 1], [1, 0, 1]]])
    assert {tuple(c) for c in stage._tags._lines.colors[0]} == as_light(COLOURS["SLOW"])


def test_what_is_not_known_is_grey(server):
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture("CLEAR"), 0.5, known=False)
    for solids in (stage._solid, stage._ghosts, stage._zones):
        assert shown(solids) == as_light(GREY)
    outline = stage._surroundings._outlines["bench"]
    assert {tuple(c) for c in outline.colors.reshape(-1, 3)} == as_light(GREY)


def test_zones_are_drawn_at_the_time_that_was_asked_for(server):
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture(), 0.0)
    now = stage._zones._parts[-1][1].batched_positions[-1].copy()
    stage.draw(picture(), 1.0)
    then = stage._zones._parts[-1][1].batched_positions[-1]
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
    assert len(stage._solid._parts[-1][1].batched_positions) == ENDS
    assert stage._tags._lines.points.max() <= 0  # out of sight
    assert not any(label.visible for label in stage._tags._labels.values())
    assert stage._surroundings._parts == []


def test_an_invisible_surface_is_drawn_before_what_is_seen_through(server):
    """Browsers draw batches with one middle in the order in which they were made."""
    from hri_predict.viewing.scene3d.stage import Stage

    stage = Stage(server)
    stage.draw(picture(), 0.5)
    for solids in (stage._ghosts, stage._zones):
        surface, seen = solids._parts
        assert {part.opacity for part in surface} == {0.0}
        assert all(0 < (part.opacity or 0.0) < 1 for part in seen)
        for hidden, part in zip(surface, seen, strict=True):
            np.testing.assert_array_equal(hidden.batched_positions, part.batched_positions)
            np.testing.assert_array_equal(hidden.batched_scales, part.batched_scales)
            assert part.batched_opacities is None  # else each picture would make a new batch
            np.testing.assert_array_equal(part.batched_positions[:2, 2], [-500.0, 500.0])


def test_the_links_of_a_robot_differ_in_brightness(server):
    from hri_predict.viewing.scene3d.stage import Stage

    made = picture()
    made.facts["robots"][0]["capsules"] = 3
    stage = Stage(server)
    stage.draw(replace(made, robots=made.bodies[0, :3]), 0.5)
    first, second, third = stage._solid._parts[-1][1].batched_colors[-3:].tolist()
    assert first == third
    assert max(second) < max(first)
    assert max(second) > 0.3 * max(first)  # in linear light: not black
