"""Joint maps: shipped ones, axes and units, masks, user mistakes."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import METRES_PER_UNIT, load_joint_map, map_names
from tests.shared import DATA, needs_data

SHIPPED = [name for name in map_names() if name != "bvh"]
# (source, joint, its index in the documents of the source)
INDICES = [
    ("azure_kinect32", "HANDTIP_RIGHT", 16),
    ("azure_kinect32", "EAR_RIGHT", 31),
    ("body25", "MidHip", 8),
    ("body25", "LBigToe", 19),
    ("body25", "RHeel", 24),
    ("cmu38", "Head_End", 19),
    ("cmu38", "RightHandIndex1_End", 35),
    ("cmu38_asf", "rfingers_End", 35),
    ("coco17", "left_shoulder", 5),
    ("coco17", "right_ankle", 16),
    ("daz23", "lShldr", 10),
    ("daz23", "rFoot_End", 17),
    ("kinect25", "SpineShoulder", 20),
    ("marker_clusters9", "left_hand", 5),
    ("mediapipe33", "left_shoulder", 11),
    ("mediapipe33", "left_index", 19),
    ("mediapipe33", "right_foot_index", 32),
    ("ros4hri", "r_ankle", 13),
    ("motive21", "LUArm", 6),
    ("rokoko23", "rightToeEnd", 22),
    ("smpl22", "left_shoulder", 16),
    ("smpl22", "right_foot", 11),
    ("xsens23", "T12", 3),
    ("xsens23", "LeftUpperArm", 12),
    ("xsens23", "LeftToe", 22),
    ("zed18", "LEFT_ANKLE", 13),
    ("zed34", "LEFT_HIP", 18),
    ("zed34", "HEAD", 26),
    ("zed34", "RIGHT_HEEL", 33),
    ("zed38", "LEFT_BIG_TOE", 24),
    ("zed38", "RIGHT_HAND_MIDDLE_4", 35),
]
CAMERA_LIKE = ("azure_kinect32", "body25", "coco17", "mediapipe33", "zed18", "zed34", "zed38")


@pytest.mark.parametrize("name", SHIPPED)
def test_a_number_at_the_end_of_a_maps_name_is_that_of_its_joints(name):
    count = re.search(r"\d+$", name)
    assert count is None or len(load_joint_map(name).source_joints) == int(count[0])


@pytest.mark.parametrize(("name", "joint", "index"), INDICES)
def test_source_order(name, joint, index):
    assert load_joint_map(name).source_joints[index] == joint


def test_a_shoulder_moves_with_the_markers_on_the_chest():
    joint_map = load_joint_map("marker_clusters9")
    at = {"hip": [0.0, 0, 1.0], "collar": [0.0, 0, 1.35], "left_shoulder": [0, 0.12, 1.35],
          "right_shoulder": [0, -0.12, 1.35]}  # fmt: skip
    positions = np.array([at.get(name, [9.0, 9, 9]) for name in joint_map.source_joints])
    observed = np.ones(9, dtype=np.bool_)
    joints, seen = joint_map.map(positions, observed)
    left, right = (JOINTS.index(f"{s}_shoulder") for s in "lr")
    np.testing.assert_allclose(joints[left], [-0.11, 0.19, 1.44], atol=1e-12)
    np.testing.assert_allclose(joints[right], [-0.11, -0.19, 1.44], atol=1e-12)
    assert seen[[left, right]].all()
    observed[joint_map.source_joints.index("hip")] = False
    assert not joint_map.map(positions, observed)[1][[left, right]].any()
    assert list(joint_map.used) == [True] * 9


@pytest.mark.parametrize(
    ("rigid", "wrong"),
    [
        ({"shoulder": {}}, "rigid: no canonical joint 'shoulder'"),
        ({"l_hip": {"at": "c"}}, "rigid.l_hip: the source has no joint 'c'"),
        ({"l_wrist": {}}, "rigid.l_wrist: also occurs in map"),
        ({"l_hip": {"up": ["a", "b"]}}, "left and up must name three or four different"),
        ({"l_hip": {"offset_m": [0, 0, 3]}}, "offset_m"),
        ({"l_hip": {"at": 4}}, "rigid.l_hip.at"),
    ],
)
def test_a_wrong_rigid_joint_is_named(tmp_path, rigid, wrong):
    whole = {"at": "a", "left": ["a", "b"], "up": ["d", "a"], "offset_m": [0, 0, 0]}
    text = {"name": "x", "reference": "x", "units": "m", "axes": ["x", "y", "z"],
            "joints": ["a", "b", "d", "w"], "map": {"l_wrist": "w"},
            "rigid": {k: whole | v for k, v in rigid.items()}}  # fmt: skip
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(text))
    with pytest.raises(ConfigError, match=wrong.replace(".", r"\.")) as caught:
        load_joint_map(str(path))
    assert "\n" not in str(caught.value)


def side(source_joint: str) -> str:
    name = source_joint.lower()
    return "l" if "left" in name else "r" if "right" in name else name[0]


@pytest.mark.parametrize("name", SHIPPED)
def test_left_is_mapped_to_left(name):
    joint_map = load_joint_map(name)
    for joint, row in zip(JOINTS, joint_map.weights, strict=True):
        sides = [side(joint_map.source_joints[i]) for i in np.flatnonzero(row)]
        if joint[:2] in ("l_", "r_"):
            assert all(s == joint[0] for s in sides), joint
        elif len(sides) > 1:
            assert sorted(sides) == ["l", "r"], joint


@pytest.mark.parametrize("name", SHIPPED)
def test_mirrored_joints_come_from_different_sources(name):
    weights = load_joint_map(name).weights
    for left, right in CANONICAL.left_right_pairs:
        assert weights[left].any() == weights[right].any()
        if weights[left].any():
            assert not np.array_equal(weights[left], weights[right])


@pytest.mark.parametrize("name", CAMERA_LIKE)
def test_camera_axes_become_forward_left_up(name):
    joint_map = load_joint_map(name)
    # image right, image down, away from the camera
    points = joint_map.to_metres_z_up(np.eye(3))
    scale = joint_map.scale_to_m
    np.testing.assert_allclose(points, scale * np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]]))


def test_rest_pose_of_the_data_pack_becomes_x_forward_y_left_z_up():
    points = load_joint_map("cmu38").to_metres_z_up(np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(points, [[3.0, 1.0, 2.0]])  # README: (z, x, y)


def test_units_have_the_lengths_of_the_si_and_of_the_agreement_of_1959():
    assert METRES_PER_UNIT["m"] == 1.0
    assert 100 * METRES_PER_UNIT["cm"] == 1000 * METRES_PER_UNIT["mm"] == 1.0
    assert METRES_PER_UNIT["ft"] / 12 == pytest.approx(METRES_PER_UNIT["inch"], rel=1e-15)
    assert 36 * METRES_PER_UNIT["inch"] == pytest.approx(0.9144, rel=1e-15)  # a yard
    assert set(METRES_PER_UNIT) == {"m", "cm", "mm", "inch", "ft"}


def test_units_scale():
    assert load_joint_map("azure_kinect32").scale_to_m == 0.001
    points = load_joint_map("canonical").with_units(0.0254).to_metres_z_up(np.array([1.0, 2, -3]))
    np.testing.assert_allclose(points, [0.0254, 0.0508, -0.0762])
    with pytest.raises(ConfigError, match="positive"):
        load_joint_map("canonical").with_units(0.0)
    with pytest.raises(ConfigError, match="positive"):
        load_joint_map("canonical").with_units(float("nan"))


def test_declared_left_handed_axes_are_flipped():
    unity = load_joint_map("zed38").with_axes(["z", "-x", "y"], left_handed=True)
    forward, left, up = unity.with_units(1.0).to_metres_z_up(
        np.array([[0, 0, 1.0], [-1.0, 0, 0], [0, 1.0, 0]])  # Unity: z forward, x right, y up
    )
    np.testing.assert_allclose([forward, left, up], np.eye(3))


@pytest.mark.parametrize(
    ("axes", "left_handed", "message"),
    [
        (["z", "-x", "y"], False, "left-handed; change a sign, or set left_handed: true"),
        (["z", "x", "y"], True, "right-handed; change a sign, or set left_handed: false"),
        (["x", "x", "y"], False, "three different axes"),
        (["x", "-x", "y"], False, "three different axes"),
        (["x", "w", "y"], False, "'w' is not an axis"),
        (["x", "y"], False, "three different axes"),
        (["x", "y", "z", "x"], False, "three different axes"),
    ],
)
def test_bad_axes_are_refused(axes, left_handed, message):
    with pytest.raises(ConfigError, match=message):
        load_joint_map("canonical").with_axes(axes, left_handed=left_handed)


@pytest.mark.parametrize("name", SHIPPED)
def test_axes_keep_distances_and_handedness(name):
    rotation = load_joint_map(name).rotation
    text = (data_path("skeletons", f"{name}.yaml")).read_text(encoding="utf-8")
    left_handed = yaml.safe_load(text).get("left_handed", False)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(-1 if left_handed else 1)


def test_midpoints_need_all_their_sources():
    joint_map = load_joint_map("coco17")
    positions = np.zeros((17, 3))
    positions[joint_map.source_joints.index("left_hip")] = [1.0, 0, 0]
    positions[joint_map.source_joints.index("right_hip")] = [0, 1.0, 0]
    observed = np.ones(17, bool)
    mapped, seen = joint_map.map(positions, observed)
    np.testing.assert_allclose(mapped[CANONICAL.index("waist")], [0.5, 0.5, 0])
    assert seen[CANONICAL.index("waist")]
    observed[joint_map.source_joints.index("right_hip")] = False
    mapped, seen = joint_map.map(positions, observed)
    assert not seen[CANONICAL.index("waist")]
    assert seen[CANONICAL.index("l_hip")]
    np.testing.assert_array_equal(mapped[CANONICAL.index("waist")], 0)


def test_what_a_source_lacks_is_never_observed():
    joint_map = load_joint_map("coco17")
    _, seen = joint_map.map(np.ones((17, 3)), np.ones(17, bool))
    unobserved = {joint for joint, ok in zip(JOINTS, seen, strict=True) if not ok}
    assert unobserved == {"torso", "head_top", "l_hand", "r_hand", "l_foot", "r_foot"}
    np.testing.assert_array_equal(seen, joint_map.mapped)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_coordinates_that_are_not_finite_are_unobserved(bad):
    positions = np.ones((17, 3))
    positions[9, 1] = bad  # left wrist
    mapped, seen = load_joint_map("coco17").map(positions, np.ones(17, bool))
    assert not seen[CANONICAL.index("l_wrist")]
    assert seen[CANONICAL.index("r_wrist")]
    assert np.isfinite(mapped).all()


@given(
    name=st.sampled_from(SHIPPED),
    seed=st.integers(0, 2**32 - 1),
    lead=st.lists(st.integers(1, 3), max_size=2),
)
def test_map_equals_a_plain_loop(name, seed, lead):
    joint_map = load_joint_map(name)
    rng = np.random.default_rng(seed)
    shape = (*lead, len(joint_map.source_joints))
    positions = rng.normal(0, 2, (*shape, 3))
    positions[rng.random(shape) < 0.1] = np.nan
    observed = rng.random(shape) < 0.8
    mapped, seen = joint_map.map(positions, observed)
    assert mapped.shape == (*lead, 21, 3)
    for index in np.ndindex(*lead):
        for j in (j for j in range(21) if JOINTS[j] not in joint_map.rigid):
            sources = np.flatnonzero(joint_map.weights[j])
            ok = len(sources) > 0 and all(
                observed[(*index, s)] and np.isfinite(positions[(*index, s)]).all() for s in sources
            )
            assert seen[(*index, j)] == ok
            expected = (
                sum(joint_map.weights[j, s] * positions[(*index, s)] for s in sources)
                if ok
                else np.zeros(3)
            )
            np.testing.assert_allclose(mapped[(*index, j)], expected, atol=1e-12)


GOOD = {
    "name": "arms",
    "reference": "a test",
    "units": "mm",
    "axes": ["z", "-x", "-y"],
    "joints": ["LShoulder", "RShoulder", "LElbow"],
    "map": {
        "l_shoulder": "LShoulder",
        "r_shoulder": "RShoulder",
        "neck": {"LShoulder": 0.5, "RShoulder": 0.5},
    },
}


def write(path: Path, **changes: object) -> str:
    path.write_text(yaml.safe_dump({**GOOD, **changes}))
    return str(path)


def test_a_users_own_map(tmp_path):
    joint_map = load_joint_map(write(tmp_path / "arms.yaml"))
    assert joint_map.scale_to_m == 0.001
    assert joint_map.mapped.sum() == 3
    assert load_joint_map(write(tmp_path / "arms.yml", units=0.5)).scale_to_m == 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"units": "furlong"}, r"units: use one of m, cm, mm, inch, ft.*'furlong'"),
        ({"units": -1}, "units: input should be greater than or equal"),
        ({"axes": ["z", "x", "-y"]}, "left-handed"),
        ({"axes": ["z", "z", "-y"]}, "three different axes"),
        ({"axes": ["z", "x"]}, "axes"),
        ({"joints": ["LShoulder", "LShoulder", "RShoulder"]}, "'LShoulder' is listed twice"),
        ({"joints": []}, "joints"),
        ({"map": {}}, "map is empty"),
        ({"map": {"l_sholder": "LShoulder"}}, "no canonical joint 'l_sholder'; did you mean"),
        ({"map": {"l_shoulder": "LSholder"}}, "no joint 'LSholder'; did you mean 'LShoulder'"),
        ({"map": {"neck": {"LShoulder": 0.5}}}, "sum to 1"),
        (
            {"map": {"l_wrist": "LElbow", "l_hand": "LElbow"}},
            "map.l_wrist: 'LElbow' is l_hand already.*omit joints",
        ),
        ({"map": {"l_foot": "LElbow", "neck": {"LElbow": 1.0}}}, "'LElbow' is l_foot already"),
        (
            {"map": {joint: {"LShoulder": 0.5, "RShoulder": 0.5} for joint in ("waist", "neck")}},
            "map.waist: 'LShoulder' and 'RShoulder' with these weights are neck already.*omit",
        ),
        ({"map": {"neck": {"LShoulder": 1.5, "RShoulder": -0.5}}}, "positive"),
        ({"map": {"torso": {"LShoulder": 0.5, "RShoulder": 0.5}}}, "only waist, neck, head may be"),
        ({"map": {"torso": 3}}, "map: torso: give the name of a source joint, in quotes"),
        ({"map": None}, "map: give canonical joints and their sources, such as l_wrist: "),
        ({"joints": ["LShoulder", 2]}, "joints: write every name as text: '2', in quotes"),
        ({"axis": ["x", "y", "z"]}, "unknown key; did you mean 'axes'"),
    ],
)
def test_mistakes_give_one_line_naming_file_and_key(tmp_path, changes, message):
    path = write(tmp_path / "bad.yaml", **changes)
    with pytest.raises(ConfigError, match=message) as caught:
        load_joint_map(path)
    assert "bad.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_map_names_the_nearest_and_a_missing_file_says_so(tmp_path):
    with pytest.raises(ConfigError, match="no joint map 'coco71'; did you mean 'coco17'"):
        load_joint_map("coco71")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_joint_map(str(tmp_path / "absent.yaml"))
    with pytest.raises(ConfigError, match="file's own joint names"):
        load_joint_map("bvh")


@needs_data
def test_cmu_joint_order_is_that_of_the_data_pack():
    skeleton = json.loads((DATA / "cmu_mocap" / "skeleton.json").read_text())
    assert load_joint_map("cmu38").source_joints == tuple(skeleton["joints"])


@needs_data
@pytest.mark.parametrize("action", ["walking_1", "soccer_1", "washwindow_1"])
def test_a_real_person_stands_upright_and_within_reach(action):
    joint_map = load_joint_map("cmu38")
    with np.load(DATA / "cmu_mocap" / "test" / f"{action}.npz") as file:
        raw = file["positions_world"][file["world_ok"]]
    points = joint_map.to_metres_z_up(raw)
    joints, seen = joint_map.map(points, np.ones(points.shape[:2], bool))
    assert seen.all(axis=0).tolist() == joint_map.mapped.tolist()
    z = {name: float(np.median(joints[:, CANONICAL.index(name), 2])) for name in JOINTS}
    assert z["l_foot"] < z["l_ankle"] + 0.1 < z["l_knee"] < z["waist"] < z["torso"] < z["head"]
    both = seen[:, :, None] & seen[:, None, :]
    for frame in range(0, len(joints), 10):
        distance = np.linalg.norm(joints[frame, :, None] - joints[frame, None], axis=-1)
        assert np.all((distance <= CANONICAL.reach)[both[frame]])


@needs_data
def test_a_walker_faces_forward_with_left_on_the_left():
    joint_map = load_joint_map("cmu38")
    with np.load(DATA / "cmu_mocap" / "test" / "walking_1.npz") as file:
        points = joint_map.to_metres_z_up(file["positions_world"][1:])
    joints, _ = joint_map.map(points, np.ones(points.shape[:2], bool))
    waist = joints[:, CANONICAL.index("waist")]
    to_left = (joints[:, CANONICAL.index("l_hip")] - waist).mean(axis=0)
    travel = waist[-1] - waist[0]
    assert np.cross(travel, to_left)[2] > 0  # left of the way, seen from above
    assert np.linalg.norm(travel[:2]) > 5 * abs(travel[2])


@needs_data
def test_assembly_order_and_axes_are_those_of_the_data_pack():
    joint_map = load_joint_map("assembly_arms")
    with np.load(DATA / "assembly" / "task1_human1_trial1.npz") as file:
        assert joint_map.source_joints == tuple(str(n) for n in file["joint_names"])
        points = joint_map.to_metres_z_up(file["positions"])
    joints, _ = joint_map.map(points, np.ones(points.shape[:2], bool))
    left, right, wrist = (
        np.nanmedian(joints[:, CANONICAL.index(j)], axis=0)
        for j in ("l_shoulder", "r_shoulder", "l_wrist")
    )
    assert left[1] < right[1]  # the person faces the camera: its left is the camera's right
    assert wrist[2] < left[2]  # hands on the table, below the shoulders
    assert 0.4 < left[0] < 1.2  # in front of the camera
