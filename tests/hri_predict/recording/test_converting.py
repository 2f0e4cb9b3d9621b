"""Scenes that only the node's own format holds: a replay from another one is never milder."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Doubt, Person, Scene
from hri_predict.protocol.reasons import Reason
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import DOUBTED, JOINED, TWICE, write_recording
from hri_predict.recording.format_table import BY_NAME
from tests.hri_predict.recording.made import of_scenes

OTHERS = [kind for kind in BY_NAME if kind not in ("mcap", "pack")]
"""The pack's layouts are those of its own joints."""
HOLD_TWO = ("csv", "trc", "c3d", "rosbag2", "rosbag2-sqlite")
DOUBT = Doubt(Reason.SENSORS_DISAGREE, "sensors a and b are 40 cm apart")
FRAMES, BAD = 50, range(20, 30)
JOINT_MAP = load_joint_map("canonical")
BODY = np.random.default_rng(0).normal(size=(len(JOINT_MAP.source_joints), 3)) * 0.2 + [2, 0, 1]


def body(number: int, k: int, x: float = 0.0) -> Person:
    moved = np.array([x, 0.001 * k, 0.0])
    return Person(number, BODY + moved, np.ones(len(BODY), bool))


def made(change) -> Recording:
    """A person for two seconds; ``change`` gives the bad scenes."""
    scenes = [Scene(k * 40_000_000, k, True, (body(1, k),)) for k in range(FRAMES)]
    scenes = [change(scene, k) if k in BAD else scene for k, scene in enumerate(scenes)]
    return of_scenes(scenes, JOINT_MAP, 25.0, kind="mcap")


def doubted(scene: Scene, k: int) -> Scene:
    return replace(scene, doubts=(DOUBT,))


def twice(scene: Scene, k: int) -> Scene:
    return replace(scene, people=(*scene.people, body(1, k, 3.0), body(2, k, 1.0)))


def written(recording: Recording, to: str, folder):
    path = folder / f"a{BY_NAME[to].ending}"
    result = write_recording(recording, path, to)
    return result, open_recording(path, any_joints=True)


def seen_at(recording: Recording) -> list[int]:
    """The 25ths of a second at which the room was seen and person 1 had joints."""
    first = recording.scenes[0].stamp_ns
    return [
        round((scene.stamp_ns - first) * 25e-9)
        for scene in recording.scenes
        if scene.sees_room and any(p.observed.any() for p in scene.people if p.id == 1)
    ]


@pytest.mark.parametrize("change", [doubted, twice])
@pytest.mark.parametrize("to", [kind for kind in OTHERS if kind != "bvh"])
def test_scenes_in_doubt_are_not_seen_in_other_formats(tmp_path, to, change):
    result, back = written(made(change), to, tmp_path)
    assert result.dropped[DOUBTED if change is doubted else TWICE] == len(BAD)
    assert min(result.dropped.values()) >= 0
    assert seen_at(back) == [k for k in range(FRAMES) if k not in BAD]


def test_bvh_counts_them_and_holds_the_last_place(tmp_path):
    result, back = written(made(doubted), "bvh", tmp_path)
    assert result.dropped[DOUBTED] == len(BAD)
    waists = np.array([scene.people[0].positions[0] for scene in back.scenes])
    assert (np.diff(waists[BAD.start - 1 : BAD.stop], axis=0) == 0).all()


def test_a_table_keeps_the_people_of_doubted_scenes(tmp_path):
    _, back = written(made(doubted), "csv", tmp_path)
    assert [scene.sees_room for scene in back.scenes] == [k not in BAD for k in range(FRAMES)]
    assert all(len(scene.people) == 1 for scene in back.scenes)


@pytest.mark.parametrize("to", HOLD_TWO)
def test_another_person_beside_two_bodies_of_one_id_is_kept(tmp_path, to):
    _, back = written(made(twice), to, tmp_path)
    places = {p.id for scene in back.scenes for p in scene.people if p.observed.any()}
    assert places == ({1} if "rosbag" in to else {1, 2})  # a bag leaves the scene out


@pytest.mark.parametrize("to", [kind for kind in OTHERS if kind != "csv"])
def test_a_format_without_any_scene_left_is_refused(tmp_path, to):
    scenes = [doubted(scene, 0) for scene in made(doubted).scenes]
    recording = replace(made(doubted), scenes=scenes)
    with pytest.raises(RecordingError, match="without doubt"):
        write_recording(recording, tmp_path / f"a{BY_NAME[to].ending}", to)
    assert list(tmp_path.iterdir()) == []


def test_the_nodes_own_format_holds_all(tmp_path):
    for change in (doubted, twice):
        recording = made(change)
        path = tmp_path / f"{change.__name__}.mcap"
        assert not +write_recording(recording, path, "mcap").dropped
        back = open_recording(path)
        assert [len(s.people) for s in back.scenes] == [len(s.people) for s in recording.scenes]
        assert [s.doubts for s in back.scenes] == [s.doubts for s in recording.scenes]


def test_corrected_ids_are_counted(tmp_path):
    result, _ = written(made(lambda s, k: replace(s, joined=((7, 1),))), "csv", tmp_path)
    assert result.dropped[JOINED] == len(BAD)
