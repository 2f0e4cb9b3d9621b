"""Distances of capsules from fixtures, against dense sampling."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import Capsules
from hri_predict.base.settings import Pose, validated
from hri_predict.risk.fixtures import PIECE_M, BoxFixture, PlaneFixture, floor, gaps

TURN = [0.0, 0.0, np.sin(0.3), np.cos(0.3)]
BOX = BoxFixture(
    kind="box", name="b", pose=Pose(xyz=[1, 2, 0.5], quaternion_xyzw=TURN), size=[1, 0.4, 1]
)
PLACE = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


@given(PLACE, PLACE, st.floats(0, 0.5))
def test_a_box_is_never_farther_than_said_and_at_most_half_a_piece_nearer(a, b, radius):
    found = float(gaps(Capsules(a, b, np.array(radius)), [BOX])[0])
    axis = a + np.linspace(0, 1, 2001)[:, None] * (b - a)
    matrix = BOX.pose.matrix()
    inside = (axis - matrix[:3, 3]) @ matrix[:3, :3]
    nearest = np.linalg.norm(np.maximum(np.abs(inside) - np.array(BOX.size) / 2, 0), axis=1).min()
    true = nearest - radius
    spacing = np.linalg.norm(b - a) / 2000
    assert found <= true + 1e-9
    assert found >= true - PIECE_M - spacing


def test_a_plane_is_exact_and_negative_behind():
    table = floor(0.7, "table")
    capsules = Capsules(
        np.array([[0, 0, 1.0], [0, 0, 0.5]]), np.array([[1, 0, 0.9], [5, 0, 2.0]]), np.full(2, 0.1)
    )
    assert gaps(capsules, [table])[:, 0] == pytest.approx([0.1, -0.3])


def test_what_is_not_finite_is_as_near_as_can_be():
    bad = Capsules(np.full(3, np.nan), np.zeros(3), np.array(0.1))
    assert np.all(gaps(bad, [BOX, floor(0.0, "floor")]) == -np.inf)


@pytest.mark.parametrize(
    ("model", "data", "said"),
    [
        (
            PlaneFixture,
            {"kind": "plane", "name": "p", "point": [0, 0, 0], "normal": [0, 0, 2]},
            "normal",
        ),
        (BoxFixture, {"kind": "box", "name": "b", "pose": {}, "size": [1, 0, 1]}, "size"),
        (BoxFixture, {"kind": "box", "name": "b", "pose": {}, "size": [1, 1]}, "size"),
        (BoxFixture, {"kind": "box", "name": "", "pose": {}, "size": [1, 1, 1]}, "name"),
    ],
)
def test_wrong_fixtures_are_refused(model, data, said):
    with pytest.raises(ConfigError, match=said):
        validated(model, data, "cell.yaml: risk.contact.fixtures.0")
