"""Labels of markers: whose they are, and what no camera could have filmed."""

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.recording.labels import MAX_ID, MAX_MARKERS, joined_labels, split_labels


def test_labels_that_were_joined_are_split_again():
    labels = joined_labels([3, 65535], ["wrist", "elbow"])
    assert labels == ["3:wrist", "3:elbow", "65535:wrist", "65535:elbow"]
    found = split_labels(labels, person=1)
    assert (found.ids, found.joints, found.note) == ((3, 65535), ("wrist", "elbow"), "")
    assert found.columns.tolist() == [[0, 1], [2, 3]]


def test_joints_whose_own_names_have_a_colon_keep_them_and_their_people():
    labels = joined_labels([3, 7], ["rig:hips", "rig:head"])
    found = split_labels(labels, person=1)
    assert (found.ids, found.joints, found.note) == ((3, 7), ("rig:hips", "rig:head"), "")
    assert split_labels(["rig:hips", "rig:head"], person=5).ids == (5,)


def test_two_people_never_share_an_id():
    found = split_labels(["1:wrist", "01:wrist", "Ben:wrist", "99999:wrist"], person=1)
    assert len(set(found.ids)) == 4
    assert found.ids[0] == 1
    assert "'01' is person 2" in found.note


def test_labels_that_are_no_positions_are_left_out_and_counted():
    found = split_labels(["Anna:wrist", "*7", "Anna:angle"], 1, ["Anna:angle", "Ben:angle"])
    assert (found.ids, found.joints) == ((1,), ("wrist",))
    assert "2 of 3 labels are not markers" in found.note


def test_points_without_any_name_are_nobody_and_no_empty_room():
    with pytest.raises(ConfigError, match="none of its 2 points has a name"):
        split_labels(["*1", ""], 1)


@pytest.mark.parametrize(
    "labels",
    [
        [f"p{k}:wrist" for k in range(MAX_ID + 2)],
        [f"p{k}:j{k}" for k in range(int(MAX_MARKERS**0.5) + 1)],
    ],
    ids=["people", "markers"],
)
def test_more_than_can_be_is_refused(labels):
    with pytest.raises(ConfigError, match="which is too many"):
        split_labels(labels, 1)
