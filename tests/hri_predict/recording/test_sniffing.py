"""What files seem to be that are not what they are called, or that nobody here reads."""

import contextlib
import sqlite3
import zipfile

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.recording import open_recording
from hri_predict.recording.opening import seems

HEADS = {
    b"\x89MCAP0\r\n\x01": ".mcap, MCAP",
    b"\xef\xbb\xbfHIERARCHY\nROOT": ".bvh, BVH",
    b"  PathFileType\t4": ".trc, markers as OpenSim's TRC",
    b"\x02\x50" + bytes(600): ".c3d, C3D",
    b"time_s,a_x,a_y,a_z\n0,1,2,3": ".csv, a table as text",
    b"Kaydara FBX Binary  \x00\x1a\x00": "FBX",
    b"glTF\x02\0\0\0": "glTF, or VRM",
    b"#ROSBAG V2.0\n": ".bag, a bag of ROS 1",
    b'<?xml version="1.0"?><mvnx version="4">': "Xsens MVNX",
    b'{"people": []}': ".json, OpenPose's keypoints",
    b'{"frames": []}': "JSON",
    b"\x89HDF\r\n\x1a\n": "HDF5, or MATLAB 7.3",
    b"\x80\x04\x95": ".pkl, a Python pickle, of which only 3DPW's",
    b"LOGG\x90\0\0\0": "Vector's BLF: bus traffic, not motion",
    b"version https://git-lfs.github.com/spec/v1": "a Git LFS pointer: fetch the file itself by",
    bytes(700): "",
    b"hello": "",
}


@pytest.mark.parametrize(("head", "what"), HEADS.items())
def test_the_first_bytes_tell(tmp_path, head, what):
    path = tmp_path / "a.xyz"
    path.write_bytes(head)
    seen = ", ".join(filter(None, seems(path)))
    assert seen.startswith(what)
    assert bool(seen) == bool(what)
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    assert what.split(",")[0] in str(caught.value)
    assert "\n" not in str(caught.value)


def test_real_files_of_other_libraries(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros(3))
    np.savez(tmp_path / "b.npz", a=np.zeros(3))
    with zipfile.ZipFile(tmp_path / "c.zip", "w") as archive:
        archive.writestr("walk.bvh", "HIERARCHY")
    with contextlib.closing(sqlite3.connect(tmp_path / "d.db3")) as base:
        base.execute("create table topics (id int)")
    found = [seems(path) for path in sorted(tmp_path.iterdir())]
    assert found == [
        (".npy", "a single NumPy array"),
        (".npz", "NumPy"),
        ("", "a zip archive: unpack it"),
        (".db3", "SQLite, such as a bag of ROS 2"),
    ]


def test_a_file_by_another_name_is_told_its_own(tmp_path):
    with (tmp_path / "a.bvh").open("wb") as file:
        np.savez(file, joints=np.zeros((2, 22, 3)), fps=30.0)
    with pytest.raises(RecordingError, match=r"its content seems to be \.npz, NumPy"):
        open_recording(tmp_path / "a.bvh")
    (tmp_path / "a.bvh").rename(tmp_path / "a.dat")
    with pytest.raises(RecordingError, match=r"seems to be \.npz, NumPy; name it so"):
        open_recording(tmp_path / "a.dat")
