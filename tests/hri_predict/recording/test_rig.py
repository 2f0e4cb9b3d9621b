"""Joint names of rigs: what each calls a joint, and where it writes the side."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL
from hri_predict.recording.rig import map_of_rig, plain, rig_table, sided

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
    joint_map = map_of_rig(names)
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
    row = map_of_rig(names).weights[CANONICAL.index("l_wrist")]
    assert np.flatnonzero(row).tolist() == [names.index("LEFTHAND")]


def test_bvh_without_needed_joints_lists_what_is_missing():
    names = [n for n in RIGS["CMU"][0].split() if n not in ("LeftForeArm", "RightLeg")]
    with pytest.raises(ConfigError, match="no joint matches l_elbow, r_knee"):
        map_of_rig(names)
    with pytest.raises(ConfigError, match="l_shoulder, l_elbow"):
        map_of_rig([])


def test_a_rig_without_a_head_is_understood_but_not_one_without_legs():
    names = RIGS["Rokoko"][0].split()
    names.remove("Head")
    mapped = map_of_rig(names).mapped
    unmapped = {CANONICAL.joints[k] for k in np.flatnonzero(~mapped)}
    assert unmapped == {"head", "head_top", "l_hand", "r_hand"}
    with pytest.raises(ConfigError, match="no joint matches l_hip, l_knee, l_ankle, r_hip"):
        map_of_rig([name for name in names if "Thigh" not in name and name[-4:] not in _LEGS])


_LEGS = ("Shin", "Foot", "tToe")
SPELLINGS = {
    "word before": lambda side, name, gap: f"{side}{gap}{name}",
    "word after": lambda side, name, gap: f"{name}{gap}{side}",
    "letter before": lambda side, name, gap: f"{side[0]}{gap}{name}",
    "letter after": lambda side, name, gap: f"{name}{gap}{side[0]}",
}
LIMBS = sorted(
    (joint, alias)
    for joint, aliases in rig_table().aliases.items()
    for alias in aliases
    if joint not in CANONICAL.joints
)
STEMS = {plain(alias) for aliases in rig_table().aliases.values() for alias in aliases}


@given(
    limb=st.sampled_from(LIMBS),
    side=st.sampled_from(["left", "right", "Left", "Right", "LEFT", "RIGHT"]),
    spelling=st.sampled_from(sorted(SPELLINGS)),
    gap=st.sampled_from(["", "_", ".", "-", " ", "__"]),
    namespace=st.sampled_from(["", "mixamorig:", "rig|", "Bip01 ", "Anna:rig:"]),
    case=st.sampled_from([str, str.lower, str.upper]),
)
def test_a_side_is_understood_for_every_joint_wherever_and_however_it_is_written(
    limb, side, spelling, gap, namespace, case
):
    _, alias = limb
    name = case(namespace + SPELLINGS[spelling](side, alias, gap))
    assert sided(name, STEMS) == (side[0].lower(), plain(alias))


@given(
    limb=st.sampled_from([pair for pair in LIMBS if plain(pair[1] + "_End") in STEMS]),
    side=st.sampled_from(["L", "left"]),
    gap=st.sampled_from(["_", "."]),
)
def test_an_end_site_keeps_the_side_of_its_joint(limb, side, gap):
    name = f"{limb[1]}{gap}{side}_End"
    assert sided(name, STEMS) == ("l", plain(limb[1]) + "end")


@pytest.mark.parametrize(
    "name", ["Spine", "Head", "heel", "Hips", "leg", "Neck", "lowerback", "ball", "Collar", "", "l"]
)
def test_a_letter_of_the_name_itself_is_no_side(name):
    assert sided(name, STEMS)[0] == ""


PARTS = ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "Toes")


@pytest.mark.parametrize("spelled", ["{p}_{s}", "{s}_{p}", "{p}.{s}", "{s}{p}", "{p}{w}", "{w}{p}"])
def test_a_rig_is_understood_whole_however_it_writes_sides(spelled):
    names = ["Hips", "Spine", "Neck", "Head"]
    names += [
        spelled.format(p=part, s=word[0], w=word) for word in ("Left", "Right") for part in PARTS
    ]
    mapped = map_of_rig(names).mapped
    unmapped = {CANONICAL.joints[k] for k in np.flatnonzero(~mapped)}
    assert unmapped == {"head_top", "l_hand", "r_hand"}


def test_a_joint_is_used_once_and_a_foot_beside_an_ankle_is_the_foot():
    names = "Head ShoulderLeft ElbowLeft WristLeft HandLeft HandTipLeft HipLeft KneeLeft AnkleLeft"
    names += " FootLeft ShoulderRight ElbowRight WristRight HandRight HipRight KneeRight AnkleRight"
    given_names = [*names.split(), "FootRight"]
    joint_map = map_of_rig(given_names)
    for joint, source in {
        "l_ankle": "AnkleLeft",
        "l_foot": "FootLeft",
        "r_foot": "FootRight",
        "l_wrist": "WristLeft",
        "l_hand": "HandTipLeft",
    }.items():
        row = joint_map.weights[CANONICAL.index(joint)]
        assert [given_names[k] for k in np.flatnonzero(row)] == [source]
    assert not joint_map.mapped[CANONICAL.index("r_hand")]  # a palm is no finger tip
    single = joint_map.weights[[CANONICAL.index(j) for j in CANONICAL.joints if j[1] == "_"]]
    assert (np.count_nonzero(single, axis=0) <= 1).all()
