"""ZED's bodies by real nodes in other processes."""

import time

import pytest

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
pytest.importorskip("rosbags", reason="needs the extra bags")
pytestmark = [
    pytest.mark.long,
    pytest.mark.realtime,
    pytest.mark.timeout(900),  # the messages are built by a compiler, once
    pytest.mark.usefixtures("other_messages"),
]
TOPIC = "/zed/zed_node/body_trk/skeletons"


@pytest.fixture
def listen(hear, domain: int):
    def opened(**settings):
        given = {
            "topics": [TOPIC], "message": "zed", "joint_map": "zed34", "frame": "map",
            "sees_room": True, "domain_id": domain, "rate_hz": 30,
        }  # fmt: skip
        return hear("ros2", **(given | settings))

    return opened


@pytest.fixture
def bodies(publish):
    def start(**options):
        return publish(message="zed", topic=TOPIC, **options)

    return start


def test_bodies_are_heard_with_the_places_of_their_keypoints(listen, bodies):
    ear = listen()
    bodies(people=2)
    scenes = ear.scenes(20)
    assert all(scene.sees_room and [p.id for p in scene.people] == [0, 1] for scene in scenes)
    pelvis = scenes[-1].people[1].positions[0]
    assert pelvis[:2] == pytest.approx([2.0, 1.5], abs=0.04)  # sways by 23 mm; 2 mm of noise
    head, clavicle = scenes[-1].people[0].observed[[26, 4]]
    assert (head, clavicle) == (True, False)
    assert ear.counters.malformed == 0


def test_bodies_that_the_camera_does_not_see_are_there_without_a_place(listen, bodies):
    ear = listen()
    bodies(tracking_state=2)
    for scene in ear.scenes(5):
        assert len(scene.people) == 1
        assert not scene.people[0].observed.any()


@pytest.mark.parametrize(
    ("options", "settings", "words"),
    [
        ({"frame": "zed_left"}, {}, "frame_id 'zed_left' is not 'map': no transform connects"),
        ({}, {"joint_map": "zed38"}, "body_format 1 has 34 keypoints, and the joint map 38"),
        ({"clock": "zero"}, {}, f"{TOPIC}: header.stamp is zero"),
        ({"topic": "/obj_det"}, {}, "available: /obj_det (ObjectsStamped)"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(listen, publish, options, settings, words):
    ear = listen(**settings)
    publish(**({"message": "zed", "topic": TOPIC} | options))
    ear.wait(lambda: words in (ear.counters.last_error or ""))
    assert ear.source.poll(time.monotonic_ns()) is None


def test_two_wrappers_on_a_topic_are_both_not_believed(listen, bodies):
    ear = listen()
    bodies()
    ear.scenes(5)
    bodies(people=0)
    ear.wait(lambda: "two publishers; stop one" in (ear.counters.last_error or ""))
    ear.scenes(5)
    assert not any(scene.sees_room or scene.people for scene in ear.scenes(20))
