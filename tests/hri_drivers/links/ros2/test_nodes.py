"""The link with real ROS 2 nodes in other processes; each test has a domain of its own."""

import json
import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from hri_drivers.links.ros2.codec import FramesReceiver, Publication
from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.library.conformance.messages import state, status, zone
from hri_predict.protocol.messages import (
    Acknowledge,
    Level,
    Message,
    Pose,
    RobotState,
    Status,
)
from hri_predict.protocol.reasons import Reason
from tests.hri_drivers.links.ros2.programs import ADVISOR, FOLLOWER, LISTENER, Program
from tests.messages import make_advice
from tests.waiting import eventually

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
pytestmark = [pytest.mark.long, pytest.mark.realtime]

FOLLOWERS_SILENCE_S = 0.2
SCHEDULING_S = 0.3
"""Allowance for a busy machine, beyond the follower's timer of 10 ms."""
ADVICE = make_advice(
    Level.SLOW, Reason.PERSON_NEAR, speed_limit_m_s=0.5, separation_m=1.2, age_s=0.03
)
POSE = Pose(
    person=3, step=12, horizon_s=0.5, joints=tuple((j, 0.1 * j, 0.2, 1.0) for j in range(21))
)
ALL = (
    "/hri/frames", "/hri/robot_0/speed_fraction", "/hri/robot_0/speed_ovr", "/hri/robot_0/advice",
    "/diagnostics", "/hri/zones", "/hri/forecast_markers", "/hri/forecast",
)  # fmt: skip


@pytest.fixture
def program(domain: int) -> Iterator[Callable[..., Program]]:
    started: list[Program] = []

    def start(script: Path, *arguments: str) -> Program:
        started.append(Program(domain, script, *arguments))
        return started[-1]

    yield start
    for each in started:
        if each.process.poll() is None:
            each.end()


@pytest.fixture
def link(domain: int) -> Iterator[Callable[..., Ros2Link]]:
    made: list[Ros2Link] = []

    def make(**settings: Any) -> Ros2Link:
        given = {"name": "ros", "full_speed_m_s": 1.0, "domain_id": domain,
                 "silence_timeout_s": 0.2}  # fmt: skip
        model = Ros2LinkSettings.model_validate(given | settings)
        made.append(Ros2Link(model, MonotonicClock()))
        made[-1].start()
        return made[-1]

    yield make
    for each in made:
        each.stop()


def posted_until(link: Ros2Link, messages: list[Message], condition: Callable[[], Any]) -> Any:
    """Post as a node does, again and again: discovery takes a moment."""

    def posted() -> Any:
        for message in messages:
            link.post(message)
        return condition()

    return eventually(posted)


@pytest.mark.parametrize("qos", ["default", "sensor"])
def test_every_topic_arrives_at_a_subscriber_in_another_process(link, program, qos):
    listener = program(LISTENER, *(f"{topic}={qos}" for topic in ALL if topic != "/hri/forecast"),
                       "/hri/forecast=sensor")  # fmt: skip
    sent: list[Message] = [status(7), ADVICE, zone(3), POSE]
    ours = link()
    posted_until(ours, sent, lambda: all(listener.heard(topic) for topic in ALL))
    assert listener.heard("/hri/robot_0/speed_fraction")[-1] == 0.5
    assert listener.heard("/hri/robot_0/speed_ovr")[-1] == 50
    advice = json.loads(listener.heard("/hri/robot_0/advice")[-1])
    assert (advice["level"], advice["reason"], advice["age_s"]) == ("slow", "PERSON_NEAR", 0.03)
    expected = [
        ["hri_predict: node", 0, "running: nothing is near"],
        ["hri_predict: robot_0", 1, "slow: a person is too close"],
    ]  # each once a second

    def rows_came() -> bool:
        rows = [row for rows in listener.heard("/diagnostics") for row in rows]
        return all(row in rows for row in expected)

    posted_until(ours, sent, rows_came)
    assert [ns for ns, _, _ in listener.heard("/hri/zones")[-1]] == ["zone 12", "zone 12"]
    assert listener.heard("/hri/forecast")[-1][20] == pytest.approx([2.0, 0.2, 1.0])
    receiver = FramesReceiver()
    for frame in listener.heard("/hri/frames"):
        receiver.feed(Publication(bytes(frame)))
    assert receiver.counters.received > 0
    assert receiver.counters.crc_errors == receiver.counters.malformed == 0


def test_the_last_word_of_a_link_that_stops_is_0(link, program):
    topics = ("/hri/robot_0/speed_fraction", "/hri/robot_0/speed_ovr", "/hri/robot_0/advice")
    listener = program(LISTENER, *topics)
    ours = link(silence_timeout_s=2.0)  # and lifespan: a busy machine may need 0.2 s to take it
    posted_until(ours, [ADVICE], lambda: all(listener.heard(topic) for topic in topics))
    ours.stop()

    def stopped() -> bool:
        last = [listener.heard(topic)[-1] for topic in topics]
        return last[:2] == [0.0, 0] and json.loads(last[2])["level"] == "unknown"

    eventually(stopped)


def test_a_follower_stops_when_the_node_is_killed_and_goes_on_with_a_new_one(domain, program):
    follower = program(FOLLOWER)
    for _ in range(2):
        advisor = program(ADVISOR, str(domain))
        eventually(lambda: follower.lines and follower.lines[-1][1] == "speed 0.500")
        killed_s = time.monotonic()
        advisor.end(signal.SIGKILL)
        eventually(lambda: follower.lines[-1][1] == "speed 0.000")
        took_s = follower.lines[-1][0] - killed_s
        assert took_s <= FOLLOWERS_SILENCE_S + SCHEDULING_S
    assert follower.process.poll() is None


def test_a_follower_stops_at_once_when_the_node_ends(domain, program):
    follower, advisor = program(FOLLOWER), program(ADVISOR, str(domain))
    eventually(lambda: follower.lines and follower.lines[-1][1] == "speed 0.500")
    advisor.end(signal.SIGTERM)
    ended_s = time.monotonic()
    assert advisor.process.returncode == 0
    eventually(lambda: follower.lines[-1][1] == "speed 0.000")
    assert follower.lines[-1][0] <= ended_s + SCHEDULING_S
    assert advisor.errors == []


def test_a_follower_that_ends_stops_its_robot(domain, program):
    follower = program(FOLLOWER)
    program(ADVISOR, str(domain))
    eventually(lambda: follower.lines and follower.lines[-1][1] == "speed 0.500")
    follower.end(signal.SIGINT)
    eventually(lambda: follower.lines[-1][1] == "speed 0.000", seconds=2)


def test_a_subscriber_that_is_restarted_hears_the_link_again(link, program):
    ours = link()
    for _ in range(2):
        listener = program(LISTENER, "/hri/robot_0/advice")
        posted_until(ours, [ADVICE], partial(listener.heard, "/hri/robot_0/advice"))
        listener.end(signal.SIGKILL)
    assert ours.connected
    assert ours.counters.write_errors == ours.counters.disconnects == 0


@pytest.mark.parametrize(("qos", "policy"), [("impatient", "DEADLINE"), ("latched", "DURABILITY")])
def test_a_qos_mismatch_is_said_in_one_line(link, program, caplog, qos, policy):
    ours = link()
    listener = program(LISTENER, f"/hri/robot_0/advice={qos}", "/hri/robot_0/speed_ovr")
    posted_until(ours, [ADVICE], lambda: listener.heard("/hri/robot_0/speed_ovr"))
    posted_until(ours, [ADVICE], lambda: ours.last_error)
    assert ours.last_error.startswith(
        "/hri/robot_0/advice: a subscriber does not receive it, because it requests another "
        f"{policy}; offered is"
    )
    assert "\n" not in ours.last_error
    assert listener.heard("/hri/robot_0/advice") == []
    assert ours.connected
    lines = [r.message for r in caplog.records if "/hri/robot_0/advice" in r.message]
    assert len(lines) == 1


def test_another_publisher_on_a_topic_of_advice_is_said(link, program, domain, caplog):
    ours = link()
    program(ADVISOR, str(domain))
    posted_until(ours, [status(1), ADVICE], lambda: ours.foreign_ns)
    assert ours.counters.foreign > 0
    said = "/hri/robot_0/advice: 2 publishers; another node advises this robot too: stop it"
    posted_until(ours, [ADVICE], lambda: any(said in r.message for r in caplog.records))


def test_controllers_are_heard_by_frames_if_asked_for(link):
    taking, idle = link(take=True), link(namespace="/elsewhere")
    controller = link(node_name="controller")
    sent: list[Message] = [state(7), Acknowledge(3, 9)]
    posted_until(controller, sent, lambda: taking.counters.messages_received >= 2)
    kinds = {type(each.message) for each in taking.take()}
    assert kinds == {RobotState, Acknowledge}
    assert idle.counters.bytes_received == 0


def test_its_own_messages_do_not_come_back(link):
    ours = link(take=True)
    for cycle in range(50):
        ours.post(status(cycle))
        time.sleep(0.01)
    assert ours.counters.bytes_received == 0
    assert ours.foreign_ns is None


def test_listen_hears_the_link(link, domain):
    ours = link()
    model = Ros2LinkSettings(name="l", full_speed_m_s=1.0, domain_id=domain, node_name="listen")
    wire, receiver = Ros2Link.make_transport(model), Ros2Link.receiver(model)
    wire.open()
    try:
        heard: list[Message] = []

        def status_came() -> bool:
            for unit in wire.read(0.01):
                heard.extend(receiver.feed(unit))
            return any(isinstance(message, Status) for message in heard)

        posted_until(ours, [status(5)], status_came)
    finally:
        wire.close()
