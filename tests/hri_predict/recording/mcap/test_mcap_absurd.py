"""MCAP files of absurd numbers and sizes: one clear error, or read up to there."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.records import Chunk

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording import Recorder, RecordingInfo, open_recording
from hri_predict.recording.mcap import reader as mcap_reader

JOINTS = 6
INFO = RecordingInfo(joint_map=load_joint_map("assembly_arms"), rate_hz=30.0, declares_noise=True)
A, B, C = INFO.joint_map.source_joints[:3]
RIGID = {"at": A, "left": [A, B], "up": [C, A], "offset_m": [0, 0, 0.1]}
SCENE = Scene(0, 0, True, (Person(1, np.zeros((JOINTS, 3)), np.ones(JOINTS, bool)),))


def test_what_unpacks_to_more_than_is_sane_is_not_unpacked(tmp_path: Path) -> None:
    """A chunk of kilobytes may hold gigabytes."""
    with Recorder(tmp_path / "a.mcap", INFO, threaded=False) as recorder:
        recorder.on_scene(SCENE, 10)
        assert recorder._file is not None
        recorder._file.flush()
        recorder._file._writer.add_message(1, 11, bytes(2**26 + 1), 11)
    recording = open_recording(tmp_path / "a.mcap")
    assert len(recording.scenes) == 1
    assert "cut or damaged" in recording.note


@pytest.mark.parametrize(
    ("compression", "data", "said"),
    [
        ("zstd", zstandard.compress(bytes(2**26 + 1)), 1000),
        ("zstd", zstandard.compress(b"short"), 2**26 + 1),
        ("", b"short", 2**26 + 1),
        ("lz4", b"short", 5),
    ],
)
def test_a_chunk_that_lies_about_its_size_is_not_unpacked(compression, data, said) -> None:
    with pytest.raises(ValueError, match=r"when unpacked|compression"):
        mcap_reader._check_unpacked(Chunk(compression, data, 0, 0, 0, said))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("source_joints", "[" * 100_000),
        ("rotation", f"[[1{'0' * 400}, 0, 0], [0, 1, 0], [0, 0, 1]]"),
        ("rotation", "[[NaN, 0, 0], [0, 1, 0], [0, 0, 1]]"),
        ("weights", json.dumps([[1e308] * 6] * 21)),
        ("weights", json.dumps([[-1.0] * 6] * 21)),
        ("rigid", "[]"),
        ("rigid", '{"l_hip": 3}'),
        ("rigid", json.dumps({"l_hip": {**RIGID, "at": "no such joint"}})),
        ("rigid", json.dumps({"l_hop": RIGID})),
        ("rigid", json.dumps({"l_hip": {**RIGID, "offset_m": [1e308, 0, 0]}})),
        ("scale_to_m", "nan"),
        ("scale_to_m", "0.0"),
    ],
)
def test_absurd_metadata_are_one_clear_error(tmp_path: Path, monkeypatch, key, value) -> None:
    said = INFO.to_metadata() | {key: value}
    monkeypatch.setattr(RecordingInfo, "to_metadata", lambda self: said)
    with Recorder(tmp_path / "a.mcap", INFO, threaded=False) as recorder:
        recorder.on_scene(SCENE, 10)
    with pytest.raises(RecordingError, match="its metadata are damaged"):
        open_recording(tmp_path / "a.mcap")


def test_rigid_joints_of_a_map_come_back(tmp_path: Path) -> None:
    info = replace(INFO, joint_map=load_joint_map("marker_clusters9"))
    person = Person(1, np.arange(27.0).reshape(9, 3) ** 2 / 500, np.ones(9, bool))
    with Recorder(tmp_path / "a.mcap", info, threaded=False) as recorder:
        recorder.on_scene(replace(SCENE, people=(person,)), 10)
    read = open_recording(tmp_path / "a.mcap").joint_map
    assert dict(read.rigid) == dict(info.joint_map.rigid)
    for mine, theirs in zip(
        read.map(person.positions, person.observed),
        info.joint_map.map(person.positions, person.observed),
        strict=True,
    ):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(10**400, 0, True, ()),
        Scene(0, -(10**30), True, ()),
        Scene(0, 0, True, (Person(65536, np.zeros((JOINTS, 3)), np.ones(JOINTS, bool)),)),
    ],
    ids=["capture", "sequence", "id"],
)
def test_scenes_of_numbers_beyond_all_counting_are_refused(tmp_path: Path, scene: Scene) -> None:
    with Recorder(tmp_path / "a.mcap", INFO, threaded=False) as recorder:
        recorder.on_scene(scene, 12)
    with pytest.raises(RecordingError, match="is damaged"):
        open_recording(tmp_path / "a.mcap")
