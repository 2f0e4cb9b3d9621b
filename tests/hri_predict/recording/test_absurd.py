"""Absurd numbers in recordings: refused in one line, or not believed and said so."""

import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording import Recorder, RecordingInfo, open_recording
from hri_predict.recording.formats import npz

FRAMES = 5


def _npz(path: Path, **more: object) -> Path:
    positions = np.random.default_rng(1).normal(size=(FRAMES, 38, 3))
    np.savez(path, **({"positions_world": positions, "fps": 30.0} | more))  # type: ignore[arg-type]
    return path


def _mcap(path: Path, receipts_s: list[float], rate_hz: float = 25.0) -> Path:
    recorder = Recorder(
        path,
        RecordingInfo(joint_map=load_joint_map("canonical"), rate_hz=rate_hz, declares_noise=True),
        threaded=False,
    )
    person = Person(1, np.zeros((21, 3)), np.ones(21, bool))
    for k, seconds in enumerate(receipts_s):
        recorder.on_scene(Scene(k, k, True, (person,)), round(seconds * 1e9))
    recorder.close()
    return path


def _bvh(path: Path, frame_time: str, rows: list[str]) -> Path:
    names = ["Hips", "Spine", "Neck", "Head"]
    chain = ""
    for i, name in enumerate(names):
        kind = "ROOT" if i == 0 else "JOINT"
        channels = "CHANNELS 3 Zrotation Xrotation Yrotation"
        chain += f"{kind} {name}\n{{\nOFFSET 0 10 0\n{channels}\n"
    for side in ("Left", "Right"):
        for limb in (("Arm", "ForeArm", "Hand"), ("UpLeg", "Leg", "Foot")):
            for part in limb:
                chain += f"JOINT {side}{part}\n{{\nOFFSET 5 5 0\n{channels}\n"
            chain += "End Site\n{\nOFFSET 0 5 0\n}\n" + "}\n" * len(limb)
    chain += "}\n" * len(names)
    motion = f"MOTION\nFrames: {len(rows)}\nFrame Time: {frame_time}\n" + "\n".join(rows)
    path.write_text(f"HIERARCHY\n{chain}{motion}\n")
    return path


def _error(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_bvh_of_zeros_is_no_text(tmp_path: Path) -> None:
    with (tmp_path / "zeros.bvh").open("wb") as file:
        file.truncate(2**20)
    assert "not a BVH file (not text)" in _error(tmp_path / "zeros.bvh")


@pytest.mark.parametrize("fps", [1e9, 1e300, 1e-300, 0.001, 0.0, -1.0])
def test_an_absurd_rate_of_an_npz_is_refused(tmp_path: Path, fps: float) -> None:
    assert "it must be 0.1 to 10000" in _error(_npz(tmp_path / "a.npz", fps=fps))


@pytest.mark.parametrize("rate_hz", [1e9, 1e-300, float("nan")])
def test_an_absurd_rate_of_an_mcap_is_refused(tmp_path: Path, rate_hz: float) -> None:
    assert "rate_hz" in _error(_mcap(tmp_path / "a.mcap", [1.0], rate_hz))


@pytest.mark.parametrize("frame_time", ["1e300", "1e-300", "1e-320", "0.00000001", "11", "nan"])
def test_an_absurd_frame_time_of_a_bvh_is_refused(tmp_path: Path, frame_time: str) -> None:
    rows = [" ".join(["0"] * 48)] * 2
    assert "'Frame Time'" in _error(_bvh(tmp_path / "a.bvh", frame_time, rows))


@pytest.mark.parametrize("channels", ["\N{SUPERSCRIPT TWO}", "9" * 5000])
def test_channels_of_a_bvh_that_are_no_number_are_refused(tmp_path: Path, channels: str) -> None:
    path = _bvh(tmp_path / "a.bvh", "0.04", [" ".join(["0"] * 48)])
    text = path.read_text().replace("CHANNELS 3", f"CHANNELS {channels}", 1)
    path.write_text(text, encoding="utf-8")
    assert "CHANNELS of" in _error(path)


@pytest.mark.parametrize("value", ["nan", "1e300"])
def test_frames_of_a_bvh_that_are_not_numbers_are_counted(tmp_path: Path, value: str) -> None:
    rows = [" ".join(["0"] * 48)] * 2 + [" ".join([value] * 48)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = open_recording(_bvh(tmp_path / "a.bvh", "0.04", rows))
    assert [bool(s.people[0].observed.all()) for s in recording.scenes] == [True, True, False]
    assert not recording.scenes[2].people[0].observed[1:].any()
    assert recording.note == "in 1 of 3 frames some joint is not a valid number"


@pytest.mark.parametrize("value", [1e300, -1001.0, np.inf, np.nan])
def test_coordinates_that_nobody_has_are_not_believed(tmp_path: Path, value: float) -> None:
    positions = np.zeros((FRAMES, 38, 3))
    positions[2] = value
    positions[3, 7, 1] = value
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = open_recording(_npz(tmp_path / "a.npz", positions_world=positions))
    seen = [int(s.people[0].observed.sum()) for s in recording.scenes]
    assert seen == [38, 38, 0, 37, 38]
    assert recording.note == "in 1 of 5 frames no joint is known"
    for scene in recording.scenes:
        person = scene.people[0]
        assert np.isnan(person.positions[~person.observed]).all()


@pytest.mark.parametrize("first", [-1, 1.5, 1e300 + 0.5, np.nan])
def test_rest_pose_frames_is_a_whole_number(tmp_path: Path, first: float) -> None:
    text = _error(_npz(tmp_path / "a.npz", rest_pose_frames=first))
    assert "rest_pose_frames" in text or ": empty" in text


@pytest.mark.parametrize("ok", [np.ones(FRAMES), np.array(["yes"] * FRAMES), np.ones(FRAMES - 1)])
def test_world_ok_holds_truth_values(tmp_path: Path, ok: object) -> None:
    assert "'world_ok'" in _error(_npz(tmp_path / "a.npz", world_ok=ok))


def test_an_archive_that_unpacks_to_more_than_is_sane_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(npz, "MAX_BYTES", 2**22)  # a GiB takes long to pack
    path = _npz(tmp_path / "a.npz")
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open("world_ok.npy", "w", force_zip64=True) as entry,
    ):
        entry.write(bytes(2**22))
    assert "when unpacked, at most" in _error(path)


def test_what_is_not_asked_for_is_not_unpacked(tmp_path: Path) -> None:
    path = _npz(tmp_path / "a.npz")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("other.npy", b"not an array at all")
    assert len(open_recording(path).scenes) == FRAMES


@pytest.mark.parametrize(
    "receipts_s", [[1.0, 1.1, 1e10], [1.0, 1.1, 1.05], [1.0, 1.1, 3602.0]], ids=str
)
def test_scenes_that_a_replay_would_not_come_to_are_refused(tmp_path: Path, receipts_s) -> None:
    assert "scene 3 arrives" in _error(_mcap(tmp_path / "a.mcap", receipts_s))


def test_scenes_received_together_or_after_an_hour_are_fine(tmp_path: Path) -> None:
    assert len(open_recording(_mcap(tmp_path / "a.mcap", [1.0, 1.0, 3601.0])).scenes) == 3


def test_a_device_and_a_name_too_long_are_no_recordings(tmp_path: Path) -> None:
    assert "is a device" in _error(Path("/dev/null"))
    assert "no such file" in _error(tmp_path / f"{'a' * 300}.npz")
