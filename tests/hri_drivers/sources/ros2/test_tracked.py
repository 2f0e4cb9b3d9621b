"""ROS4HRI by real nodes in other processes: people whose frames are in a live ``/tf``."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
pytest.importorskip("rosbags", reason="needs the extra bags")

from hri_drivers.wires.ros2 import JAZZY

pytestmark = [
    pytest.mark.long,
    pytest.mark.realtime,
    pytest.mark.timeout(900),  # the messages are built by a compiler, once
    pytest.mark.usefixtures("other_messages"),
]
CAMERA_FRAME = Path(__file__).with_name("camera_frame.py")
TOPIC = "/humans/bodies/tracked"


@pytest.fixture
def listen(hear, domain: int):
    def opened(**settings):
        given = {
            "topics": [TOPIC], "message": "ros4hri", "joint_map": "ros4hri", "frame": "map",
            "sees_room": True, "domain_id": domain, "rate_hz": 30,
        }  # fmt: skip
        return hear("ros2", **(given | settings))

    return opened


@pytest.fixture
def bodies(publish):
    def start(**options):
        return publish(message="ros4hri", topic=TOPIC, **options)

    return start


def test_people_are_heard_with_the_places_of_their_frames(listen, bodies):
    ear = listen()
    bodies(people=2)
    scenes = ear.scenes(40)[10:]
    assert all(scene.sees_room and len(scene.people) == 2 for scene in scenes)
    for scene in scenes:
        assert all(person.observed.all() for person in scene.people)
    assert {tuple(p.id for p in scene.people) for scene in scenes} == {(1, 2)}
    body, head = scenes[-1].people[1].positions[:2]
    assert body[:2] == pytest.approx([2.0, 1.5], abs=0.04)  # sways by 23 mm; 2 mm of noise
    assert head[2] - body[2] == pytest.approx(1.65 - 0.95, abs=0.02)


def test_a_frame_of_the_room_above_the_trackers(listen, bodies, publish):
    """The list and the frames are in ``camera``; a node of its own places that in ``map``."""
    ear = listen()
    bodies(frame="camera")
    publish(program=CAMERA_FRAME)
    ear.wait(lambda: any(p.observed.all() for s in ear.scenes(1) for p in s.people))
    (scene,) = ear.scenes(1)
    assert scene.people[0].positions[0][2] == pytest.approx(0.95 + 2.5, abs=0.03)


def test_frames_that_stop_take_the_place_away_although_the_list_goes_on(listen, bodies):
    ear = listen()
    frames = bodies(part="frames")
    bodies(part="list")
    ear.wait(lambda: any(p.observed.all() for s in ear.scenes(1) for p in s.people))
    frames.send_signal(signal.SIGSTOP)
    ear.wait(lambda: "body 'p0' has no place" in (ear.counters.last_error or ""))
    while ear.source.poll(time.monotonic_ns()) is not None:
        pass
    refused = ear.counters.malformed
    ear.wait(lambda: ear.counters.malformed > refused + 20)
    assert ear.source.poll(time.monotonic_ns()) is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"prefix": "human_"}, "body 'p0' has no place: no transform connects 'body_p0' to 'map'"),
        ({"frame": "lidar"}, "body 'p0' has no place: no transform connects 'body_p0' to 'map'"),
        ({"part": "list"}, "body 'p0' has no place: no transform connects 'body_p0' to 'map'"),
        ({"clock": "zero"}, f"{TOPIC}: header.stamp is zero"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(listen, bodies, options, words):
    ear = listen()
    bodies(**options)
    ear.wait(lambda: words in (ear.counters.last_error or ""))
    assert ear.source.poll(time.monotonic_ns()) is None


@pytest.mark.skipif(JAZZY, reason="rclpy of Jazzy does not state which publisher a message is from")
def test_two_publishers_of_the_frames_are_both_not_believed(listen, bodies):
    ear = listen()
    bodies()
    ear.scenes(10)
    bodies(part="frames", left=1.0)
    ear.wait(lambda: "two publishers give the transform" in (ear.counters.last_error or ""))
    while ear.source.poll(time.monotonic_ns()) is not None:
        pass
    refused = ear.counters.malformed
    ear.wait(lambda: ear.counters.malformed > refused + 20)
    assert ear.source.poll(time.monotonic_ns()) is None


def test_two_trackers_are_both_not_believed(listen, bodies):
    ear = listen()
    bodies()
    ear.scenes(10)
    bodies(people=0)
    ear.wait(lambda: "two publishers; stop one" in (ear.counters.last_error or ""))
    ear.scenes(5)
    assert not any(scene.sees_room or scene.people for scene in ear.scenes(20))


def test_a_tracker_that_is_restarted_with_earlier_stamps(listen, bodies):
    ear = listen()
    first = bodies(clock="sim", shift=1000)
    ear.scenes(10)
    first.send_signal(signal.SIGKILL)
    first.wait()
    time.sleep(1.2)  # longer than two publishers contradict each other
    while ear.source.poll(time.monotonic_ns()) is not None:
        pass
    bodies(clock="sim")
    ear.wait(lambda: any(p.observed.all() for s in ear.scenes(1) for p in s.people))
    assert ear.counters.restarts == 1


@pytest.mark.parametrize("people", [1, 4])
def test_a_scene_is_there_soon_after_its_stamp(listen, bodies, people):
    ear = listen()
    bodies(people=people)
    late_ms: list[float] = []
    end_s = time.monotonic() + 30
    while len(late_ms) < 300 and time.monotonic() < end_s:
        ear.source.arrived.wait(1.0)
        ear.source.arrived.clear()
        while (scene := ear.source.poll(time.monotonic_ns())) is not None:
            late_ms.append((time.time_ns() - scene.stamp_ns) * 1e-6)
    p50, p99 = np.percentile(late_ms[30:], [50, 99])
    print(f"\nros4hri of {people}: p50 {p50:.2f} ms, p99 {p99:.1f} ms; {ear.counters.lost} lost")
    assert people > 1 or p50 < 100  # three periods; four keep the publisher busy
