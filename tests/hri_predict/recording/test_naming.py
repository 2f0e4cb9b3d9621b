"""Which map a file's joint names give, and maps of the user's own."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.recording import open_recording
from hri_predict.recording.naming import map_of_names, with_map

SHIPPED = [name for name in map_names() if name != "bvh"]


def sources(joint_map):
    """Canonical joint -> the source's joints that give it."""
    names = joint_map.source_joints
    return {
        joint: {names[k] for k in np.flatnonzero(row)}
        for joint, row in zip(JOINTS, joint_map.weights, strict=True)
    }


@pytest.mark.parametrize("name", SHIPPED)
def test_the_joints_of_a_shipped_map_give_that_map(name):
    shipped = load_joint_map(name)
    found = map_of_names(shipped.source_joints)
    assert found.name == name
    np.testing.assert_array_equal(found.weights, shipped.weights)
    turned = map_of_names(shipped.source_joints[::-1])
    assert turned.name == (name if name == "canonical" else f"{name} by name")
    np.testing.assert_array_equal(turned.weights, shipped.weights[:, ::-1])


@pytest.mark.parametrize("name", ["coco17", "mediapipe33", "smpl22", "zed34", "azure_kinect32"])
@given(gap=st.sampled_from(["", "_", ".", " "]), after=st.booleans())
def test_a_shipped_map_is_known_in_another_spelling(name, gap, after):
    shipped = load_joint_map(name)
    other = {joint: spelled(joint, gap, after) for joint in shipped.source_joints}
    found = map_of_names(list(other.values()))
    expected = {j: {other[s] for s in own} for j, own in sources(shipped).items()}
    assert sources(found) == expected


def spelled(joint, gap, after):
    """left_hip, or HIP_LEFT, as LeftHip, Left.Hip, HipLeft, ..."""
    words = [word.capitalize() for word in joint.split("_")]
    side = next((word for word in words if word in ("Left", "Right")), None)
    if side is None:
        return gap.join(words)
    words.remove(side)
    return gap.join([*words, side] if after else [side, *words])


def test_of_two_maps_that_fit_the_one_that_gives_more_joints_holds():
    """The six arm joints alone are a shipped map; with legs they are part of a rig."""
    arms = [
        f"{side}{part}" for part in ("Wrist", "Elbow", "Shoulder") for side in ("Left", "Right")
    ]
    assert map_of_names(arms).name == "assembly_arms"
    legs = [f"{side}{part}" for part in ("Hip", "Knee", "Ankle") for side in ("Left", "Right")]
    whole = map_of_names([*arms, *legs, "Head"])
    assert whole.name == "bvh"
    assert whole.mapped[JOINTS.index("l_knee")]


def limbs(*parts):
    return {f"{side}_{part}" for part in parts for side in "lr"}


ARMS = "{0}Shoulder {0}Elbow {0}Wrist"
LEGS = "{0}Hip {0}Knee {0}Ankle"
FACE = "nose left_eye right_eye left_ear right_ear"
LARGER = {  # names that no shipped map has -> the canonical joints that are not among them
    "OpenCap": (
        f"Neck midHip {ARMS} {LEGS} {{0}}BigToe {{0}}SmallToe {{0}}Heel",
        ("L", "R"),
        {"torso", "head", "head_top", *limbs("hand")},
    ),
    "MPII": (
        "pelvis thorax upper_neck head_top {0}_ankle {0}_knee {0}_hip {0}_wrist {0}_elbow"
        " {0}_shoulder",
        ("l", "r"),
        {"torso", "head", *limbs("hand", "foot")},
    ),
    "Apple Vision": (
        f"topHead centerHead centerShoulder spine root {ARMS} {LEGS}",
        ("left", "right"),
        limbs("hand", "foot"),
    ),
    "HALPE-26": (
        f"Nose Head Neck Hip {{0}}Eye {{0}}Ear {ARMS} {LEGS} {{0}}BigToe {{0}}SmallToe {{0}}Heel",
        ("L", "R"),
        {"torso", "head_top", *limbs("hand")},
    ),
    "Nuitrack": (
        "head neck torso waist {0}_collar {0}_shoulder {0}_elbow {0}_wrist {0}_hand {0}_fingertip"
        " {0}_hip {0}_knee {0}_ankle",
        ("left", "right"),
        {"head_top", *limbs("foot")},
    ),
    "MediaPipe down to the hips": (
        f"{FACE} {{0}}_shoulder {{0}}_elbow {{0}}_wrist {{0}}_index {{0}}_thumb {{0}}_hip",
        ("left", "right"),
        {"torso", "head_top", *limbs("knee", "ankle", "foot")},
    ),
    "COCO down to the wrists": (
        f"{FACE} {{0}}_shoulder {{0}}_elbow {{0}}_wrist",
        ("left", "right"),
        {"waist", "torso", "head_top", *limbs("hand", "hip", "knee", "ankle", "foot")},
    ),
}


def both_sides(text, sides):
    """All names of a text in which {0} is a side."""
    return list(dict.fromkeys(name.format(side) for name in text.split() for side in sides))


@pytest.mark.parametrize("body", LARGER)
def test_a_small_map_within_a_file_hides_no_joint_that_another_reading_understands(body):
    text, sides, missing = LARGER[body]
    names = both_sides(text, sides)
    found = map_of_names(names)
    assert {j for j, own in sources(found).items() if not own} == missing
    single = found.weights[found.weights.max(axis=1) == 1.0]
    assert (single.sum(axis=0) <= 1).all()  # no joint of the file is two
    if "head" not in missing and not {"Head", "head", "centerHead"} & set(names):
        assert {name.lower()[-3:] for name in sources(found)["head"]} == {"ear"}


def test_a_crown_called_head_is_not_taken_where_ears_are():
    text, sides, _ = LARGER["HALPE-26"]
    assert sources(map_of_names(both_sides(text, sides)))["head"] == {"LEar", "REar"}


@pytest.mark.parametrize("name", SHIPPED)
def test_further_joints_take_none_from_a_shipped_map(name):
    """Not even if they are joints of a body, or the file spells all in its own way."""
    shipped = load_joint_map(name)
    expected = sources(shipped)
    more = ["Prop", "HeadTop", "LeftFingertip", "RightBigToe"]
    for names in ([*shipped.source_joints, "Prop"], [*shipped.source_joints, *more]):
        found = sources(map_of_names(names))
        assert {joint: own for joint, own in found.items() if expected[joint]} == {
            joint: own for joint, own in expected.items() if own
        }
    other = [spelled(joint, "_", True) for joint in shipped.source_joints]
    if len(set(other)) == len(other):
        assert map_of_names([*other, "Prop"]).mapped[map_of_names(other).mapped].all()


def test_a_reading_is_completed_by_another():
    """SMPL-X: the spine only as SMPL numbers it, the finger tips only as rigs name them."""
    names = [*load_joint_map("smpl22").source_joints, "LeftHandMiddle4", "RightHandMiddle4"]
    found = sources(map_of_names(names))
    assert found["torso"] == {"spine2"}
    assert found["l_hand"] == {"LeftHandMiddle4"}


def test_a_collar_bone_called_shoulder_is_none_where_a_whole_rig_says_so():
    names = both_sides("Head Shoulder{0} Arm{0} Elbow{0} Wrist{0} Leg{0} Knee{0} Ankle{0}", "LR")
    assert sources(map_of_names(names))["l_shoulder"] == {"ShoulderL"}  # Leg is no hip: arms only
    whole = map_of_names([*names, "UpperLegL", "UpperLegR"])
    assert sources(whole)["l_shoulder"] == {"ArmL"}


@pytest.fixture
def table(tmp_path):
    """A CSV of two joints with names that nobody knows, in two frames."""
    path = tmp_path / "own.csv"
    path.write_text(
        "time_s,P1_x,P1_y,P1_z,P2_x,P2_y,P2_z\n0,0,0,1,0,0,2\n0.02,0,0,1,0,0,2\n", encoding="utf-8"
    )
    return path


def own_map(tmp_path, text):
    path = tmp_path / "own.yaml"
    path.write_text(
        "name: own\nreference: a test\nunits: m\naxes: [x, y, z]\n" + text, encoding="utf-8"
    )
    return load_joint_map(str(path))


def test_a_map_of_the_users_own_names_what_no_rule_knows(table, tmp_path):
    with pytest.raises(RecordingError, match="--joint-map FILE"):
        open_recording(table)
    own = own_map(tmp_path, "joints: [P2, P1, P9]\nmap: {l_wrist: P1, head: P2}\n")
    recording = open_recording(table, joint_map=own)
    found = sources(recording.joint_map)
    assert (found["l_wrist"], found["head"]) == ({"P1"}, {"P2"})
    person = recording.scenes[0].people[0]
    joints, seen = recording.joint_map.map(person.positions, person.observed)
    assert joints[JOINTS.index("head")].tolist() == [0, 0, 2]
    assert {JOINTS[k] for k in np.flatnonzero(seen)} == {"l_wrist", "head"}
    assert recording.note == ""


def test_units_and_axes_stay_the_files_and_the_note_says_so(table, tmp_path):
    own = own_map(tmp_path, "joints: [P1]\nmap: {l_wrist: P1}\n").with_units(0.01)
    recording = open_recording(table, joint_map=own)
    assert recording.joint_map.scale_to_m == 1.0
    assert "units and axes are the file's own" in recording.note


def test_a_map_that_uses_a_joint_which_is_not_there_is_one_clear_line(table, tmp_path):
    own = own_map(tmp_path, "joints: [P11]\nmap: {l_wrist: P11}\n")
    says = "joint map own: uses 'P11', which is not among the recording's joints; did you mean 'P1"
    with pytest.raises(RecordingError, match=re.escape(says)) as error:
        open_recording(table, joint_map=own)
    assert "\n" not in str(error.value)
    whole = open_recording(table, any_joints=True)
    with pytest.raises(ConfigError, match="P11"):
        with_map(whole, own)
