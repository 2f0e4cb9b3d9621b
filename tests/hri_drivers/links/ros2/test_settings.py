"""Settings, RViz configuration and shipped configuration of the link; none of it needs ROS 2."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.library.conformance.messages import advice, zone
from hri_predict.library.conformance.wire import Wire
from hri_predict.protocol.messages import Pose
from hri_predict.protocol.ros.link_topics import ALL
from hri_predict.run import config as configuration

RVIZ = Path(__file__).parents[4] / "drivers" / "ros2" / "hri_predict.rviz"


def settings(**data: Any) -> Ros2LinkSettings:
    return Ros2LinkSettings.model_validate({"name": "ros", "full_speed_m_s": 1.0} | data)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"full_speed_m_s": 0}, "full_speed_m_s"),
        ({"full_speed_m_s": None}, "full_speed_m_s"),
        ({"namespace": "/0cell"}, "namespace"),
        ({"namespace": "a b"}, "namespace"),
        ({"frame_id": "a frame"}, "frame_id"),
        ({"domain_id": 233}, "domain_id"),
        ({"simulate": {}}, "leave 'simulate' out"),
        ({"remap": {"speed_ovr": "/speed_ovr"}}, "remap: no topic 'speed_ovr'; available"),
        ({"remap": {"robot_0/speed_ovr": "/0"}}, "remap"),
        ({"remap": {"robot_0/speed_ovr": "robot_0/advice"}}, "/hri/robot_0/advice is the name of"),
        ({"remap": {"zones": "/a", "forecast": "/a"}}, "/a is the name of two topics"),
    ],
)
def test_settings_that_make_no_sense_are_refused(data, words):
    with pytest.raises(ValidationError, match=words):
        settings(**data)


def test_full_speed_must_be_said():
    with pytest.raises(ValidationError, match="full_speed_m_s"):
        Ros2LinkSettings.model_validate({"name": "ros"})


def test_names_of_topics():
    topics = settings(namespace="cell_1/hri", remap={"robot_0/speed_ovr": "/speed_ovr"}).topics
    assert topics.full("robot_0/advice") == "/cell_1/hri/robot_0/advice"
    assert topics.full("robot_0/speed_ovr") == "/speed_ovr"
    assert topics.full("/diagnostics") == "/diagnostics"


def test_two_names_may_be_exchanged():
    topics = settings(remap={"zones": "forecast_markers", "forecast_markers": "zones"}).topics
    assert topics.full("zones") == "/hri/forecast_markers"


def test_check_says_that_plain_topics_are_not_protected():
    (note,) = settings().notes
    assert "not protected end to end" in note
    assert len(settings(discovery="subnet").notes) == 2


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({}, "both have namespace /hri"),
        ({"namespace": "/other", "discovery": "subnet"}, "differ in 'discovery'"),
    ],
)
def test_links_that_disturb_each_other_are_refused(data, words):
    with pytest.raises(ConfigError, match=f"links 'ros' and 'b' .*{words}"):
        Ros2Link.check_together([settings(), settings(name="b", **data)])
    Ros2Link.check_together([settings(), settings(name="b", namespace="/b")])


def test_without_ros_the_settings_load_and_the_error_names_the_remedy():
    code = (
        "import sys; sys.modules['rclpy'] = None\n"
        "from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings\n"
        "settings = Ros2LinkSettings(name='ros', full_speed_m_s=1)\n"
        "try: Ros2Link.make_transport(settings)\n"
        "except Exception as error: print(type(error).__name__, error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "ConfigError link 'ros2' needs a package that is not installed:" in done.stdout
    assert "pip install 'hri-predict[ros2]'" in done.stdout


def test_the_last_word_is_0_once_and_counted():
    wire: Any = Wire()
    link = Ros2Link(settings(), VirtualClock(1), wire)
    written: list[bytes] = []
    link.on_sent = lambda name, data, now_ns: written.append(data)
    link.post(advice(0, 0.5))
    link.service(1)
    link.stop()
    link.stop()
    last = wire.written[-1]
    fractions = [s.data for s in last.plain if s.topic.endswith("speed_fraction")]
    assert fractions == [b"\x00\x01\x00\x00" + bytes(8)]
    assert len(wire.written) == len(written) == 2


def test_nothing_is_published_by_a_link_that_advised_no_robot():
    wire: Any = Wire()
    link = Ros2Link(settings(), VirtualClock(1), wire)
    link.service(1)
    link.stop()
    assert wire.written == []


def displays() -> list[dict[str, Any]]:
    """Displays of the RViz configuration that show a topic."""
    shown = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]["Displays"]
    return [display for display in shown if "Topic" in display]


def test_rviz_shows_topics_that_the_link_has_by_default():
    config, link = yaml.safe_load(RVIZ.read_text()), settings()
    frame = config["Visualization Manager"]["Global Options"]["Fixed Frame"]
    assert frame == link.frame_id
    names = {link.topics.full(topic) for topic in ALL}
    assert {display["Topic"]["Value"] for display in displays()} <= names


def test_rviz_shows_messages_of_the_type_that_its_displays_take():
    wire: Any = Wire()
    full = settings().topics.full
    link = Ros2Link(settings(), VirtualClock(1), wire)
    pose = Pose(person=1, step=1, horizon_s=0.1, joints=((0, 0.0, 0.0, 0.0),))
    for message in (zone(1), pose):
        link.post(message)
    link.service(1)
    markers = {"/hri/zones", "/hri/forecast_markers"}
    of_kind = {"MarkerArray": markers, "PoseArray": {"/hri/forecast"}}
    sent = {full(sample.topic) for unit in wire.written for sample in unit.plain}
    assert sent == set().union(*of_kind.values())
    for display in displays():
        assert display["Topic"]["Value"] in of_kind[display["Class"].rpartition("/")[2]]


def test_rviz_asks_for_no_more_than_is_offered():
    pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")
    from hri_drivers.links.ros2.transport import quality

    for display in displays():
        topic = display["Topic"]["Value"].removeprefix("/hri/")
        offered = quality(topic, 0.2)
        asked = display["Topic"]["Reliability Policy"].upper().replace(" ", "_")
        assert asked in (offered.reliability.name, "BEST_EFFORT")
        assert display["Topic"]["Durability Policy"] == "Volatile"


def test_the_shipped_configuration_has_the_link():
    config = configuration.load(configuration.shipped("ros2.yaml"))
    (link,) = [link for link in config.links if link.kind == "ros2"]
    assert isinstance(link, Ros2LinkSettings)
    assert link.topics.full("robot_0/speed_ovr") == "/speed_ovr"
    (robot,) = config.node.robots
    assert link.full_speed_m_s == robot.max_speed_m_s
