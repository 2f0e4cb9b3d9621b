"""A recording as a bag of ROS 2 keeps people exactly, and what the node said; others read it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.scene import Person
from hri_predict.protocol.ros.bodies import IDS_PER_BODY, MARKER_ARRAY, MAX_PEOPLE
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import write_recording
from hri_predict.recording.cutting import between, of_person
from hri_predict.recording.ros.about import ABOUT, MAX_BYTES, PEOPLE, STRING, is_in_room
from hri_predict.recording.ros.writing import full_speed

pytest.importorskip("rosbags", reason="needs the extra bags")
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from hri_predict.protocol.ros.cdr import string
from hri_predict.recording.mcap.messages import read_messages
from hri_predict.recording.ros.topics import topics_of
from hri_predict.run.session import Options, run
from hri_sim.baseline_demo import baseline_demo
from tests.hri_predict.recording.test_round_trips import made

STORAGES = {"rosbag2": ".mcap", "rosbag2-sqlite": ".db3"}
AT = "/recorded/hri/robot_0"


def bag_of(recording: Recording, folder: Path, to: str = "rosbag2") -> Path:
    path = folder / f"bag{STORAGES[to]}"
    write_recording(recording, path, to, force=True)
    return path


def contents(path: Path) -> dict[str, list]:
    """Topic -> decoded messages, by rosbags alone."""
    store = get_typestore(Stores.ROS2_JAZZY)
    found: dict[str, list] = {}
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


@pytest.fixture(scope="module")
def node_recording(tmp_path_factory) -> Path:
    """The demo's person enters and walks up to the robot, without a network, on a virtual clock."""
    path = tmp_path_factory.mktemp("node") / "cell.mcap"
    run(baseline_demo(), Options(factor=None, duration_s=7.0, record=path))
    return path


@pytest.mark.parametrize("to", STORAGES)
@pytest.mark.long
def test_a_recording_of_the_node_replays_from_a_bag_as_from_itself(tmp_path, node_recording, to):
    own = open_recording(node_recording)
    bag = bag_of(own, tmp_path, to)
    again = open_recording(bag)
    assert is_in_room(bag)
    assert (again.kind, again.in_room, again.config) == ("rosbag", True, own.config)
    assert again.joint_map.source_joints == own.joint_map.source_joints
    np.testing.assert_array_equal(again.joint_map.weights, own.joint_map.weights)
    assert len(again.scenes) == len(own.scenes)
    for a, b in zip(own.scenes, again.scenes, strict=True):
        assert b.stamp_ns == a.stamp_ns - own.scenes[0].stamp_ns
        assert [p.id for p in b.people] == [p.id for p in a.people]
        for p, q in zip(a.people, b.people, strict=True):
            np.testing.assert_array_equal(q.positions[q.observed], p.positions[p.observed])
            np.testing.assert_array_equal(q.observed, p.observed)


@pytest.mark.parametrize("to", STORAGES)
def test_what_the_node_said_is_in_the_bag_as_the_link_says_it(tmp_path, node_recording, to):
    found = contents(bag_of(open_recording(node_recording), tmp_path, to))
    told = [m.data for m in read_messages(node_recording, ["/advice"])]
    assert [json.loads(m.data)["level"] for m in found[f"{AT}/advice"]] == [
        each["level"].lower() for each in told
    ]
    fractions = [m.data for m in found[f"{AT}/speed_fraction"]]
    limits = [each["speed_limit_m_s"] or 0.0 for each in told]
    full = 1.0  # the demo's max_speed_m_s
    moves = [each["level"] in ("CLEAR", "WARN", "SLOW") for each in told]
    assert fractions == [
        min(1.0, v / full) if m else 0.0 for v, m in zip(limits, moves, strict=True)
    ]
    assert max(fractions) > 0
    assert [m.data for m in found[f"{AT}/speed_ovr"]] == [int(100 * f) for f in fractions]
    zones = [m.data for m in read_messages(node_recording, ["/zones"])]
    first = zones[0]["capsules"][0][0][0]
    sphere = found["/recorded/hri/zones"][0].markers[1]
    assert [[p.x, p.y, p.z] for p in sphere.points] == [first[:3], first[3:6]]
    assert sphere.scale.x == 2 * first[6]
    forecast = next(read_messages(node_recording, ["/forecast"])).data
    poses = found["/recorded/hri/forecast"][0].poses
    assert [[p.position.x, p.position.y, p.position.z] for p in poses] == forecast["positions"][0][
        0
    ]
    assert {"/recorded/hri/forecast_markers", "/recorded/diagnostics"} <= set(found)


def test_a_bag_that_is_played_reaches_no_robot(tmp_path, node_recording):
    """A recorded *clear* on a topic of the link would be advice to a robot that listens."""
    found = contents(bag_of(open_recording(node_recording), tmp_path))
    assert all(topic.startswith("/recorded/") for topic in found)
    assert not any("frames" in topic for topic in found)


def test_a_part_holds_what_was_said_in_it_and_one_person_nothing(tmp_path, node_recording):
    own = open_recording(node_recording)
    half_s = own.duration_s / 2
    part = contents(bag_of(between(own, 0.0, half_s), tmp_path))
    whole = len(list(read_messages(node_recording, ["/advice"])))
    assert 0 < len(part[f"{AT}/advice"]) < whole
    last_ns = own.arrival_ns[0] + round(half_s * 1e9)
    said = [m for m in read_messages(node_recording, ["/advice"]) if m.node_ns <= last_ns]
    begun = [m for m in said if m.node_ns >= own.arrival_ns[0]]
    assert len(part[f"{AT}/advice"]) in (len(said), len(begun))
    (number,) = {p.id for scene in own.scenes for p in scene.people}
    alone, _ = of_person(own, number)
    assert set(contents(bag_of(alone, tmp_path))) == {ABOUT, PEOPLE}


def blind_and_unseen() -> Recording:
    """A person, an empty room, a blind source, and a person without any seen joint."""
    recording = made(["waist", "head"], ids=(3,), frames=5, missing=0)
    scenes = list(recording.scenes)
    scenes[1] = replace(scenes[1], people=())
    scenes[2] = replace(scenes[2], people=(), sees_room=False)
    unseen = Person(3, np.full((2, 3), np.nan), np.zeros(2, np.bool_))
    scenes[3] = replace(scenes[3], people=(unseen,))
    return replace(recording, scenes=scenes)


@pytest.mark.parametrize("to", STORAGES)
def test_a_blind_source_is_a_gap_and_an_unseen_person_stays(tmp_path, to):
    recording = blind_and_unseen()
    path = tmp_path / f"bag{STORAGES[to]}"
    written = write_recording(recording, path, to)
    assert written.dropped == {"scenes of a source that did not see the room: gaps": 1}
    again = open_recording(path, any_joints=True)
    kept = [k for k in range(5) if k != 2]
    assert [s.stamp_ns for s in again.scenes] == [recording.scenes[k].stamp_ns for k in kept]
    seen = [[(p.id, bool(p.observed.any())) for p in s.people] for s in again.scenes]
    assert seen == [[(3, True)], [], [(3, False)], [(3, False)]]


def test_topics_names_the_people_alone(tmp_path, node_recording):
    (only,) = topics_of(bag_of(open_recording(node_recording), tmp_path))
    assert (only.name, only.kind, only.is_named) == (PEOPLE, MARKER_ARRAY, True)


def test_what_a_bag_cannot_hold_is_refused(tmp_path):
    joints = made([f"j{k}k" for k in range(IDS_PER_BODY + 1)])
    with pytest.raises(RecordingError, match="has 101 joints, and a bag's bodies have at most 100"):
        write_recording(joints, tmp_path / "a.mcap", "rosbag2")
    crowd = made(["waist"], ids=tuple(range(MAX_PEOPLE + 1)))
    with pytest.raises(RecordingError, match=r"a scene with 65 people.*--person"):
        write_recording(crowd, tmp_path / "a.mcap", "rosbag2")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "said", ["", "{", "[]", '{"format": "9"}', '{"format": "2"}', " " * (MAX_BYTES + 1)]
)
def test_a_damaged_description_is_one_line(tmp_path, said):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        about = writer.add_connection(ABOUT, STRING, typestore=store)
        people = writer.add_connection(PEOPLE, MARKER_ARRAY, typestore=store)
        writer.write(about, 1, string(said))
        writer.write(people, 2, b"\x00\x01\x00\x00" + bytes(4))
    with pytest.raises(RecordingError, match=rf"the message on {ABOUT}") as caught:
        open_recording(tmp_path / "bag")
    assert "\n" not in str(caught.value)


def test_merged_bags_of_several_recordings_are_refused(tmp_path):
    """The people of both would be on one topic, with the joints and the frame of the first."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        about = writer.add_connection(ABOUT, STRING, typestore=store)
        people = writer.add_connection(PEOPLE, MARKER_ARRAY, typestore=store)
        for at_ns, said in enumerate(['{"format": "2"}', '{"format": "3"}']):
            writer.write(about, at_ns, string(said))
        writer.write(people, 2, b"\x00\x01\x00\x00" + bytes(4))
    with pytest.raises(RecordingError, match=rf"messages on {ABOUT} differ: .* replay each alone"):
        open_recording(tmp_path / "bag")


def test_a_damaged_index_that_hides_messages_is_refused(tmp_path):
    path = bag_of(made(["waist", "head"], missing=0), tmp_path)
    with Reader(path) as reader:
        last_ns = max(at_ns for _, at_ns, _ in reader.messages())
    data = path.read_bytes()
    of_statistics = data.rindex(last_ns.to_bytes(8, "little"))
    of_chunk = data.rindex(last_ns.to_bytes(8, "little"), 0, of_statistics)
    path.write_bytes(data[:of_chunk] + (last_ns - 1).to_bytes(8, "little") + data[of_chunk + 8 :])
    with pytest.raises(RecordingError, match=r"not a whole bag: \d+ of \d+ messages can be read"):
        open_recording(path, any_joints=True)


def test_scenes_of_a_motion_file_stay_in_its_own_frame(tmp_path):
    path = bag_of(made(["waist", "head"], missing=0), tmp_path)
    (first, *_) = contents(path)[PEOPLE]
    assert {m.header.frame_id for m in first.markers} == {"recording"}
    again = open_recording(path, any_joints=True)
    assert not again.in_room
    assert not again.utc_ns


@pytest.mark.parametrize(
    ("config", "speed"),
    [
        ("robots: [{max_speed_m_s: 1.5}, {max_speed_m_s: 2}]", 2.0),
        ("robots: [{max_speed_m_s: 2}]\nlinks: [{kind: ros2, full_speed_m_s: 0.5}]", 0.5),
        ("robots: [{max_speed_m_s: fast}]", None),
        ("robots: 7", None),
        ("{", None),
        ("", None),
    ],
)
def test_fractions_are_of_the_links_speed_or_of_the_fastest_robots(config, speed):
    assert full_speed(config) == speed


@pytest.mark.long
def test_mcap_ros2_support_reads_it_and_we_read_what_it_writes(tmp_path, node_recording):
    """An implementation of MCAP's ROS 2 profile that shares nothing with rosbags."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="needs mcap-ros2-support")
    from mcap_ros2.writer import Writer

    own = open_recording(node_recording)
    found: dict[str, list] = {}
    for message in reader.read_ros2_messages(str(bag_of(own, tmp_path))):
        found.setdefault(message.channel.topic, []).append(message)
    assert len(found[PEOPLE]) == len(own.scenes)
    person = own.scenes[-1].people[0]
    places = [m.pose.position for m in found[PEOPLE][-1].ros_msg.markers]
    np.testing.assert_array_equal(
        [[p.x, p.y, p.z] for p in places], person.positions[person.observed]
    )

    definition, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(MARKER_ARRAY, ros_version=2)
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef(MARKER_ARRAY, definition)
        for message in found[PEOPLE]:
            ns = message.log_time_ns
            writer.write_message("/bodies", schema, message.ros_msg, ns, ns)
        writer.finish()
    again = open_recording(path, joint_map=own.joint_map)
    for a, b in zip(own.scenes, again.scenes, strict=True):
        for p, q in zip(a.people, b.people, strict=True):
            assert p.id == q.id
            np.testing.assert_array_equal(q.positions[p.observed], p.positions[p.observed])


def test_rclpy_reads_the_people(tmp_path, node_recording):
    pytest.importorskip("rclpy", reason="needs ROS 2: the extra ros2")
    from rclpy.serialization import deserialize_message
    from visualization_msgs.msg import MarkerArray

    own = open_recording(node_recording)
    with Reader(bag_of(own, tmp_path)) as bag:
        people = [c for c in bag.connections if c.topic == PEOPLE]
        data = [raw for _, _, raw in bag.messages(people)]
    for scene, raw in zip(own.scenes, data, strict=True):
        markers = deserialize_message(raw, MarkerArray).markers
        assert {m.id // IDS_PER_BODY for m in markers} == {p.id for p in scene.people}
        places = [(m.pose.position.x, m.pose.position.y, m.pose.position.z) for m in markers]
        seen = [p.positions[p.observed] for p in scene.people]
        np.testing.assert_array_equal(
            np.array(places).reshape(-1, 3), np.vstack([*seen, np.empty((0, 3))])
        )
