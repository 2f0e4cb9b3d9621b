"""Names with what a tracker writes before or after them all."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.shared_affix import without_shared

SHIPPED = [name for name in map_names() if name != "bvh"]
WRITTEN = ["K4ABT_JOINT_{}", "JointType_{}", "Bob_{}", "{}_pos", "Skeleton 001:{} (m)"]


@pytest.mark.parametrize("written", WRITTEN)
@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_map_is_known_whatever_stands_before_or_after_all_names(name, written):
    joints = load_joint_map(name).source_joints
    names = [written.format(joint) for joint in joints]
    found = map_of_names(names)
    assert found.source_joints == tuple(names)
    assert (found.weights == map_of_names(joints).weights).all()


def test_a_rig_of_optitrack_is_understood_with_the_name_of_the_person():
    trunk = ["Hip", "Ab", "Chest", "Neck", "Head"]
    limbs = ["Shoulder", "UArm", "FArm", "Hand", "Thigh", "Shin", "Foot", "Toe"]
    names = [f"Bob_{name}" for name in [*trunk, *(side + limb for side in "LR" for limb in limbs)]]
    found = map_of_names([*names, "Wand"])
    assert found.mapped.sum() == 18  # all but the crown and the finger tips
    assert not found.weights[:, -1].any()


@pytest.mark.parametrize(
    "names",
    [
        ["Left_Hip", "Left_Knee", "Left_Ankle", "Left_Foot"],  # a side is part of the name
        ["Hip_L", "Knee_L", "Ankle_L", "Foot_L"],
        ["P_Hip", "P_Knee", "Q_Knee", "Q_Hip"],  # too few of each
        ["P_Hip", "P_Knee", "P_Foot", "P_Head", "Hip"],  # two would be one
        ["Hip"],
        [],
    ],
)
def test_names_that_share_nothing_to_spare_stay(names):
    assert without_shared(names) == names


@given(st.lists(st.text("ab_ .LR", max_size=8), max_size=12))
def test_any_names_stay_as_many_and_as_different(names):
    bare = without_shared(names)
    assert len(bare) == len(names)
    assert len(set(bare)) == len(set(names))
    assert all(part in name for part, name in zip(bare, names, strict=True))
