"""Joints that move with a rigid body of markers."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.contracts.rigid_joint import RigidJoint

NAMES = ("collar", "left", "right", "belly")
SHOULDER = RigidJoint(
    at="collar", left=["right", "left"], up=["belly", "collar"], offset_m=[-0.1, 0.2, 0.1]
)
CHEST = np.array([[0.0, 0, 1.4], [0, 0.12, 1.4], [0, -0.12, 1.4], [0.02, 0, 1.05]])
angles = st.floats(-3.1, 3.1)
metres = st.floats(-50, 50)


def turned(yaw: float, pitch: float) -> np.ndarray:
    (c, s), (d, t) = ((np.cos(a), np.sin(a)) for a in (yaw, pitch))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [[d, 0, t], [0, 1, 0], [-t, 0, d]]


@given(angles, angles, st.tuples(metres, metres, metres))
def test_it_moves_with_its_body(yaw, pitch, shift):
    turn = turned(yaw, pitch)
    place, spans = SHOULDER.place(CHEST, NAMES)
    moved, still = SHOULDER.place(CHEST @ turn.T + shift, NAMES)
    assert spans
    assert still
    # 50 m in float64, a frame of 0.24 m: 1e-14 relative each, some ten operations
    np.testing.assert_allclose(moved, turn @ place + shift, atol=1e-11)


def test_it_stands_where_the_offset_says_and_the_axes_are_the_bodys():
    flat = CHEST * [0, 1, 1]
    np.testing.assert_allclose(SHOULDER.place(flat, NAMES)[0], [-0.1, 0.2, 1.5], atol=1e-12)


def test_markers_in_one_line_or_in_one_point_span_nothing():
    in_line = np.array([[0.0, 0, 0], [0, 0.1, 0], [0, -0.1, 0], [0, 0.3, 0]])
    for body in (in_line, np.zeros((4, 3))):
        place, spans = SHOULDER.place(body, NAMES)
        assert not spans
        assert np.isfinite(place).all()
