"""BVH files: our kinematics against bvhio's own, which works on another structure."""

import json
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.recording import open_recording
from hri_predict.recording.formats.bvh import forward_kinematics
from hri_predict.recording.formats.bvh_text import parse_bvh
from tests.shared import DATA, needs_data

# A small rig (cm, y up), with the usual names: hips, spine, head, arms and legs.
RIG = [
    ("Hips", None, (0, 0, 0)),
    ("Spine", "Hips", (0, 12, 0)),
    ("Neck", "Spine", (0, 38, 0)),
    ("Head", "Neck", (0, 10, 2)),
    ("LeftArm", "Spine", (18, 33, 0)),
    ("LeftForeArm", "LeftArm", (28, 0, 0)),
    ("LeftHand", "LeftForeArm", (25, 0, 0)),
    ("RightArm", "Spine", (-18, 33, 0)),
    ("RightForeArm", "RightArm", (-28, 0, 0)),
    ("RightHand", "RightForeArm", (-25, 0, 0)),
    ("LeftUpLeg", "Hips", (9, -5, 0)),
    ("LeftLeg", "LeftUpLeg", (0, -42, 0)),
    ("LeftFoot", "LeftLeg", (0, -40, 0)),
    ("RightUpLeg", "Hips", (-9, -5, 0)),
    ("RightLeg", "RightUpLeg", (0, -42, 0)),
    ("RightFoot", "RightLeg", (0, -40, 0)),
]
ORDER = "Zrotation Xrotation Yrotation"


def write_bvh(path, rig, values, frame_time=1 / 60, order=ORDER, end=(0, 5, 0)):
    """Write a rig [(name, parent, offset)] and values (F, 3 + 3 J), root position first."""
    children: dict = {}
    for name, parent, offset in rig:
        children.setdefault(parent, []).append((name, offset))

    def joint(name, offset, depth):
        pad = "  " * depth
        root = depth == 0
        out = [f"{pad}{'ROOT' if root else 'JOINT'} {name}", f"{pad}{{"]
        out.append(f"{pad}  OFFSET {' '.join(repr(float(v)) for v in offset)}")
        position = "Xposition Yposition Zposition "
        out.append(f"{pad}  CHANNELS {6 if root else 3} {position if root else ''}{order}")
        for child, child_offset in children.get(name, []):
            out += joint(child, child_offset, depth + 1)
        if name not in children:
            ends = " ".join(str(float(v)) for v in end)
            out += [f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {ends}", f"{pad}  }}"]
        return [*out, f"{pad}}}"]

    (root,) = children[None]
    lines = ["HIERARCHY", *joint(root[0], root[1], 0), "MOTION"]
    lines += [f"Frames: {len(values)}", f"Frame Time: {frame_time}"]
    lines += [" ".join(repr(float(v)) for v in row) for row in values]
    path.write_text("\n".join(lines) + "\n")
    return path


def _values(frames, seed=0):
    rng = np.random.default_rng(seed)
    values = rng.uniform(-80, 80, (frames, 3 + 3 * len(RIG)))
    values[:, :3] = rng.uniform(-200, 200, (frames, 3))
    return values


def test_world_positions_are_those_of_bvhio(tmp_path: Path) -> None:
    bvhio = pytest.importorskip("bvhio", reason="compares with bvhio, which is not installed")
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(4))
    bvh = parse_bvh(path.read_text())
    names, ours = [node.name for node in bvh.nodes], forward_kinematics(bvh)
    hierarchy = bvhio.readAsHierarchy(str(path))
    for frame in range(4):
        hierarchy.loadPose(frame)
        for joint, _, _ in hierarchy.layout():
            expected = np.array(joint.PositionWorld.to_list())
            np.testing.assert_allclose(
                ours[frame, names.index(joint.Name)], expected, atol=2e-3, err_msg=joint.Name
            )


def test_units_axes_and_rate(tmp_path: Path) -> None:
    still = np.zeros((3, 3 + 3 * len(RIG)))
    still[:, 1] = 95.0  # hips 95 cm up
    still[:, 2] = [0.0, 10.0, 20.0]  # walking along z
    path = write_bvh(tmp_path / "a.bvh", RIG, still, frame_time=1 / 50)
    recording = open_recording(path)
    assert recording.rate_hz == pytest.approx(50.0)
    person = recording.scenes[2].people[0]
    joints, seen = recording.joint_map.map(person.positions, person.observed)
    at = {name: joints[JOINTS.index(name)] for name in JOINTS if seen[JOINTS.index(name)]}
    np.testing.assert_allclose(at["l_knee"], [0.2, 0.09, 0.48], atol=1e-6)
    np.testing.assert_allclose(at["r_wrist"], [0.2, -0.71, 1.40], atol=1e-6)
    metres = open_recording(path, unit_m=1.0).scenes[0].people[0].positions
    np.testing.assert_allclose(metres, recording.scenes[0].people[0].positions * 100, atol=1e-4)
    z_up = open_recording(path, axes=["x", "y", "z"]).scenes[0].people[0].positions
    np.testing.assert_allclose(z_up[0], [0.0, 0.95, 0.0], atol=1e-6)


@needs_data
def test_a_real_walk_written_as_bvh_reads_as_the_same_joints(tmp_path: Path) -> None:
    """The data pack's exponential maps as Euler angles: an independent way to the same joints."""
    skeleton = json.loads((DATA / "cmu_mocap" / "skeleton.json").read_text())
    archive = np.load(DATA / "cmu_mocap" / "test" / "walking_1.npz")
    expmap = archive["expmap"][1:121].astype(float)
    unit = skeleton["metres_per_asf_unit"]
    names, parents = skeleton["joints"], skeleton["parents"]
    rig = [
        (name, names[parent] if parent >= 0 else None, np.array(offset) * unit * 100)
        for name, parent, offset in zip(names, parents, skeleton["offsets_asf_units"], strict=True)
    ]
    turns = _matrices(-expmap[:, 3:].reshape(len(expmap), len(names), 3))
    depth_first: list[int] = []

    def visit(j):
        depth_first.append(j)
        for child in [k for k, p in enumerate(parents) if p == j]:
            visit(child)

    visit(0)
    values = np.concatenate(
        [expmap[:, :3] * unit * 100, *(_zxy_degrees(turns[:, j]) for j in depth_first)], axis=1
    )
    path = write_bvh(tmp_path / "walk.bvh", rig, values, frame_time=1 / 120)
    recording = open_recording(path)
    expected = open_recording(DATA / "cmu_mocap" / "test" / "walking_1.npz")
    floor = float(archive["floor_height"])
    compared = 0
    for k in (0, 60, 119):
        theirs, ours = expected.scenes[k].people[0], recording.scenes[k].people[0]
        for j, name in enumerate(names):
            if name in recording.joint_map.source_joints:
                i = recording.joint_map.source_joints.index(name)
                shifted = theirs.positions[j] + [0, 0, floor]
                np.testing.assert_allclose(ours.positions[i], shifted, atol=2e-5, err_msg=name)
                compared += 1
    assert compared == 3 * 38
    person = recording.scenes[0].people[0]
    _, seen = recording.joint_map.map(person.positions, person.observed)
    assert {"waist", "l_wrist", "r_ankle", "head"} <= {JOINTS[i] for i in np.flatnonzero(seen)}


def _matrices(rotation_vectors):
    angle = np.linalg.norm(rotation_vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(rotation_vectors, -1, 0)
    zero = np.zeros_like(x)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    k = k.reshape(*x.shape, 3, 3)
    safe = np.where(angle == 0, 1.0, angle)
    return np.eye(3) + np.sin(angle) / safe * k + (1 - np.cos(angle)) / safe**2 * (k @ k)


def _zxy_degrees(m):
    """Angles z, x, y (degrees) with Rz Rx Ry = m."""
    x = np.arcsin(np.clip(m[:, 2, 1], -1, 1))
    z = np.arctan2(-m[:, 0, 1], m[:, 1, 1])
    y = np.arctan2(-m[:, 2, 0], m[:, 2, 2])
    return np.degrees(np.stack([z, x, y], axis=1))


def _error(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    return str(caught.value)


def test_cut_anywhere_it_is_an_error_or_a_note(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(3))
    text = path.read_text()
    whole = len(text.rstrip().rsplit(" ", 1)[0])  # before the last value
    for keep in np.linspace(1, whole, 60).astype(int):
        path.write_text(text[:keep])
        if text[keep - 1] == "\n" or text[keep] == "\n":  # whole frames are left
            assert "'Frames:' is 3" in open_recording(path).note
        else:
            _error(path)


def test_what_is_wrong_in_a_bvh_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    assert "no frames" in _error(write_bvh(path, RIG, _values(0)))
    assert "Frame Time" in _error(write_bvh(path, RIG, _values(2), frame_time=0.0))
    strange = [(f"b{n}", None if p is None else f"b{p}", o) for n, p, o in RIG]
    assert "Hips" in _error(write_bvh(path, strange, _values(2)))
    path.write_bytes(b"\x01\x00\x02\x00\x00HIERARCHY")
    assert "not text" in _error(path)
    path.write_text("solid cube")
    assert "HIERARCHY" in _error(path)
    good = write_bvh(path, RIG, _values(2)).read_text()
    head, motion = good.split("MOTION")
    for wrong, named in (
        (good.replace("OFFSET 0.0 12.0 0.0", "OFFSET 0.0 twelve 0.0"), "OFFSET of 'Spine'"),
        (good.replace("OFFSET 0.0 12.0 0.0", "OFFSET 0.0 12.0"), "has 2 numbers"),
        (good.replace("CHANNELS 6", "CHANNELS 7"), "CHANNELS of 'Hips'"),
        (good.replace("JOINT Spine", "JOINT"), "JOINT has no name"),
        (good.replace("Frames: 2", "Frames: two"), "'Frames:' is 'two'"),
        (good.replace("Zrotation", "Wrotation", 1), "joint 'Hips' has an unknown channel"),
        (good.replace("Zrotation", "Xrotation", 1), "a channel of 'Hips' is there twice"),
        (f"MOTION{motion}{head}", "must begin with HIERARCHY"),
        (good.replace("JOINT Spine", "JOINT Spine\nJOINT Other"), "JOINT is out of place"),
        (good.replace("OFFSET 0.0 12.0 0.0", ""), "'Spine' has no OFFSET"),
        (good.replace("OFFSET 0.0 12.0 0.0", "OFFSET 0 1 0\nOFFSET 0 2 0"), "second OFFSET"),
        (good.replace("CHANNELS 6", "CHANNELS 1 Zrotation\nCHANNELS 6"), "second CHANNELS"),
        (f"{good.rstrip().rsplit(' ', 1)[0]} 1_0\n", "'1_0' is not a number"),
    ):
        path.write_text(wrong)
        assert named in _error(path)


def _joints(path: Path) -> np.ndarray:
    """(F, J, 3) of the first person."""
    return np.stack([scene.people[0].positions for scene in open_recording(path).scenes])


@pytest.mark.parametrize("case", [str.upper, str.lower, str.title])
def test_channels_are_known_in_any_case(tmp_path: Path, case) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(3))
    expected = _joints(path)
    text = path.read_text()
    for axis in "XYZ":
        for kind in ("rotation", "position"):
            text = text.replace(f"{axis}{kind}", case(f"{axis}{kind}"))
    path.write_text(text)
    np.testing.assert_array_equal(_joints(path), expected)


@pytest.mark.parametrize("surplus", [-1, 1, 3, 15])
def test_rows_have_as_many_values_as_the_hierarchy_has_channels(tmp_path: Path, surplus) -> None:
    values = _values(3)
    count = values.shape[1]
    rows = np.zeros((3, count + surplus))
    rows[:, : min(count, count + surplus)] = values[:, : count + min(0, surplus)]
    error = _error(write_bvh(tmp_path / "a.bvh", RIG, rows))
    assert f"frame 1 has {count + surplus} values for {count} channels" in error


@pytest.mark.parametrize("promised", [0, 1, 2, 4, 100])
def test_all_rows_are_read_whatever_the_header_counts(tmp_path: Path, promised) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(3))
    path.write_text(path.read_text().replace("Frames: 3", f"Frames: {promised}"))
    recording = open_recording(path)
    assert len(recording.scenes) == 3
    assert f"'Frames:' is {promised}, but there are 3 frames" in recording.note


def _with_scale(path: Path, scale: float) -> None:
    """Give the Spine channels of scale, and each row their values."""
    lines = path.read_text().splitlines()
    at = lines.index("  JOINT Spine") + 3
    lines[at] = f"    CHANNELS 6 {ORDER} Xscale Yscale Zscale"
    first = lines.index("MOTION") + 3
    for k in range(first, len(lines)):
        cells = lines[k].split()
        lines[k] = " ".join([*cells[:9], *[str(scale)] * 3, *cells[9:]])
    path.write_text("\n".join(lines))


def test_a_scale_of_1_is_skipped_and_noted_and_any_other_refused(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(3))
    expected = _joints(path)
    _with_scale(path, 1.0)
    np.testing.assert_array_equal(_joints(path), expected)
    assert "'Spine'" in open_recording(path).note
    _with_scale(write_bvh(path, RIG, _values(3)), 1.1)
    assert "joint 'Spine' is scaled by channel 'Xscale'" in _error(path)


def test_a_position_channel_replaces_the_offset_along_its_axis_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    path.write_text(
        "HIERARCHY\nROOT A\n{\nOFFSET 1 2 3\nCHANNELS 1 Yposition\nJOINT B {\n"
        "OFFSET 0 10 0\nCHANNELS 1 Zrotation\nEnd Site\n{\nOFFSET 0 5 0\n}\n}\n}\n"
        "MOTION\nFrames: 1\nFrame Time: 0.1\n20 90\n"
    )
    bvh = parse_bvh(path.read_text())
    assert [node.name for node in bvh.nodes] == ["A", "B", "B_End"]
    np.testing.assert_allclose(
        forward_kinematics(bvh)[0], [[1, 20, 3], [1, 30, 3], [-4, 30, 3]], atol=1e-9
    )  # 64-bit floats: 1e-15 of 30, times a few operations


def test_names_keep_their_spaces_and_are_understood(tmp_path: Path) -> None:
    sides = {"Left": "L ", "Right": "R "}
    stems = {"ForeArm": "Forearm", "Arm": "UpperArm", "Hand": "Hand", "UpLeg": "Thigh",
             "Leg": "Calf", "Foot": "Foot"}  # fmt: skip

    def biped(name: str) -> str:
        for side, short in sides.items():
            if name.startswith(side):
                return f"Bip01 {short}{stems[name.removeprefix(side)]}"
        return "Bip01" if name == "Hips" else f"Bip01 {name}"

    rig = [(biped(n), None if p is None else biped(p), o) for n, p, o in RIG]
    expected = open_recording(write_bvh(tmp_path / "a.bvh", RIG, _values(2)))
    recording = open_recording(write_bvh(tmp_path / "b.bvh", rig, _values(2)))
    assert "Bip01 L UpperArm" in recording.joint_map.source_joints
    want, seen = expected.joint_map.map(*_first(expected))
    got, also = recording.joint_map.map(*_first(recording))
    np.testing.assert_array_equal(seen, also)
    np.testing.assert_array_equal(want, got)


def _first(recording):
    person = recording.scenes[0].people[0]
    return person.positions, person.observed


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-le", "utf-16-be", "utf-32"]
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(tmp_path: Path, encoding, end) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(2))
    expected = _joints(path)
    text = path.read_text().replace("JOINT Spine", "JOINT Wirbels\u00e4ule")
    path.write_bytes(text.replace("\n", end).encode(encoding))
    np.testing.assert_array_equal(_joints(path), expected)
    assert "Wirbels\u00e4ule" in open_recording(path).joint_map.source_joints


def test_decimal_commas_and_missing_numbers(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(2))
    expected = _joints(path)
    text = path.read_text()
    path.write_text(text.replace(".", ","))
    np.testing.assert_allclose(_joints(path), expected, atol=1e-9)
    head, frames = text.split("Frame Time")
    path.write_text(f"{head}Frame Time{frames.replace('.', ',', 3)}")
    assert "decimal point" in _error(path)
    row = text.splitlines()[-1].split()
    path.write_text(text.replace(row[-1], "-1.#IND"))
    assert "some joint is not a valid number" in open_recording(path).note


def test_each_root_is_a_person(tmp_path: Path) -> None:
    path = tmp_path / "two.bvh"
    values = _values(2)
    write_bvh(path, RIG, values)
    first, motion = path.read_text().split("MOTION\n")
    header, rows = motion.splitlines()[:2], motion.splitlines()[2:]
    second = first.removeprefix("HIERARCHY\n")
    for name, _, _ in RIG:
        second = second.replace(f" {name}\n", f" B_{name}\n")
    shifted = write_bvh(tmp_path / "b.bvh", RIG, _values(2, seed=1)).read_text().splitlines()[-2:]
    both = [f"{a} {b}" for a, b in zip(rows, shifted, strict=True)]
    path.write_text("\n".join([f"{first}{second}MOTION", *header, *both]))
    recording = open_recording(path, person=7)
    assert [person.id for person in recording.scenes[1].people] == [7, 8]
    assert "'B_Hips' is person 8" in recording.note
    np.testing.assert_array_equal(
        recording.scenes[1].people[1].positions, _joints(tmp_path / "b.bvh")[1]
    )
    path.write_text(path.read_text().replace("B_LeftHand", "B_Tool"))
    assert "different joints" in _error(path)
