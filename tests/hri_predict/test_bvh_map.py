"""Joint maps of BVH files: the names that rigs use."""

import numpy as np
import pytest

from hri_predict.errors import ConfigError
from hri_predict.joint_map import resolve_bvh_map
from hri_predict.skeleton import CANONICAL

RIGS: dict[str, tuple[str, dict[str, str | None]]] = {
    "CMU": (
        "Hips LHipJoint LeftUpLeg LeftLeg LeftFoot LeftToeBase LeftToeBase_End RHipJoint RightUpLeg"
        " RightLeg RightFoot RightToeBase RightToeBase_End LowerBack Spine Spine1 Neck Neck1 Head"
        " Head_End LeftShoulder LeftArm LeftForeArm LeftHand LeftFingerBase LeftHandIndex1 LThumb"
        " RightShoulder RightArm RightForeArm RightHand RightFingerBase RightHandIndex1 RThumb",
        {"l_shoulder": "LeftArm", "torso": "Spine", "l_foot": "LeftToeBase_End", "head_top": None},
    ),
    "Daz": (
        "hip abdomen chest neck head leftEye rCollar rShldr rForeArm rHand rMid1 lCollar lShldr"
        " lForeArm lHand lMid1 rThigh rShin rFoot rToe lThigh lShin lFoot lToe",
        {"l_shoulder": "lShldr", "r_knee": "rShin", "torso": "chest", "l_hand": "lMid1"},
    ),
    "Mixamo": (
        "mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:Spine2 mixamorig:Neck"
        " mixamorig:Head mixamorig:HeadTop_End mixamorig:LeftShoulder mixamorig:LeftArm"
        " mixamorig:LeftForeArm mixamorig:LeftHand mixamorig:LeftHandMiddle4"
        " mixamorig:RightShoulder mixamorig:RightArm mixamorig:RightForeArm mixamorig:RightHand"
        " mixamorig:LeftUpLeg mixamorig:LeftLeg mixamorig:LeftFoot mixamorig:LeftToeBase"
        " mixamorig:RightUpLeg mixamorig:RightLeg mixamorig:RightFoot mixamorig:RightToeBase",
        {
            "head_top": "mixamorig:HeadTop_End",
            "l_hand": "mixamorig:LeftHandMiddle4",
            "l_wrist": "mixamorig:LeftHand",
            "r_hand": None,
        },
    ),
    "Xsens MVN": (
        "Hips Chest Chest2 Chest3 Chest4 Neck Head Head_End RightCollar RightShoulder RightElbow"
        " RightWrist LeftCollar LeftShoulder LeftElbow LeftWrist RightHip RightKnee RightAnkle"
        " RightToe LeftHip LeftKnee LeftAnkle LeftToe",
        {"l_shoulder": "LeftShoulder", "torso": "Chest3", "r_ankle": "RightAnkle", "l_hand": None},
    ),
    "Rokoko": (
        "Hips Spine Spine1 Neck Head LeftShoulder LeftArm LeftForeArm LeftHand RightShoulder"
        " RightArm RightForeArm RightHand LeftThigh LeftShin LeftFoot LeftToe RightThigh RightShin"
        " RightFoot RightToe",
        {"l_hip": "LeftThigh", "r_knee": "RightShin"},
    ),
    "Rigify": (
        "spine spine.001 spine.002 spine.003 spine.004 spine.005 spine.006 shoulder.L upper_arm.L"
        " forearm.L hand.L shoulder.R upper_arm.R forearm.R hand.R thigh.L shin.L foot.L toe.L"
        " thigh.R shin.R foot.R toe.R",
        {"head": "spine.006", "l_shoulder": "upper_arm.L", "r_foot": "toe.R", "torso": "spine.002"},
    ),
    "Biped": (
        "Bip01 Bip01_Pelvis Bip01_Spine Bip01_Neck Bip01_Head Bip01_L_Clavicle Bip01_L_UpperArm"
        " Bip01_L_Forearm Bip01_L_Hand Bip01_R_Clavicle Bip01_R_UpperArm Bip01_R_Forearm"
        " Bip01_R_Hand Bip01_L_Thigh Bip01_L_Calf Bip01_L_Foot Bip01_L_Toe0 Bip01_R_Thigh"
        " Bip01_R_Calf Bip01_R_Foot Bip01_R_Toe0",
        {"l_elbow": "Bip01_L_Forearm", "r_knee": "Bip01_R_Calf", "torso": "Bip01_Spine"},
    ),
}


@pytest.mark.parametrize("rig", RIGS)
def test_bvh_rigs_are_understood(rig):
    text, expected = RIGS[rig]
    names = text.split()
    joint_map = resolve_bvh_map(names)
    assert joint_map.source_joints == tuple(names)
    assert joint_map.scale_to_m == 0.01
    for joint, source in expected.items():
        row = joint_map.weights[CANONICAL.index(joint)]
        assert [names[i] for i in np.flatnonzero(row)] == ([] if source is None else [source])
    for left, right in CANONICAL.left_right_pairs[:3]:
        assert np.flatnonzero(joint_map.weights[left]) != np.flatnonzero(joint_map.weights[right])
    assert joint_map.mapped[CANONICAL.index("waist")]
    np.testing.assert_allclose(joint_map.weights.sum(axis=1)[joint_map.mapped], 1.0)


def test_bvh_names_are_compared_without_case_and_duplicates_take_the_first():
    names = [n.upper() for n in RIGS["CMU"][0].split()] + ["lefthand"]
    row = resolve_bvh_map(names).weights[CANONICAL.index("l_wrist")]
    assert np.flatnonzero(row).tolist() == [names.index("LEFTHAND")]


def test_bvh_without_needed_joints_lists_what_is_missing():
    names = [n for n in RIGS["CMU"][0].split() if n not in ("LeftForeArm", "RightLeg")]
    with pytest.raises(ConfigError, match="no joint matches l_elbow, r_knee"):
        resolve_bvh_map(names)
    with pytest.raises(ConfigError, match="head, l_shoulder"):
        resolve_bvh_map([])
