"""The shadows of boxes: whatever the cameras do not see lies in one of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.geometry import in_polygon
from hri_sim.faults.injector import _crosses
from hri_sim.simulation.occluded import shadows_of

ROOM_M = 5.0
near = st.floats(-3.0, 3.0)
sizes = st.floats(0.1, 1.5)
boxes = st.builds(
    lambda x, y, w, d, h: [x, y, x + w, y + d, h], near, near, sizes, sizes, st.floats(0.3, 3.0)
)
cameras = st.sampled_from([[x, y, 2.5] for x in (-5.0, 5.0) for y in (-5.0, 5.0)])


@given(
    st.lists(boxes, min_size=1, max_size=3),
    st.lists(cameras, min_size=1, max_size=2, unique_by=tuple),
    st.integers(0, 2**32 - 1),
)
def test_every_hidden_point_lies_in_a_shadow(boxes, cameras, seed):
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-5, 5, (200, 2)), rng.uniform(0, 1.8, 200)])
    corners = np.array(boxes)
    low = np.column_stack([corners[:, :2], np.zeros(len(corners))])
    hidden = np.all([_crosses(np.array(c), points, low, corners[:, 2:]).any(1) for c in cameras], 0)
    shadows = shadows_of(boxes, cameras, ROOM_M)
    polygons = [np.array(shadow["polygon"]) for shadow in shadows]
    inside = np.zeros(len(points), bool)
    for polygon in polygons:
        inside |= in_polygon(points[:, :2], polygon)
    # thinner slivers than a hundred square centimetres are left out
    assert (hidden & ~inside).sum() <= 1


def test_no_box_casts_no_shadow():
    assert shadows_of([], [[-5.0, -5.0, 2.5]], ROOM_M) == []
    assert shadows_of([], [], ROOM_M)[0]["polygon"][0] == [-ROOM_M, -ROOM_M]
