"""The source against real ROS 2 nodes in other processes; each test has a domain of its own."""

import signal
import time

import pytest

from hri_predict.base.errors import SourceError

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
pytest.importorskip("rosbags", reason="needs the extra bags")
pytestmark = [pytest.mark.long, pytest.mark.realtime]


@pytest.fixture
def listen(hear, domain: int):
    """Opens a source in the test's domain."""

    def opened(**settings):
        given = {
            "topics": ["/people"], "frame": "map", "sees_room": True, "domain_id": domain,
            "rate_hz": 30,
        }  # fmt: skip
        return hear("ros2", **(given | settings))

    return opened


def last_error(ear, words: str) -> None:
    ear.wait(lambda: words in (ear.counters.last_error or ""))


def test_people_are_heard_with_their_places(listen, publish):
    ear = listen()
    publish(people=2)
    scenes = ear.scenes(30)
    assert all(scene.sees_room and len(scene.people) == 2 for scene in scenes)
    stamps = [scene.stamp_ns for scene in scenes]
    assert stamps == sorted(stamps)
    waist = scenes[-1].people[1].positions[0]
    assert waist[:2] == pytest.approx([2.0, 1.5], abs=0.04)  # sways by 23 mm; 2 mm of noise
    assert ear.source.stamps_utc
    assert ear.counters.malformed == 0


def test_markers_are_heard(listen, publish):
    ear = listen(message="marker_array")
    publish(message="marker_array", best_effort=True)
    (scene, *_) = ear.scenes(5)
    assert [person.id for person in scene.people] == [1]
    assert scene.people[0].observed.all()


def test_a_publisher_that_is_killed_and_restarted_with_earlier_stamps(listen, publish):
    ear = listen()
    first = publish(clock="sim", shift=1000)
    ear.scenes(10)
    first.send_signal(signal.SIGKILL)
    first.wait()
    time.sleep(1.2)  # longer than two publishers contradict each other
    while ear.source.poll(time.monotonic_ns()) is not None:
        pass
    assert ear.source.connected
    publish(clock="sim")
    end_s = time.monotonic() + 30.0  # Jazzy shows the killed one for 20 s
    while not all(scene.people for scene in ear.scenes(5)):
        assert time.monotonic() < end_s
    assert ear.counters.restarts == 1
    assert not ear.source.stamps_utc


def test_two_publishers_are_both_not_believed(listen, publish):
    ear = listen()
    publish()
    ear.scenes(5)
    publish(people=0)
    last_error(ear, "/people: two publishers; stop one of them")
    ear.scenes(5)
    assert not any(scene.sees_room or scene.people for scene in ear.scenes(20))


def test_a_flood_gives_the_newest_and_counts_the_others(listen, publish):
    ear = listen()
    publish(rate=2000)
    ear.scenes(1)
    end_s = time.monotonic() + 3.0
    scenes = []
    while time.monotonic() < end_s:
        if (scene := ear.source.poll(time.monotonic_ns())) is not None:
            scenes.append((time.time_ns() - scene.stamp_ns) * 1e-9)
        time.sleep(0.005)
    assert ear.counters.overrun > 100
    assert len(scenes) <= 3 * 2 * 30 + 16  # twice the nominal rate, and the queue
    assert min(scenes[len(scenes) // 2 :]) < 0.5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"frame": "lidar"}, "/people: frame_id 'lidar' is not 'map': no transform connects"),
        ({"joints": 20}, "/people: 20 poses are not a multiple of the 21 joints"),
        ({"clock": "zero"}, "/people: header.stamp is zero"),
        ({"topic": "/persons"}, "available: /persons (PoseArray)"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(listen, publish, options, words):
    ear = listen()
    publish(**options)
    last_error(ear, words)
    assert ear.source.poll(time.monotonic_ns()) is None
    assert "\n" not in ear.counters.last_error


def test_an_incompatible_qos_is_said_in_one_line(listen, publish):
    ear = listen(reliability="reliable")
    publish(best_effort=True)
    last_error(ear, "/people: a publisher offers another reliability than is asked for")
    assert ear.source.poll(time.monotonic_ns()) is None
    assert ear.counters.refused == 1


def test_another_type_on_the_topic_is_said(listen, publish):
    ear = listen()
    publish(message="marker_array")
    last_error(
        ear, "/people: is visualization_msgs/msg/MarkerArray, not geometry_msgs/msg/PoseArray"
    )
    assert ear.source.poll(time.monotonic_ns()) is None


def test_a_domain_that_is_none_is_named(listen, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "999")
    with pytest.raises(SourceError, match="source 'ros2': ROS_DOMAIN_ID: '999' is not a number"):
        listen(domain_id=None)
