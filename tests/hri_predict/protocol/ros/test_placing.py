"""People in the wanted frame."""

import numpy as np
import pytest

from hri_predict.protocol.ros.bodies import MARKER_ARRAY, POSE_ARRAY, MessageError
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.placing import PeopleReader

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.protocol.ros.sent import UPRIGHT, Maker

MAKER = Maker()
POINT = np.array([[1.0, 2.0, 3.0]])


def reader(scale_to_m=1.0):
    tree = FrameTree()
    edge = ("map", "camera", (0.0, 0.0, 2.0), UPRIGHT)
    tree.add(MAKER.transforms(edge), static=True)
    return PeopleReader(["joint"], "map", tree, scale_to_m)


def placed(kind, message, scale_to_m=1.0, **options):
    made = reader(scale_to_m)
    return made.place(made.parse(kind, message), **options)


def test_people_of_another_frame_are_placed_by_its_transform():
    found = placed(POSE_ARRAY, MAKER.poses(POINT, "camera"))
    np.testing.assert_array_equal(found.people[0].positions, [[1, 2, 5]])
    assert found.frame == "map"


def test_the_unit_is_of_the_message_not_of_the_transform():
    found = placed(POSE_ARRAY, MAKER.poses(POINT * 1000, "camera"), 0.001)
    np.testing.assert_allclose(found.people[0].positions, [[1, 2, 5]], rtol=1e-15)


@pytest.mark.parametrize("points", [POINT, np.zeros((0, 3))])
def test_an_unknown_frame_is_refused_even_without_people(points):
    with pytest.raises(MessageError) as caught:
        placed(POSE_ARRAY, MAKER.poses(points, "lidar"))
    assert str(caught.value) == (
        "frame_id 'lidar' is not 'map': no transform connects 'lidar' to 'map'; publish the "
        "transform on /tf_static, or correct 'frame'"
    )


def test_an_empty_frame_is_refused():
    with pytest.raises(MessageError, match="frame_id is empty"):
        placed(POSE_ARRAY, MAKER.poses(POINT, ""))


def test_no_markers_are_no_people_in_any_frame():
    assert placed(MARKER_ARRAY, MAKER.marker_array([])).people == ()
