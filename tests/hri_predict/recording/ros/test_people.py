"""Bags that rosbags' writers wrote are recordings: people, times, frames, what is refused."""

import random
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.protocol.ros.bodies import MARKER_ARRAY, POSE_ARRAY
from hri_predict.protocol.ros.messages import TF_MESSAGE
from hri_predict.protocol.ros.tracked import IDS_LIST
from hri_predict.protocol.ros.zed import OBJECTS, OBJECTS_BEFORE
from hri_predict.recording import open_recording
from hri_predict.recording.converting import write_recording
from hri_predict.recording.ros.bag import file_of, is_ros_mcap
from hri_predict.recording.ros.topics import topics_of

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_drivers.sources.scene_streaming import hri_sender
from tests.hri_predict.protocol.ros.sent import UPRIGHT
from tests.hri_predict.recording.ros.bags import KINDS, maker, write
from tests.hri_predict.recording.test_mutated import mutated

MS, S = 10**6, 10**9
UTC = 1_790_000_000 * S
CANONICAL = load_joint_map("canonical")


def standing(seconds, away=0.0):
    """(21, 3) of a person who sways."""
    return np.array(hri_sender().swaying(seconds, (2.0, away)))


def walk(kind, count=20, topic="/people", frame="map", stamps=True, period_ns=40 * MS):
    """A person at 25 Hz, each message received 5 ms after its stamp."""
    made = maker(kind)
    for k in range(count):
        at_ns = UTC + k * period_ns
        message = made.poses(standing(k * 0.04), frame, at_ns if stamps else 0)
        yield topic, POSE_ARRAY, message, at_ns + 5 * MS


def read(path, **options):
    return open_recording(path, joint_map=CANONICAL, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_people_places_and_times_are_those_of_the_bag(tmp_path, kind):
    recording = read(write(tmp_path, kind, walk(kind)))
    assert (recording.kind, recording.rate_hz, len(recording.scenes)) == ("rosbag", 25.0, 20)
    assert [scene.stamp_ns for scene in recording.scenes] == [k * 40 * MS for k in range(20)]
    assert recording.utc_ns[3] == UTC + 120 * MS
    (person,) = recording.scenes[7].people
    np.testing.assert_array_equal(person.positions, standing(7 * 0.04))
    assert recording.joint_map.mapped.all()
    assert recording.note == "positions are in the frame 'map'"


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_converted_and_read_back(tmp_path, kind):
    recording = read(write(tmp_path, kind, walk(kind)))
    write_recording(recording, tmp_path / "out.csv", "csv")
    again = open_recording(tmp_path / "out.csv")
    np.testing.assert_allclose(
        again.scenes[7].people[0].positions, standing(7 * 0.04), atol=5.1e-7
    )  # six digits


@pytest.mark.parametrize("kind", KINDS)
def test_several_people_by_markers_of_a_camera_in_the_room(tmp_path, kind):
    made = maker(kind)
    edge = ("camera_base", "depth_camera_link", (0.0, 0.0, 1.0), UPRIGHT)
    messages = [("/tf_static", TF_MESSAGE, made.transforms(edge), UTC + S)]  # after the first
    for k in range(5):
        at_ns = UTC + k * 33 * MS
        bodies = {3: standing(0.0), 8: standing(0.0, 1.5)} if k else {}
        message = made.markers(bodies, "depth_camera_link", at_ns)
        messages.append(("/body_tracking_data", MARKER_ARRAY, message, at_ns + MS))
    recording = read(write(tmp_path, kind, sorted(messages, key=lambda m: m[3])))
    assert [[p.id for p in s.people] for s in recording.scenes] == [[]] + 4 * [[3, 8]]
    assert [s.stamp_ns for s in recording.scenes] == [k * 33 * MS for k in range(5)]
    raised = recording.scenes[1].people[1].positions
    np.testing.assert_allclose(raised, standing(0.0, 1.5) + np.array([0, 0, 1]), atol=1e-12)
    assert "frame 'camera_base'" in recording.note


def test_a_camera_that_moves_is_placed_by_its_transforms_before_and_after(tmp_path):
    made = maker("mcap")
    messages = list(walk("mcap", frame="camera"))
    for k in range(-1, 11):
        at_ns = UTC + k * 100 * MS
        edge = ("odom", "camera", (k * 0.1, 0.0, 0.0), UPRIGHT)
        messages.append(("/tf", TF_MESSAGE, made.transforms(edge, at_ns=at_ns), at_ns + 50 * MS))
    recording = read(write(tmp_path, "mcap", sorted(messages, key=lambda m: m[3])))
    assert len(recording.scenes) == 20
    moved = recording.scenes[7].people[0].positions
    np.testing.assert_allclose(moved, standing(0.28) + np.array([0.28, 0, 0]), atol=1e-12)


FRAMES = {"body": "waist"} | {
    name: name for name in load_joint_map("ros4hri").source_joints if name != "body"
}


def tracked(kind):
    """A body of ROS4HRI that sways, below a camera 1 m up."""
    made = maker(kind)
    edge = ("map", "camera", (0.0, 0.0, 1.0), UPRIGHT)
    yield "/tf_static", TF_MESSAGE, made.transforms(edge), UTC
    for k in range(20):
        at_ns = UTC + k * 40 * MS
        points = dict(zip(CANONICAL.source_joints, standing(k * 0.04), strict=True))
        places = {frame: points[joint] for frame, joint in FRAMES.items()}
        yield "/humans/bodies/tracked", IDS_LIST, made.tracked("abc", at_ns=at_ns), at_ns + MS
        yield "/tf", TF_MESSAGE, made.body("abc", places, at_ns), at_ns + 2 * MS


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_bodies_of_ros4hri_are_placed_by_their_frames(tmp_path, kind):
    path = write(tmp_path, kind, tracked(kind))
    recording = open_recording(path, joint_map=load_joint_map("ros4hri"))
    assert len(recording.scenes) == 20
    (person,) = recording.scenes[7].people
    waist = standing(7 * 0.04)[0] + np.array([0, 0, 1.0])
    np.testing.assert_allclose(person.positions[0], waist, atol=1e-12)
    assert person.observed.all()
    (topic,) = topics_of(file_of(path))
    assert (topic.frame, topic.joint_maps) == ("body_abc", ("ros4hri",))
    assert "frame 'map'" in recording.note


def test_bodies_without_frames_are_left_out_and_counted(tmp_path):
    late = (m for m in tracked("mcap") if m[0] != "/tf" or m[3] > UTC + 200 * MS)
    path = write(tmp_path, "mcap", late)
    recording = open_recording(path, joint_map=load_joint_map("ros4hri"), frame="map")
    assert len(recording.scenes) == 15
    assert "5 messages left out: body 'abc' has no place" in recording.note


@pytest.mark.parametrize("kind", ["mcap", "db3"])
@pytest.mark.parametrize("definition", [OBJECTS, OBJECTS_BEFORE])
def test_bodies_of_a_zed_of_either_definition(tmp_path, kind, definition):
    made = maker(kind)
    points = np.arange(1.0, 55.0).reshape(18, 3) / 64
    messages = []
    for k in range(5):
        at_ns = UTC + k * 33 * MS
        message = made.objects({7: points + k}, "zed_left", at_ns, kind=definition)
        messages.append(("/skeletons", definition, message, at_ns + MS))
    path = write(tmp_path, kind, messages, sent_as={OBJECTS_BEFORE: OBJECTS})
    recording = open_recording(path, joint_map=load_joint_map("zed18"))
    assert [[p.id for p in s.people] for s in recording.scenes] == 5 * [[7]]
    np.testing.assert_allclose(recording.scenes[2].people[0].positions, points + 2, atol=1e-6)
    (topic,) = topics_of(file_of(path))
    assert (topic.joints, topic.frame, topic.joint_maps) == (18, "zed_left", ("zed18",))


def test_people_whose_frame_has_no_transform_are_left_out_and_counted(tmp_path):
    messages = [*walk("mcap", 10), *walk("mcap", 3, frame="lidar")]
    messages.sort(key=lambda m: m[3])
    recording = read(write(tmp_path, "mcap", messages))
    assert len(recording.scenes) == 10
    assert "3 messages left out: frame_id 'lidar' is not 'map'" in recording.note


def test_stamps_of_zero_are_replaced_by_the_receipt(tmp_path):
    recording = read(write(tmp_path, "db3", walk("db3", stamps=False)))
    assert [s.stamp_ns for s in recording.scenes] == [k * 40 * MS for k in range(20)]
    assert "stamps are zero" in recording.note


def test_repeated_messages_are_left_out_and_counted(tmp_path):
    messages = list(walk("db3", 10))
    messages.insert(5, messages[4])
    recording = read(write(tmp_path, "db3", messages))
    assert len(recording.scenes) == 10
    assert "1 messages whose stamps do not rise are left out" in recording.note


def restamped(change, count=60):
    """A walk of which message ``k`` has a stamp later by ``change(k)`` seconds."""
    made = maker("db3")
    for k, (topic, kind, _, at_ns) in enumerate(walk("db3", count)):
        stamp_ns = UTC + k * 40 * MS + round(change(k) * S)
        yield topic, kind, made.poses(standing(k * 0.04), "map", stamp_ns), at_ns


@pytest.mark.parametrize(("k", "by_s"), [(10, 4), (0, 3000), (10, -4), (30, -3000)])
def test_a_wrong_stamp_costs_its_message_alone(tmp_path, k, by_s):
    path = write(tmp_path, "db3", restamped(lambda i: by_s * (i == k)))
    recording = read(path)
    assert len(recording.scenes) == 59
    assert "1 messages whose stamps do not rise are left out" in recording.note


def test_after_a_clock_was_set_back_times_go_on_by_those_of_receipt(tmp_path):
    recording = read(write(tmp_path, "db3", restamped(lambda k: -1000 * (k >= 30))))
    assert [scene.stamp_ns for scene in recording.scenes] == [k * 40 * MS for k in range(60)]
    assert "the clock of the stamps was set back 1 times" in recording.note


def test_single_stamps_of_zero_are_replaced_by_the_receipt(tmp_path):
    path = write(tmp_path, "db3", restamped(lambda k: 0 if k % 3 else -(UTC + k * 40 * MS) / S))
    times = [scene.stamp_ns for scene in read(path).scenes]
    np.testing.assert_allclose(times, [k * 40 * MS for k in range(60)], atol=1000)


def test_stamps_without_any_order_are_refused(tmp_path):
    rng = random.Random(0)
    path = write(tmp_path, "db3", restamped(lambda k: rng.uniform(0, 1000)))
    with pytest.raises(RecordingError, match="of 60 messages do not rise"):
        read(path)


def test_of_two_topics_one_must_be_named(tmp_path):
    both = sorted([*walk("db3", topic="/a"), *walk("db3", topic="/b")], key=lambda m: m[3])
    path = write(tmp_path, "db3", both)
    with pytest.raises(RecordingError, match="2 topics could be people: /a, /b; give --topic"):
        read(path)
    assert len(read(path, topic="/b").scenes) == 20
    with pytest.raises(RecordingError, match=r"no topic /c .*available: /a, /b"):
        read(path, topic="/c")


def test_joints_are_never_guessed(tmp_path):
    path = write(tmp_path, "db3", walk("db3"))
    with pytest.raises(RecordingError, match="does not name its joints; give --joint-map"):
        open_recording(path)


def test_another_number_of_joints_is_said(tmp_path):
    path = write(tmp_path, "db3", walk("db3"))
    with pytest.raises(RecordingError, match="no message that can be used: 21 poses are not"):
        open_recording(path, joint_map=load_joint_map("coco17"))


def test_a_topic_of_a_file_without_topics_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,a_x,a_y,a_z\n0,1,2,3\n0.1,1,2,3\n")
    with pytest.raises(RecordingError, match=": no topics; leave --topic out"):
        open_recording(path, topic="/people")
    path.write_text("time_s,a_x,a_y,a_z\n0,1,2,3\n")
    with pytest.raises(RecordingError, match="has 1 times"):
        open_recording(path, topic="/people")


def test_a_bag_without_people_names_the_types(tmp_path):
    made = maker("db3")
    edge = ("map", "camera", (0.0, 0.0, 0.0), UPRIGHT)
    path = write(tmp_path, "db3", [("/tf", TF_MESSAGE, made.transforms(edge), UTC)])
    with pytest.raises(RecordingError, match=r"no topic can be people \(geometry_msgs/msg/Pose"):
        read(path)


def test_a_folder_of_two_files_is_refused(tmp_path):
    path = write(tmp_path, "db3", walk("db3"))
    (path / "other_1.db3").write_bytes(b"x")
    with pytest.raises(RecordingError, match="was split into 2 files; name one of them"):
        read(path)


def test_a_recording_of_this_node_is_not_a_bag(tmp_path):
    recording = read(write(tmp_path, "mcap", walk("mcap")))
    write_recording(recording, tmp_path / "own.mcap", "mcap")
    assert not is_ros_mcap(tmp_path / "own.mcap")
    assert is_ros_mcap(file_of(tmp_path / "walk"))
    again = open_recording(tmp_path / "own.mcap")
    assert again.kind == "mcap"
    np.testing.assert_array_equal(again.scenes[3].people[0].positions, standing(0.12))


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags_are_read_or_refused_in_one_line(tmp_path: Path, kind):
    whole = file_of(write(tmp_path, kind, walk(kind, 5))).read_bytes()
    rng = random.Random(kind)
    path = tmp_path / f"bad.{kind}"
    said = []
    for _ in range(40):
        path.write_bytes(mutated(whole, rng))
        try:
            read(path)
        except RecordingError as error:
            said.append(str(error))
    assert len(said) > 10
    assert all("\n" not in line and str(path) in line for line in said)
