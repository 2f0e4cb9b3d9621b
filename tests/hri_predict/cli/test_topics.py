"""``topics`` and what follows from it: a bag is listed, replayed and converted."""

import json

import numpy as np
import pytest

from hri_predict.cli.run import BESIDE_THE_ROBOT, played
from hri_predict.protocol.ros.bodies import MARKER_ARRAY
from hri_predict.run import config as configuration

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.recording.ros.bags import maker, write
from tests.hri_predict.recording.ros.test_people import MS, UTC, standing, walk


@pytest.fixture
def bag(tmp_path):
    """A person as poses, and two as markers."""
    made = maker("mcap")
    messages = list(walk("mcap", 60))
    for k in range(30):
        at_ns = UTC + k * 80 * MS
        message = made.markers({1: standing(0.0)}, "camera", at_ns)
        messages.append(("/markers", MARKER_ARRAY, message, at_ns))
    return write(tmp_path, "mcap", sorted(messages, key=lambda m: m[3]))


def test_topics_that_could_be_people_are_listed_with_their_options(cli, bag):
    status, out, _ = cli("topics", bag, "--json")
    assert status == 0
    markers, people = json.loads(out)["topics"]
    assert (people["name"], people["count"], people["joints"]) == ("/people", 60, 21)
    assert people["options"] == ["--topic", "/people", "--joint-map", "canonical"]
    assert (markers["name"], markers["frame"]) == ("/markers", "camera")
    status, out, _ = cli("topics", bag)
    assert f"hri-predict replay {bag} --topic /people --joint-map canonical --viewer" in out


def test_poses_of_several_people_name_the_map_of_one(cli, tmp_path):
    made = maker("db3")
    both = made.poses(np.concatenate([standing(0.0), standing(0.0, 1.5)]), "map", UTC)
    path = write(tmp_path, "db3", [("/people", "geometry_msgs/msg/PoseArray", both, UTC)])
    (topic,) = json.loads(cli("topics", path, "--json")[1])["topics"]
    assert (topic["joints"], topic["joint_maps"]) == (42, ["canonical"])


@pytest.mark.long
def test_what_the_list_says_replays_and_converts(cli, bag, tmp_path):
    options = ("--topic", "/people", "--joint-map", "canonical")
    status, out, err = cli("replay", bag, *options, "--speed", "max", "--no-links", "--json")
    assert status == 0, err
    assert json.loads(out)["counted"]["scenes"] == 60
    status, out, err = cli("convert", bag, tmp_path / "a.csv", *options)
    assert status == 0, err
    assert "60 frames" in out


@pytest.mark.parametrize(
    ("name", "words"),
    [("gone.bag", "no such file"), ("notes.txt", "not a ROS bag (.bag, .db3, .mcap)")],
)
def test_what_is_no_bag_is_said_in_one_line(cli, tmp_path, name, words):
    (tmp_path / "notes.txt").write_text("x")
    status, out, err = cli("topics", tmp_path / name)
    assert (status, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_a_cell_of_ros_reads_its_bag_as_its_topic(bag):
    live = configuration.load(configuration.shipped("live_ros2.yaml"))
    own = {"joint_map": "coco17", "axes": ["z", "-x", "-y"]}
    source = played(live.source.model_copy(update=own), bag)
    assert source["joint_map"] == "coco17"
    assert source["axes"] == ["z", "-x", "-y"]
    assert (source["topic"], source["frame"]) == ("/people", "map")
    assert "place" not in source


def test_in_another_cell_a_bag_begins_beside_the_robot(bag):
    demo = configuration.load(configuration.shipped("live_udp.yaml"))
    assert played(demo.source, bag)["place"] == BESIDE_THE_ROBOT
    assert "place" not in played(demo.source, bag / "own.mcap")  # not there: as this node's own


def test_a_bag_that_this_node_wrote_needs_no_option(cli, bag, tmp_path):
    own = tmp_path / "own bag.mcap"
    options = ("--topic", "/people", "--joint-map", "canonical")
    status, _, error = cli("convert", bag, own, "--to", "rosbag2", *options)
    assert status == 0, error
    status, listed, error = cli("topics", own, "--json")
    assert status == 0, error
    (row,) = json.loads(listed)["topics"]
    assert (row["name"], row["options"], row["is_named"]) == ("/recorded/people", [], True)
    assert f"hri-predict replay '{own}' --viewer" in cli("topics", own)[1]
    demo = configuration.load(configuration.shipped("live_udp.yaml"))
    assert played(demo.source, own)["place"] == BESIDE_THE_ROBOT  # a motion file, as the bag was
