"""The cell of ``try``: the demo's, moved to where the user wants the robot."""

import math

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.tryout.command import Place, place_of, with_camera, with_person
from hri_predict.run import config as configuration
from hri_predict.run.assemble import build_source


def key(tmp_path):
    path = tmp_path / "camera.key"
    path.write_text(64 * "a")
    path.chmod(0o600)
    return path


@pytest.mark.parametrize(
    ("text", "place"),
    [("1.5,0.8", Place(1.5, 0.8)), (" -2, 0 ,3.14", Place(-2.0, 0.0, 3.14))],
)
def test_a_place_is_two_or_three_numbers(text, place):
    assert place_of(text) == place


@pytest.mark.parametrize(
    "text", ["", "1", "1,2,3,4", "a,b", "1;2", "nan,0", "0,inf", "1e9,0", "0,0,90", "0,0,nan"]
)
def test_a_place_that_is_not_one_is_one_line_with_the_form(text):
    with pytest.raises(ConfigError, match=r"--robot .*: (give X,Y or X,Y,YAW|.* must be from)"):
        place_of(text)


def test_at_the_origin_the_person_and_the_robot_are_the_demos():
    demo = configuration.load(configuration.shipped("demo.yaml"))
    cell = with_person(Place(0.0, 0.0))
    assert cell.node.robots == demo.node.robots
    assert cell.node.people == demo.node.people
    assert cell.source == demo.source


def test_the_demos_person_comes_to_the_robot_wherever_it_is():
    """At each moment the body lies to the robot's base as in the demo."""
    place = Place(-1.0, 2.0, math.pi / 2)

    def joints(cell):
        source = build_source(cell)
        source.open(0)
        scene = source.poll(8_000_000_000)
        while (newer := source.poll(8_000_000_000)) is not None:
            scene = newer
        assert scene is not None
        return scene.people[0].positions[:, :3]

    there, here = joints(with_person(Place(0.0, 0.0))), joints(with_person(place))
    turned = np.stack((-there[:, 1] - 1.0, there[:, 0] + 2.0, there[:, 2]), axis=1)
    np.testing.assert_allclose(here, turned, atol=0.04)  # 7 times the noise of both


def test_exits_move_with_the_robot():
    (door,) = with_person(Place(1.0, 0.0, math.pi)).node.people.exits
    np.testing.assert_allclose(door.polygon[0], [1.0 - 3.2, -2.0])


def test_a_camera_is_heard_on_this_machine_alone_and_by_its_key(tmp_path):
    cell = with_camera(Place(1.5, 0.9, 0.5), 4711, key(tmp_path))
    source = cell.source.model_dump()
    assert (source["kind"], source["host"], source["port"]) == ("udp", "127.0.0.1", 4711)
    assert source["key_file"] == str(tmp_path / "camera.key")
    camera = configuration.load(configuration.shipped("camera.yaml"))
    assert source == camera.source.model_dump() | {"port": 4711, "key_file": source["key_file"]}
    assert source["declares_noise"]
    again = with_camera(Place(1.5, 0.9, 0.5), 4711, key(tmp_path), repeats=True)
    assert not again.source.model_dump()["declares_noise"]
    assert (cell.node.people, cell.predictor) == (camera.node.people, camera.predictor)
    pose = cell.node.robots[0].room_from_robot
    assert pose is not None
    assert pose.xyz == [1.5, 0.9, 0.0]
    assert pose.quaternion_xyzw == pytest.approx([0, 0, math.sin(0.25), math.cos(0.25)])
    assert all(link.simulate is not None for link in cell.links)
