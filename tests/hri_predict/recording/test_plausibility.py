"""Files whose people cannot be people are refused with the remedy, and no others."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import METRES_PER_UNIT
from hri_predict.recording.opening import opened
from hri_sim.people.body import Body
from hri_sim.replay import RecordingSettings, RecordingSource
from tests.commands import status_of
from tests.shared import DATA

_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([2.0, 0.3]), 0.4))
LYING = (BODY - BODY[0]) @ np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]).T + [2.0, 0.3, 0.2]


def written(path, *bodies):
    """A table of the bodies, each shown for a second."""
    header = ",".join(f"{joint}_{c}" for joint in JOINTS for c in "xyz")
    rows = [body for body in bodies for _ in range(30)]
    lines = [
        f"{k / 30:.4f}," + ",".join(f"{v:.6f}" for v in body.ravel()) for k, body in enumerate(rows)
    ]
    path.write_text("\n".join([f"time_s,{header}", *lines]))
    return path


def refused(path, *bodies):
    with pytest.raises(RecordingError) as error:
        opened(written(path, *bodies))
    return str(error.value)


@pytest.mark.parametrize("unit", ["mm", "cm", "inch", "ft"])
def test_a_file_in_another_unit_is_refused_by_its_name(tmp_path, unit):
    text = refused(tmp_path / "a.csv", (BODY - [1.6, 0.1, 0.9]) / METRES_PER_UNIT[unit])
    assert f"--units {unit}" in text
    assert "\n" not in text


def test_a_file_so_far_off_that_nobody_is_seen_is_refused(tmp_path):
    text = refused(tmp_path / "a.csv", 1000 * (BODY - [-3.0, -3.0, -3.0]))
    assert "more than 1000 m away" in text
    assert "--units mm" in text


def test_other_axes_and_mirrors_are_refused(tmp_path):
    assert "--axes" in refused(tmp_path / "a.csv", BODY[:, [1, 2, 0]])
    assert "--axes" in refused(tmp_path / "a.csv", BODY * [1.0, -1.0, -1.0])
    mirrored = refused(tmp_path / "a.csv", BODY * [1.0, -1.0, 1.0])
    assert "left and right" in mirrored
    assert "--left-handed" in mirrored


def test_what_was_passed_over_in_a_file_is_logged_once(tmp_path, caplog):
    path = written(tmp_path / "a.csv", BODY)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{lines[0]},frame", *(f"{line},7" for line in lines[1:])]))
    for _ in range(2):
        opened(path)
    assert [r.getMessage() for r in caplog.records if "columns not used" in r.getMessage()] == [
        f"recording {path}: columns not used: 'frame'"
    ]


def test_people_may_lie_for_a_while(tmp_path):
    assert opened(written(tmp_path / "a.csv", BODY, LYING))


@pytest.mark.long
@pytest.mark.skipif(not DATA.exists(), reason="the data pack is not here")
def test_no_recording_of_the_data_pack_is_refused():
    for path in sorted(DATA.glob("**/*.npz")):
        assert opened(path)


def archive(path, bodies, factor):
    """An archive as ``convert`` writes it, with its joints times a factor."""
    np.savez(
        path, joints=np.array(bodies) * factor, joint_names=np.array(JOINTS), mocap_framerate=30.0
    )
    return path


def walk(frames=60):
    """(frames, J, 3) a body that walks past the origin, where a wrong unit leaves some joints."""
    return BODY - [2.0, 0.3, 0.9] + np.linspace([-4.0, 0.0, 0.0], [4.0, 0.0, 0.0], frames)[:, None]


@pytest.mark.parametrize(("factor", "unit"), [(1000, "mm"), (100, "cm"), (1e6, ""), (1e12, "")])
def test_units_are_judged_before_far_joints_are_left_out(tmp_path, factor, unit):
    path = archive(tmp_path / "a.npz", walk(), factor)
    with pytest.raises(RecordingError) as error:
        opened(path)
    assert (f"--units {unit}" if unit else "no unit explains that") in str(error.value)
    with pytest.raises(RecordingError, match=unit or "no "):
        RecordingSource(RecordingSettings(kind="recording", path=str(path)))


def test_convert_writes_no_file_that_lacks_most_joints_and_its_remedy_works(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    path = archive(tmp_path / "a.npz", walk(), 1000)
    assert status_of("convert", path, tmp_path / "b.mcap") != 0
    assert not (tmp_path / "b.mcap").exists()
    error = " ".join(capsys.readouterr().err.split())
    command = error[error.index("hri-predict convert") :]
    assert not status_of(*shlex.split(command)[1:6])
    assert opened(Path(shlex.split(command)[3]))


def test_absurd_values_in_most_frames_are_refused_and_a_late_person_is_not(tmp_path):
    mixed = walk()
    mixed[::2] *= 1e5
    mixed[::3] *= 1e7
    with pytest.raises(RecordingError, match="more than 1000 m away"):
        opened(archive(tmp_path / "mixed.npz", mixed, 1))
    late = walk()
    late[:50] = np.nan
    late[55, 3] = 1e5
    assert opened(archive(tmp_path / "late.npz", late, 1))


@pytest.mark.parametrize("factor", [1000, 1e7])
def test_a_layout_in_metres_is_refused_in_other_units(tmp_path, factor):
    path = tmp_path / "a.npz"
    np.savez(path, positions=walk() * factor, joint_names=np.array(JOINTS), parents=[0], fps=30.0)
    with pytest.raises(RecordingError, match="must be in metres") as error:
        opened(path)
    assert ("multiply them by 0.001 (mm)" in str(error.value)) == (factor == 1000)
