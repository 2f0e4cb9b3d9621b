"""Recordings played as a source: in time, decimated, looped, placed, and the node's own again."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.link import Received
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording import Recorder, RecordingInfo, open_recording
from hri_predict.recording.converting import write_recording
from hri_sim.people.body import Body
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from hri_sim.replay import RecordingSettings, RecordingSource
from tests.messages import make_state
from tests.shared import DATA, needs_data

START = 5_000_000_000


def _source(path: Path | str, base_dir: Path | None = None, **more: Any) -> Any:
    data = {"kind": "recording", "path": str(path)} | more
    source = RecordingSource(validated(RecordingSettings, data, "source"), base_dir)
    source.open(START)
    return source


def _all(source: Any, until: int | None = None) -> list[tuple[int, Scene]]:
    """Every scene with its arrival, asked for as a node would."""
    found = []
    while (due := source.next_ns()) is not None and (until is None or due <= until):
        assert source.poll(due - 1) is None  # never before it is due
        scene = source.poll(due)
        assert scene is not None
        found.append((due, scene))
    return found


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """Two seconds at 120 Hz: 38 joints that move along +z of the file (forward) at 1 m/s."""
    t = np.arange(241)[:, None] / 120
    rest = np.random.default_rng(1).normal(size=(1, 38, 3))
    positions = np.repeat(rest, 241, axis=0)
    positions[:, :, 2] += t
    np.savez(tmp_path / "walk.npz", positions_world=positions, fps=np.float32(120))
    return tmp_path / "walk.npz"


@pytest.mark.parametrize("more", [{"unit_m": 0.001}, {"axes": ["x", "y", "z"]}], ids=str)
def test_units_and_axes_that_the_file_states_are_not_silently_passed_over(
    walk: Path, more: dict[str, Any]
) -> None:
    with pytest.raises(ConfigError, match=rf"source\.{next(iter(more))}: has no effect on"):
        _source(walk, **more)


def test_scenes_come_at_their_true_time_and_then_it_ends(walk: Path) -> None:
    source = _source(walk)
    found = _all(source)
    assert len(found) == 241
    assert source.rate_hz == 120.0
    assert not source.declares_noise
    for k, (due, scene) in enumerate(found):
        assert due == scene.stamp_ns == START + round(k * 1e9 / 120)
        assert scene.sequence == k
        assert scene.sees_room
    assert source.next_ns() is None
    assert source.poll(10**18) is None
    source.open(0)  # again, from the start
    assert source.poll(0) is not None


def test_a_twin_plays_the_same_scenes_without_reading_the_file_again(walk: Path) -> None:
    source = _source(walk)
    source.poll(START)
    walk.unlink()
    twin = source.twin()
    assert twin.next_ns() is None  # not open
    twin.open(START)
    assert len(_all(twin)) == 241
    assert len(_all(source)) == 240  # its own place was not moved


def test_late_questions_get_every_scene_in_order(walk: Path) -> None:
    source, late = _source(walk), _source(walk)
    expected = [scene for _, scene in _all(source)]
    got = []
    while (scene := late.poll(START + 10**10)) is not None:
        got.append(scene)
    assert [s.stamp_ns for s in got] == [s.stamp_ns for s in expected]


def test_a_camera_like_rate_leaves_frames_out_and_keeps_their_times(walk: Path) -> None:
    full = [scene for _, scene in _all(_source(walk))]
    for rate_hz, ratio in ((30.0, 4.0), (25.0, 4.8)):
        source = _source(walk, rate_hz=rate_hz)
        found = [scene for _, scene in _all(source)]
        assert source.rate_hz == rate_hz
        assert len(found) == 1 + int(2.0 * rate_hz)
        for i, scene in enumerate(found):
            twin = full[round(i * ratio)]
            assert scene.sequence == i
            assert scene.stamp_ns == twin.stamp_ns
            np.testing.assert_array_equal(scene.people[0].positions, twin.people[0].positions)
    with pytest.raises(ConfigError, match="never invented"):
        _source(walk, rate_hz=200.0)


def test_a_part_of_it(walk: Path) -> None:
    found = _all(_source(walk, start_s=0.5, end_s=1.0))
    assert found[0][0] == START
    assert found[-1][0] == pytest.approx(START + 0.5e9, abs=1e7)
    with pytest.raises(ConfigError, match=r"lasts 2\.0 s"):
        _source(walk, start_s=9.0)


def test_a_loop_shows_an_empty_room_before_it_begins_again(walk: Path) -> None:
    source = _source(walk, loop=True, loop_gap_s=1.0, rate_hz=30.0)
    found = _all(source, until=START + 7_000_000_000)
    scenes = [scene for _, scene in found]
    assert [s.sequence for s in scenes] == list(range(len(scenes)))
    gaps = np.diff([s.stamp_ns for s in scenes])
    np.testing.assert_allclose(gaps, 1e9 / 30, rtol=1e-3)
    there = np.array([bool(s.people) for s in scenes])
    assert all(s.sees_room for s in scenes)
    assert list(np.flatnonzero(np.diff(there.astype(int)))) == [60, 90, 151, 181]
    np.testing.assert_array_equal(scenes[91].people[0].positions, scenes[0].people[0].positions)
    assert source.truth(scenes[70].stamp_ns) == {}
    assert 1 in source.truth(scenes[100].stamp_ns)


def test_noise_is_seeded_and_declared(walk: Path) -> None:
    def captured(**more: Any) -> Any:
        return np.array([s.people[0].positions for _, s in _all(_source(walk, **more))])

    clean, noisy = captured(), captured(noise_m=0.01, seed=1)
    np.testing.assert_array_equal(noisy, captured(noise_m=0.01, seed=1))
    assert not np.array_equal(noisy, captured(noise_m=0.01, seed=2))
    assert np.std(noisy - clean) == pytest.approx(0.01, rel=0.03)
    assert _source(walk, noise_m=0.01).declares_noise


def test_placed_and_under_another_id(walk: Path) -> None:
    source = _source(walk, place=[1.0, 2.0, math.pi / 2], person=9)
    found = [scene for _, scene in _all(source)]
    first, last = (
        source.joint_map.map(s.people[0].positions, s.people[0].observed)[0][JOINTS.index("waist")]
        for s in (found[0], found[-1])
    )
    assert found[0].people[0].id == 9
    np.testing.assert_allclose(first[:2], [1.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(last[:2], [1.0, 4.0], atol=1e-9)


def test_truth_goes_on_between_captures(walk: Path) -> None:
    source = _source(walk, rate_hz=10.0, noise_m=0.05)
    waist = JOINTS.index("waist")
    times = [START + 250_000_000, START + 300_000_000, START + 1_010_000_000]
    at = [source.truth(t)[1][0][waist][0] for t in times]
    np.testing.assert_allclose(np.diff(at), [0.05, 0.71], atol=0.01)
    assert source.truth(START + 3_000_000_000) == {}


def test_a_path_starts_at_the_configuration_or_where_the_user_is(
    walk: Path, tmp_path: Path, monkeypatch
) -> None:
    assert _source("walk.npz", tmp_path).next_ns() == START
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    assert _source("walk.npz", tmp_path / "elsewhere").next_ns() == START
    with pytest.raises(RecordingError, match="no such file"):
        _source("gone.npz", tmp_path)


def _recorded(path: Path, source: Any, seconds: float, latency_ns: int = 3_000_000) -> list[Any]:
    """Record what a source gives, with a robot's state beside it; returns the scenes."""
    info = RecordingInfo(
        joint_map=source.joint_map,
        rate_hz=source.rate_hz,
        declares_noise=source.declares_noise,
        config="a: 1",
    )
    scenes: list[Any] = []
    with Recorder(path, info, threaded=False) as recorder:
        source.open(START)
        while (due := source.next_ns()) is not None and due <= START + seconds * 1e9:
            scene = source.poll(due)
            recorder.on_scene(scene, due + latency_ns)
            state = make_state((0.5,), counter=len(scenes) % 256)
            recorder.on_received("can", Received(state, due + 1))
            scenes.append(scene)
    return scenes


def test_the_nodes_own_recording_plays_again_exactly(tmp_path: Path) -> None:
    settings = {"kind": "procedural", "noise_m": 0.01, "dropout": 0.1, "rate_hz": 20.0}
    original = ProceduralSource(validated(ProceduralSettings, settings, "source"))
    scenes = _recorded(tmp_path / "a.mcap", original, 3.0)
    source = _source(tmp_path / "a.mcap")
    source.open(START + 700)
    assert source.declares_noise
    assert source.rate_hz == 20.0
    assert source.joint_map.source_joints == JOINTS
    assert source.recording.config == "a: 1"
    played = _all(source)
    assert len(played) == len(scenes) == 61
    for (due, scene), twin in zip(played, scenes, strict=True):
        assert scene.stamp_ns == twin.stamp_ns + 700
        assert due == scene.stamp_ns + 3_000_000  # as late as it was received
        assert (scene.sequence, scene.sees_room) == (twin.sequence, twin.sees_room)
        for p, q in zip(scene.people, twin.people, strict=True):
            np.testing.assert_array_equal(p.positions, q.positions)
            np.testing.assert_array_equal(p.observed, q.observed)
    link, received = source.received[4]
    assert (link, received.message.counter) == ("can", 4)
    assert received.received_ns == played[4][1].stamp_ns + 1


def test_blind_scenes_many_people_and_a_source_clock_of_its_own(tmp_path: Path) -> None:
    joint_map = load_joint_map("canonical")
    epoch = 1_700_000_000_000_000_000
    rng = np.random.default_rng(0)

    def person(i: int) -> Person:
        return Person(i, rng.normal(size=(21, 3)), np.ones(21, dtype=bool))

    recorded = [
        Scene(epoch, 5, True, (person(3), person(40000))),
        Scene(epoch + 10_000_000, 6, False, ()),
        Scene(epoch + 30_000_000, 9, True, (person(40000),)),  # two were lost
        Scene(epoch + 20_000_000, 8, True, ()),  # out of order
    ]
    arrivals = [100, 12_000_000, 33_000_000, 34_000_000]
    path = tmp_path / "a.mcap"
    with Recorder(
        path,
        RecordingInfo(joint_map=joint_map, rate_hz=100.0, declares_noise=False),
        threaded=False,
    ) as recorder:
        for scene, arrival in zip(recorded, arrivals, strict=True):
            recorder.on_scene(scene, arrival)
    source = _source(path)
    played = _all(source)
    assert [due - START for due, _ in played] == [a - 100 for a in arrivals]
    assert [s.sequence for _, s in played] == [5, 6, 9, 8]
    assert [s.sees_room for _, s in played] == [True, False, True, True]
    assert [[p.id for p in s.people] for _, s in played] == [[3, 40000], [], [40000], []]
    shifts = {s.stamp_ns - r.stamp_ns for (_, s), r in zip(played, recorded, strict=True)}
    assert shifts == {START - 100}  # captures keep their distance from the arrivals
    assert set(source.truth(START)) == {3, 40000}
    with pytest.raises(ConfigError, match="as it was received"):
        _source(path, rate_hz=10.0)


def test_a_cut_recording_plays_up_to_the_cut_and_says_so(tmp_path: Path, caplog) -> None:
    settings = {"kind": "procedural", "rate_hz": 60.0, "noise_m": 0.01}
    original = ProceduralSource(validated(ProceduralSettings, settings, "source"))
    scenes = _recorded(tmp_path / "a.mcap", original, 10.0)
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(data[: len(data) // 2])
    played = _all(_source(tmp_path / "a.mcap"))
    assert 0.2 * len(scenes) < len(played) < 0.8 * len(scenes)
    assert "cut or damaged after" in caplog.text


def test_room_from_source_is_not_applied_twice_to_a_recording_of_the_room(tmp_path: Path) -> None:
    settings = {"kind": "procedural", "rate_hz": 10.0}
    original = ProceduralSource(validated(ProceduralSettings, settings, "source"))
    scenes = _recorded(tmp_path / "a.mcap", original, 2.0)
    first = next(s for s in scenes if s.people)
    pose = {"xyz": [5, 5, 5]}
    again = _source(tmp_path / "a.mcap", room_from_source=pose)
    played = next(s for _, s in _all(again) if s.people)
    np.testing.assert_array_equal(played.people[0].positions, first.people[0].positions)


POSE = {"xyz": [1.0, 2.0, 0.5], "quaternion_xyzw": [0.0, 0.0, 0.7071068, 0.7071068]}


def _table(path: Path, scale: float = 1.0) -> Path:
    """A person of 1.75 m who stands; all coordinates are multiplied by ``scale``."""
    body = Body(1.75)
    joints = body.joints(body.standing(np.array([2.0, 0.0]), 0.0)) * scale
    header = ",".join(f"{joint}_{c}" for joint in JOINTS for c in "xyz")
    cells = ",".join(f"{v:.6f}" for v in joints.ravel())
    lines = [f"time_s,{header}", *(f"{k / 30:.5f},{cells}" for k in range(5))]
    path.write_text("\n".join(lines))
    return path


def test_what_convert_made_of_a_motion_file_is_placed_as_that_file(tmp_path: Path, caplog) -> None:
    table, converted = _table(tmp_path / "a.csv"), tmp_path / "a.mcap"
    write_recording(open_recording(table), converted, "mcap")
    for pose in ({}, POSE):
        expected = _all(_source(table, room_from_source=pose))
        found = _all(_source(converted, room_from_source=pose))
        for (_, one), (_, other) in zip(expected, found, strict=True):
            np.testing.assert_allclose(
                one.people[0].positions, other.people[0].positions, atol=1e-9
            )  # 64-bit floats of a few metres, written whole
    write_recording(open_recording(converted), tmp_path / "again.mcap", "mcap")
    assert not open_recording(tmp_path / "again.mcap").in_room
    assert "no effect" not in caplog.text


@pytest.mark.parametrize(("recorded", "said"), [("", True), ("other", True), ("same", False)])
def test_a_pose_without_effect_on_a_recording_of_the_room_is_said(
    tmp_path: Path, caplog, recorded: str, said: bool
) -> None:
    texts = {"same": yaml.safe_dump({"source": {"room_from_source": POSE}}), "other": "source: {}"}
    made = open_recording(_table(tmp_path / "a.csv"))
    made = replace(made, in_room=True, config=texts.get(recorded, ""))
    write_recording(made, tmp_path / "a.mcap", "mcap")
    source = _source(tmp_path / "a.mcap", room_from_source=POSE)
    assert source.recording.in_room
    assert ("source.room_from_source has no effect" in caplog.text) == said


def test_people_who_are_not_of_human_size_are_refused_with_the_unit(tmp_path: Path) -> None:
    path = _table(tmp_path / "a.csv", 1 / 2.54)
    with pytest.raises(RecordingError, match=r"--units 2\.54"):
        _source(path)
    assert _source(path, unit_m=2.54).recording.scenes


@needs_data
@pytest.mark.parametrize(
    "name",
    ["cmu_mocap/test/walking_1", "cmu_mocap/test/soccer_1", "assembly/task1_human1_trial1"],
)
def test_real_recordings_play(name: str) -> None:
    source = _source(DATA / f"{name}.npz", rate_hz=30.0, place=[2.0, 0.0, math.pi])
    found = _all(source)
    assert len(found) > 80
    for _, scene in found:
        (person,) = scene.people
        joints, seen = source.joint_map.map(person.positions, person.observed)
        assert seen.sum() >= 7
        assert np.abs(joints[seen]).max() < 10.0
    first = source.truth(START)[1]
    middle = first[0][first[1]].mean(axis=0)
    assert np.hypot(*(middle[:2] - [2.0, 0.0])) < 0.5
