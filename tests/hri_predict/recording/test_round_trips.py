"""What is written is read back: joints, names, people, times, and what was not observed."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Doubt, Person, Scene
from hri_predict.protocol.reasons import Reason
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import ERRORS, write_recording
from hri_predict.recording.cutting import between, decimated, of_person
from hri_predict.recording.format_table import BY_NAME, FORMATS
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.opening import HEAD_BYTES
from tests.hri_predict.recording.made import of_scenes
from tests.shared import DATA, needs_data

WRITTEN = [kind for kind in BY_NAME if kind != "bvh"]
"""BVH has its own tests: its bones are rigid, and its joints canonical."""
MOST_M = 2e-6
"""Of a float of 32 bits at 20 m; whatever the format, places must not be coarser."""
FINER_M = {"csv": 5.1e-7, "trc": 5.1e-8} | dict.fromkeys(("mcap", "rosbag2", "rosbag2-sqlite"), 0)
"""Formats that promise more: their digits, or floats of 64 bits."""
SEVERAL = ("csv", "trc", "c3d", "mcap", "rosbag2", "rosbag2-sqlite")
"""Formats that promise to hold several people; another one must count those that it drops."""
NAMES = st.lists(
    st.text("abcXYZ 0189_.-", min_size=1, max_size=20).map(lambda s: f"j{s}k"),
    min_size=1,
    max_size=5,
    unique=True,
)


def made(joints, ids=(1,), frames=4, rate_hz=30.0, missing=0.3, seed=0) -> Recording:
    """People at random places; a share of the joints missing, in the last frame all of them.

    The joints of a body are near each other: those that no body reaches count as not seen.
    """
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-20, 20, (frames, len(ids), 1, 3))
    positions = positions + rng.uniform(-0.2, 0.2, (frames, len(ids), len(joints), 3))
    observed = rng.random(positions.shape[:3]) >= missing
    observed[-1] = False
    positions[~observed] = np.nan
    scenes = [
        Scene(
            round(k * 1e9 / rate_hz),
            k,
            True,
            tuple(Person(n, positions[k, p], observed[k, p]) for p, n in enumerate(ids)),
        )
        for k in range(frames)
    ]
    return of_scenes(scenes, map_of_names(joints), rate_hz)


def through(recording: Recording, to: str, folder: Path, **options) -> Recording:
    path = folder / f"out{BY_NAME[to].ending}"
    write_recording(recording, path, to, force=True)
    assert list(folder.glob("*.partial")) == []
    return open_recording(path, any_joints=True, **options)


def check_same(one: Recording, other: Recording, to: str) -> None:
    assert other.rate_hz == pytest.approx(one.rate_hz, rel=1e-6)
    assert len(other.scenes) == len(one.scenes)
    for a, b in zip(one.scenes, other.scenes, strict=True):
        assert b.stamp_ns - other.scenes[0].stamp_ns == pytest.approx(
            a.stamp_ns - one.scenes[0].stamp_ns,
            rel=1e-7,
            abs=2,  # C3D's rate has 24 bits
        )
        assert b.sees_room == a.sees_room
        assert [p.id for p in b.people] == [p.id for p in a.people]
        for p, q in zip(a.people, b.people, strict=True):
            np.testing.assert_array_equal(q.observed, p.observed)
            assert np.isnan(q.positions[~q.observed]).all()
            np.testing.assert_allclose(
                q.positions[q.observed],
                p.positions[p.observed],
                rtol=0,
                atol=FINER_M.get(to, MOST_M),
            )


@pytest.mark.parametrize("to", [kind for kind in WRITTEN if kind != "pack"])
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(names=NAMES, rate_hz=st.sampled_from([1.0, 29.97, 120.0]), seed=st.integers(0, 99))
def test_one_person_with_any_joints(tmp_path, to, names, rate_hz, seed):
    recording = made(names, frames=seed % 5 + 2, rate_hz=rate_hz, seed=seed)
    back = through(recording, to, tmp_path)
    assert back.joint_map.source_joints == tuple(names)
    check_same(recording, back, to)


@pytest.mark.parametrize("to", SEVERAL)
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(ids=st.lists(st.integers(0, 65535), min_size=2, max_size=4, unique=True))
def test_several_people_keep_their_ids(tmp_path, to, ids):
    recording = made(["waist", "head"], ids=sorted(ids))
    check_same(recording, through(recording, to, tmp_path), to)


@pytest.mark.parametrize("to", [kind for kind in WRITTEN if kind not in ("pack", *SEVERAL)])
def test_a_format_of_one_person_counts_the_others(tmp_path, to):
    recording = made(["waist", "head"], ids=(3, 7), missing=0)
    written = write_recording(recording, tmp_path / f"a{BY_NAME[to].ending}", to)
    assert len(written.people) == 2 or written.dropped["other people"] == 1


@pytest.mark.parametrize("to", WRITTEN)
def test_a_format_knows_its_own_files_by_their_content(tmp_path, to):
    joints = load_joint_map("cmu38").source_joints
    path = tmp_path / "a.xyz"
    write_recording(made(joints), path, to)
    found = next(each for each in FORMATS if each.looks(path, path.read_bytes()[:HEAD_BYTES]))
    assert found.ending == BY_NAME[to].ending


@pytest.mark.parametrize("name", ["cmu38", "assembly_arms"])
def test_the_data_packs_own_layouts(tmp_path, name):
    shipped = load_joint_map(name).source_joints
    recording = made(shipped[::-1], missing=0.1)
    back = through(recording, "pack", tmp_path)
    assert back.joint_map.source_joints == shipped
    turned = [
        [p.positions[::-1] for p in scene.people] for scene in recording.scenes
    ]  # the layout has an order of its own
    for k, scene in enumerate(back.scenes):
        np.testing.assert_allclose(scene.people[0].positions, turned[k][0], atol=2e-6)


@needs_data
@pytest.mark.parametrize("to", WRITTEN)
def test_a_real_walk_stays_where_it_was(tmp_path, to):
    walk = open_recording(DATA / "cmu_mocap" / "test" / "walking_1.npz")
    walk = between(walk, 1.0, 1.2)
    back = through(walk, to, tmp_path)
    assert back.joint_map.name == "cmu38"
    check_same(walk, back, to)


def empty_and_blind() -> Recording:
    """Somebody, nobody, a blind source, and another one."""
    recording = made(["waist", "head"], ids=(3, 7), frames=5, missing=0)
    scenes = list(recording.scenes)
    see = [(True, 1), (True, 0), (False, 0), (True, 2), (True, 2)]
    scenes = [
        Scene(s.stamp_ns, s.sequence, sees, s.people[:count])
        for s, (sees, count) in zip(scenes, see, strict=True)
    ]
    return of_scenes(scenes, recording.joint_map, 30.0, arrival_ns=recording.arrival_ns)


@pytest.mark.parametrize("to", ["csv", "mcap"])
def test_nobody_is_not_the_same_as_blind(tmp_path, to):
    check_same(empty_and_blind(), through(empty_and_blind(), to, tmp_path), to)


def with_errors() -> Recording:
    recording = made(["head", "neck"], ids=(1, 2))
    scenes = [
        replace(s, people=tuple(replace(p, error_m=0.1 * p.id * s.sequence) for p in s.people))
        for s in recording.scenes
    ]
    return replace(recording, scenes=scenes)


def test_the_nodes_own_format_holds_errors_of_places(tmp_path):
    back = through(with_errors(), "mcap", tmp_path)
    errors_m = [[p.error_m for p in scene.people] for scene in back.scenes]
    assert errors_m == [[0.1 * n * k for n in (1, 2)] for k in range(4)]


@pytest.mark.parametrize("to", ["csv", "trc", "rosbag2"])
def test_other_formats_count_the_errors_that_they_cannot_hold(tmp_path, to):
    written = write_recording(with_errors(), tmp_path / f"a.{BY_NAME[to].ending}", to)
    assert written.dropped[ERRORS] == 6  # not those of 0


@pytest.mark.parametrize("to", ["trc", "c3d"])
def test_formats_of_markers_alone_never_say_that_nobody_is_there(tmp_path, to):
    recording = empty_and_blind()
    written = write_recording(recording, tmp_path / f"a.{to}", to)
    assert written.dropped["absences of a person"] == 3
    assert written.dropped["scenes of a blind source"] == 1
    back = open_recording(tmp_path / f"a.{to}", any_joints=True)
    seen = [[bool(p.observed.any()) for p in scene.people] for scene in back.scenes]
    assert seen == [[True, False], [False, False], [False, False], [True, True], [False, False]]


def test_of_several_people_a_file_of_one_holds_the_one_who_is_longest_there(tmp_path):
    written = write_recording(empty_and_blind(), tmp_path / "a.npz", "amass")
    assert written.dropped["other people"] == 1
    assert any("3 is written" in note for note in written.notes)


def test_lost_scenes_are_frames_without_joints(tmp_path):
    whole = made(["waist", "head"], frames=6, missing=0)
    kept = [0, 1, 4, 5]
    scenes = [whole.scenes[k] for k in kept]
    times = [whole.arrival_ns[k] for k in kept]
    cut = of_scenes(scenes, whole.joint_map, 30.0, arrival_ns=times, kind="mcap")
    written = write_recording(cut, tmp_path / "a.trc", "trc")
    assert written.frames == 6
    assert any(note.startswith("2 frames are missing") for note in written.notes)
    back = open_recording(tmp_path / "a.trc", any_joints=True)
    seen = [bool(scene.people[0].observed.all()) for scene in back.scenes]
    assert seen == [True, True, False, False, True, False]


def test_a_source_that_is_a_little_faster_than_it_says_loses_no_frame(tmp_path):
    recording = made(["waist", "head"], frames=400, missing=0)
    times = [round(k * 1e9 / 30.3) for k in range(400)]
    scenes = [
        Scene(ns, s.sequence, True, s.people) for ns, s in zip(times, recording.scenes, strict=True)
    ]
    faster = of_scenes(scenes, recording.joint_map, 30.0, arrival_ns=times, kind="mcap")
    written = write_recording(faster, tmp_path / "a.c3d", "c3d")
    assert (written.frames, written.notes) == (400, [])
    assert open_recording(tmp_path / "a.c3d", any_joints=True).rate_hz == pytest.approx(30.3)


def test_frames_are_left_out_never_invented():
    recording = made(["waist", "head"], frames=61, rate_hz=120.0)
    half = decimated(recording, 25.0)
    assert [scene.sequence for scene in half.scenes] == list(range(13))
    for k, scene in enumerate(half.scenes):
        assert abs(scene.stamp_ns * 1e-9 - k / 25.0) <= 0.5 / 120 + 1e-9
    with pytest.raises(RecordingError, match="never invented"):
        decimated(recording, 200.0)


def seen_in(recording, frames):
    """Return the recording with its people in these frames only."""
    scenes = [
        scene if k in frames else replace(scene, people=())
        for k, scene in enumerate(recording.scenes)
    ]
    return replace(recording, scenes=scenes)


@pytest.mark.parametrize("first", [0, 1, 2, 3])
def test_frames_with_people_are_not_the_ones_left_out(first):
    """In every second or fourth frame there is somebody: at a quarter of the rate, in all."""
    recording = made(["waist", "head"], frames=241, rate_hz=120.0, missing=0)
    for step in (2, 4):
        some = decimated(seen_in(recording, range(first, 241, step)), 30.0)
        assert sum(bool(scene.people) for scene in some.scenes) >= len(some.scenes) - 1
        assert [scene.sequence for scene in some.scenes] == list(range(len(some.scenes)))
        times = [scene.stamp_ns for scene in some.scenes]
        assert {round((b - a) * 1e-6) for a, b in pairwise(times[:-1])} <= {33, 34}


@pytest.mark.parametrize("k", [0, 1, 17, 40, 41, 42, 43, 99])
def test_what_dropped_scenes_say_against_a_frame_stays(k):
    doubt = Doubt(Reason.SENSORS_DISAGREE, "sensors a and b")
    whole = made(["waist"], frames=100, rate_hz=100.0)
    scenes = list(whole.scenes)
    scenes[k] = replace(scenes[k], sees_room=False, doubts=(doubt,), joined=((7, 1),))
    found = decimated(replace(whole, scenes=scenes), 25.0)
    (bad,) = [scene for scene in found.scenes if not scene.sees_room]
    assert abs(bad.stamp_ns - scenes[k].stamp_ns) <= 0.03e9  # the last one has none after it
    assert (bad.doubts, bad.joined) == ((doubt,), ((7, 1),))
    assert sum(len(scene.doubts) + len(scene.joined) for scene in found.scenes) == 2


def test_people_who_come_late_change_no_frame():
    recording = made(["waist", "head"], frames=241, rate_hz=120.0, missing=0)
    late = decimated(seen_in(recording, range(150, 241)), 30.0)
    whole = decimated(recording, 30.0)
    assert [s.stamp_ns for s in late.scenes] == [s.stamp_ns for s in whole.scenes]


def test_a_person_who_is_not_there_is_named():
    with pytest.raises(RecordingError, match="no person 9; it has 3, 7"):
        of_person(empty_and_blind(), 9)


@pytest.mark.parametrize("to", SEVERAL)
def test_scenes_that_were_received_together_stay_two(tmp_path, to):
    """As after a delay on the network, of a source whose clock is not the node's."""
    arrival_s = (0, 0, 1, 1, 2, 3)
    recording = replace(made(["a"], frames=6, missing=0), arrival_ns=[s * 10**9 for s in arrival_s])
    found = through(recording, to, tmp_path)
    assert sum(scene.people[0].observed.any() for scene in found.scenes) == 5
