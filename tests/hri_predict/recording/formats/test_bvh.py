"""BVH files: our kinematics against bvhio's own, which works on another structure."""

import json
from pathlib import Path

import numpy as np
import pytest

from hri_predict.errors import RecordingError
from hri_predict.recording import open_recording
from hri_predict.recording.formats.bvh import forward_kinematics
from hri_predict.skeleton import JOINTS

bvhio = pytest.importorskip("bvhio", reason="needs the extra 'io'")

DATA = Path(__file__).resolve().parents[5] / "shared" / "data"

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
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(4))
    names, ours = forward_kinematics(bvhio.readAsBvh(str(path)).Root, with_ends=True)
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


@pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data")
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


def test_cut_anywhere_it_is_an_error_and_never_a_wait(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(3))
    text = path.read_text()
    whole = len(text.rstrip().rsplit(" ", 1)[0])  # before the last value
    for keep in np.linspace(1, whole, 60).astype(int):
        path.write_text(text[:keep])
        _error(path)


def test_what_is_wrong_in_a_bvh_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    assert "Frames: 0" in _error(write_bvh(path, RIG, _values(0)))
    assert "Frame Time" in _error(write_bvh(path, RIG, _values(2), frame_time=0.0))
    strange = [(f"b{n}", None if p is None else f"b{p}", o) for n, p, o in RIG]
    assert "Hips" in _error(write_bvh(path, strange, _values(2)))
    path.write_bytes(b"\xff\xfe\x00HIERARCHY")
    assert "not text" in _error(path)
    path.write_text("solid cube")
    assert "HIERARCHY" in _error(path)
    good = write_bvh(path, RIG, _values(2)).read_text()
    path.write_text(good.replace("OFFSET 0.0 12.0 0.0", "OFFSET 0.0 twelve 0.0"))
    assert "numerics" in _error(path)


def test_without_the_reader_the_remedy_is_named(tmp_path: Path, monkeypatch) -> None:
    path = write_bvh(tmp_path / "a.bvh", RIG, _values(2))
    monkeypatch.setitem(__import__("sys").modules, "bvhio", None)
    assert "pip install 'hri-predict[io]'" in _error(path)
