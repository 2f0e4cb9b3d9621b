"""Each remedy that is printed for a file is applied, and then people are where they truly are."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import METRES_PER_UNIT, axes_rotation
from hri_predict.contracts.scene import Person, Scene
from hri_predict.people.body.axes import all_axes
from hri_predict.recording.converting import write_recording
from hri_predict.recording.formats.bvh_writer import zxy_degrees
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.opening import open_recording, opened
from hri_predict.recording.recording import Recording
from hri_sim.people.body import Body
from tests.commands import status_of
from tests.hri_predict.recording.made import of_scenes

_WHO = Body(1.75)
TRUE = np.array([_WHO.joints(_WHO.standing(np.array([0.02 * k, 0.1]), 0.0)) for k in range(20)])
EXACT = {"csv": 1e-5, "trc": 1e-5, "c3d": 1e-5, "amass": 1e-4, "bvh": 1e-4}
"""Metres: the formats round to 1 um or are 32-bit floats, of a few metres in the file's unit."""
ROTATIONS = [axes for axes, _ in all_axes(1.0)]
MIRRORS = [axes for axes, _ in all_axes(-1.0)]


def recorded(positions) -> Recording:
    scenes = [
        Scene(round(k * 1e9 / 30), k, True, (Person(1, p, np.ones(len(JOINTS), bool)),))
        for k, p in enumerate(positions)
    ]
    return of_scenes(scenes, map_of_names(JOINTS), 30.0)


def written(folder: Path, kind: str, positions) -> Path:
    path = folder / f"a file.{'npz' if kind == 'amass' else kind}"
    write_recording(recorded(positions), path, kind, force=True)
    return path


def canonical(recording: Recording) -> np.ndarray:
    return np.array(
        [
            recording.joint_map.map(person.positions, person.observed)[0]
            for scene in recording.scenes
            for person in scene.people
        ]
    )


def mended(path: Path, monkeypatch) -> tuple[Path, str]:
    """The file that the printed command makes, and the command."""
    with pytest.raises(RecordingError) as error:
        opened(path)
    assert "\n" not in str(error.value)
    command = re.search(r"writes a correct file: hri-predict (.+)$", str(error.value))
    assert command is not None, str(error.value)
    monkeypatch.chdir(path.parent)
    words = shlex.split(command[1])
    assert status_of(*words, "--force") == 0
    return path.parent / words[2], command[1]


@pytest.mark.parametrize("kind", ["csv", "trc", "c3d", "amass"])
@pytest.mark.parametrize("unit", list(METRES_PER_UNIT))
@pytest.mark.parametrize(
    "axes", [["x", "y", "z"], ["z", "x", "y"], ["-y", "x", "z"], ["z", "-x", "-y"]], ids=",".join
)
def test_units_and_axes(tmp_path, monkeypatch, kind, unit, axes):
    """``axes`` are those that the file has where the format's own are expected."""
    turn = axes_rotation(axes)
    wrong = TRUE @ turn / METRES_PER_UNIT[unit]
    path = written(tmp_path, kind, wrong)
    if unit == "m" and axes in (["x", "y", "z"], ["-y", "x", "z"]):  # no body shows its heading
        assert opened(path)
        return
    right, command = mended(path, monkeypatch)
    assert ("--units" in command) == (unit != "m")
    found = canonical(opened(right))
    heading = [["x", "y", "z"], ["-y", "x", "z"]]
    expected = TRUE if axes not in heading else TRUE @ turn
    np.testing.assert_allclose(found, expected, atol=EXACT[kind])


@pytest.mark.parametrize("axes", ROTATIONS, ids=",".join)
def test_any_rotation(tmp_path, monkeypatch, axes):
    turn = axes_rotation(axes)
    path = written(tmp_path, "csv", TRUE @ turn)
    if abs(turn[2, 2] - 1) < 1e-9:  # only the heading is wrong
        assert opened(path)
        return
    found = canonical(opened(mended(path, monkeypatch)[0]))
    np.testing.assert_allclose(found, TRUE, atol=EXACT["csv"])


@pytest.mark.parametrize("kind", ["csv", "trc"])
@pytest.mark.parametrize("axes", MIRRORS, ids=",".join)
def test_any_left_handed_axes(tmp_path, monkeypatch, kind, axes):
    path = written(tmp_path, kind, TRUE @ axes_rotation(axes, left_handed=True))
    right, command = mended(path, monkeypatch)
    assert "--left-handed" in command
    found = canonical(opened(right))
    np.testing.assert_allclose(found[..., 2], TRUE[..., 2], atol=EXACT[kind])
    np.testing.assert_allclose(found, TRUE, atol=EXACT[kind])


@pytest.mark.parametrize("unit", ["cm", "inch", "ft", "mm", "m"])
@pytest.mark.parametrize("axes", [["z", "x", "y"], ["-y", "x", "z"], ["x", "y", "z"]], ids=",".join)
def test_bvh_states_neither(tmp_path, monkeypatch, unit, axes):
    """A BVH is rigid, so it is compared with what was written in the format's own frame."""
    expected = canonical(open_recording(written(tmp_path, "bvh", TRUE)))
    path = tmp_path / "a file.bvh"
    turn = axes_rotation(axes).T @ axes_rotation(["z", "x", "y"])
    scale = METRES_PER_UNIT["cm"] / METRES_PER_UNIT[unit]
    path.write_text(_bvh_in(path.read_text(), turn, scale))
    if unit == "cm" and axes == ["z", "x", "y"]:
        assert opened(path)
        return
    right, command = mended(path, monkeypatch) if not _is_right(path) else (path, "")
    if axes == ["-y", "x", "z"]:
        assert "--axes -y,x,z" in command
    np.testing.assert_allclose(canonical(opened(right)), expected, atol=EXACT["bvh"])


def _is_right(path: Path) -> bool:
    try:
        return bool(opened(path))
    except RecordingError:
        return False


def _bvh_in(text: str, turn: np.ndarray, scale: float) -> str:
    """A BVH with its world turned by ``turn`` (3, 3), and in another unit: offsets, the root's
    positions and all rotations, which are written in the order z, x, y."""
    lines, values = [], False
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["OFFSET"]:
            moved = scale * turn @ np.array(words[1:], float)
            lines.append(f"OFFSET {' '.join(f'{v:.9f}' for v in moved)}")
        elif values:
            cells = np.array(words, float)
            root = scale * turn @ cells[:3]
            angles = np.radians(cells[3:].reshape(-1, 3))
            turned = [zxy_degrees(turn @ _matrix(*a) @ turn.T) for a in angles]
            lines.append(" ".join(f"{v:.9f}" for v in [*root, *np.concatenate(turned)]))
        else:
            lines.append(line)
        values = values or line.startswith("Frame Time")
    return "\n".join(lines)


def _matrix(z: float, x: float, y: float) -> np.ndarray:
    cz, sz, cx, sx, cy, sy = (f(a) for a in (z, x, y) for f in (np.cos, np.sin))
    return (
        np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    )


@pytest.mark.parametrize(
    ("real", "taken"), [("inch", "cm"), ("cm", "inch"), ("ft", "m"), ("mm", "m"), ("inch", "mm")]
)
def test_a_unit_that_was_taken_for_another_before(tmp_path, monkeypatch, real, taken):
    """Inches that some program converted as centimetres."""
    factor = METRES_PER_UNIT[real] / METRES_PER_UNIT[taken]
    right, _ = mended(written(tmp_path, "csv", TRUE / factor), monkeypatch)
    np.testing.assert_allclose(canonical(opened(right)), TRUE, rtol=1e-5, atol=1e-4)


def test_joints_too_far_away_to_be_believed(tmp_path, monkeypatch):
    turn = axes_rotation(["z", "-x", "-y"])  # of a camera, 5 m in front of it, millimetres
    true = TRUE + np.array([5.0, 2.0, 3.0])
    path = tmp_path / "far.csv"
    header = ",".join(f"{joint}_{c}" for joint in JOINTS for c in "xyz")
    rows = [
        f"{k / 30:.6f}," + ",".join(f"{v:.3f}" for v in p.ravel())
        for k, p in enumerate(true @ turn * 1000)
    ]
    path.write_text("\n".join([f"time_s,{header}", *rows]))
    right, command = mended(path, monkeypatch)
    assert "--units mm --axes z,-x,-y" in command
    np.testing.assert_allclose(canonical(opened(right)), true, atol=1e-5)


@pytest.mark.parametrize("height", [0.9, 1.05, 2.6, 3.5])
def test_a_scale_that_no_unit_explains_gets_no_remedy_that_does_not_work(tmp_path, height):
    path = written(tmp_path, "csv", TRUE * height / 1.75)
    with pytest.raises(RecordingError, match="not of human size") as error:
        opened(path)
    if "hri-predict convert" not in str(error.value):
        assert "no unit explains that" in str(error.value)


@pytest.mark.parametrize("height", [1.35, 1.5, 1.75, 2.0, 2.1])
def test_adults_are_not_refused(tmp_path, height):
    who = Body(height)
    body = who.joints(who.standing(np.array([1.0, 0.0]), 0.3))
    assert opened(written(tmp_path, "csv", np.array([body] * 5)))
