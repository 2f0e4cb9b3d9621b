"""Robot files and trajectories in millimetres, centimetres, inches or degrees are refused."""

import math
import re
from pathlib import Path

import pytest
import yaml

from hri_predict.base.errors import RobotError
from hri_predict.base.files import data_path
from hri_predict.base.settings import Pose
from hri_predict.robots.file import read_robot_file
from hri_predict.robots.model import RobotModel, RobotSettings, load_robot
from hri_predict.robots.trajectory import load_trajectory

SHIPPED = sorted(path.stem for path in data_path("robots").glob("*.yaml"))
SCALES = {"millimetres": 1000, "centimetres": 100, "inches": 1 / 0.0254}


def lengths(data: dict, factor: float) -> dict:
    """A robot file with all lengths of its body in another unit."""
    for joint in data["joints"]:
        if "dh" in joint:
            joint["dh"]["a"] *= factor
            joint["dh"]["d"] *= factor
        else:
            joint["origin"]["xyz"] = [x * factor for x in joint["origin"]["xyz"]]
    for capsule in (*data["capsules"], *data.get("tool", ()), *data.get("payload", ())):
        capsule["a"] = [x * factor for x in capsule["a"]]
        capsule["b"] = [x * factor for x in capsule["b"]]
        capsule["radius"] = capsule["radius"] * factor
    return data


def angles(data: dict, *keys: str) -> dict:
    """A robot file with these values in degrees."""
    for joint in data["joints"]:
        if joint.get("type", "revolute") != "prismatic":
            for key in set(keys) & {"position", "velocity"}:
                values = joint[key] if isinstance(joint[key], list) else [joint[key]]
                turned = [math.degrees(value) for value in values]
                joint[key] = turned if isinstance(joint[key], list) else turned[0]
        if "dh" in joint and "alpha" in keys:
            joint["dh"]["alpha"] = math.degrees(joint["dh"]["alpha"])
        if "origin" in joint and "alpha" in keys:
            rpy = joint["origin"].get("rpy", [0, 0, 0])
            joint["origin"]["rpy"] = [math.degrees(angle) for angle in rpy]
    return data


def shipped(name: str) -> dict:
    data: dict = yaml.safe_load(data_path("robots", f"{name}.yaml").read_text(encoding="utf-8"))
    return data


def read(data: dict, folder: Path) -> None:
    (folder / "robot.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    read_robot_file("robot.yaml", folder)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_robot_is_accepted(name):
    read_robot_file(name, None)


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("name", SHIPPED)
def test_a_robot_in_another_unit_of_length_is_refused(name, unit, tmp_path):
    with pytest.raises(RobotError, match="metres are meant"):
        read(lengths(shipped(name), SCALES[unit]), tmp_path)


@pytest.mark.parametrize("key", ["position", "velocity", "alpha"])
@pytest.mark.parametrize("name", SHIPPED)
def test_a_robot_in_degrees_is_refused(name, key, tmp_path):
    turned = angles(shipped(name), key)
    if turned == shipped(name):  # all axes of this arm are parallel to those of its links
        return
    with pytest.raises(RobotError, match=r"radians (per second )?are meant"):
        read(turned, tmp_path)


def test_joints_that_turn_several_times_are_accepted(tmp_path):
    data = shipped("ur5e")
    data["joints"][5]["position"] = [-7.854, 7.854]  # 450 degrees, as some wrists have
    read(data, tmp_path)


def test_a_slow_heavy_arm_in_degrees_per_second_is_refused_by_the_speed_of_its_end(tmp_path):
    data = shipped("ur5e")
    data["joints"][0]["velocity"] = 25
    with pytest.raises(RobotError, match=r"'shoulder_pan': velocity 25 rad/s would move.*0\.4363"):
        read(data, tmp_path)


@pytest.fixture(scope="module")
def arm() -> RobotModel:
    return load_robot(
        RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1.0), None
    )


def test_a_trajectory_in_degrees_is_refused(arm, tmp_path):
    text = data_path("trajectories", "pick_and_place.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text)
    for waypoint in data["waypoints"]:
        waypoint["positions"] = [math.degrees(q) for q in waypoint["positions"]]
    (tmp_path / "t.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(RobotError, match=r"waypoints\.0: .* is outside .*; radians are meant: "):
        load_trajectory("t.yaml", arm, tmp_path)


@pytest.mark.parametrize(
    ("base", "said"),
    [("[700, 0, 0]", "700 m is beyond 100; metres are meant: 0.7?"),
     ("[0, 0, 90]", "90 rad is beyond 12.5664; radians are meant: 1.571?")],
)  # fmt: skip
def test_a_base_of_a_trajectory_in_millimetres_or_degrees_is_refused(base, said, arm, tmp_path):
    points = f"[{{time_s: 0, positions: [0], base: {base}}}, {{time_s: 1, positions: [0]}}]"
    (tmp_path / "t.yaml").write_text(f"waypoints: {points}\n", encoding="utf-8")
    with pytest.raises(RobotError, match=re.escape(said)):
        load_trajectory("t.yaml", arm, tmp_path)


@pytest.mark.parametrize(
    ("joint_4", "said"),
    [
        (0.0, "at 0 rad is outside -3.0718 .. -0.0698; give a position within them"),
        (-3.2, "at -3.2 rad is outside -3.0718 .. -0.0698; give a position within them"),
        (-90.0, "at -90 rad is outside -3.0718 .. -0.0698; radians are meant: -1.571?"),
        (90.0, "at 90 rad is outside -3.0718 .. -0.0698; radians are meant"),
    ],
)
def test_another_unit_is_named_only_where_it_explains_the_position(joint_4, said, tmp_path):
    panda = load_robot(
        RobotSettings(name="arm", model="panda", room_from_robot=Pose(), max_speed_m_s=1.0), None
    )
    points = [{"time_s": t, "positions": [0, 0, 0, joint_4, 0, 1, 0]} for t in (0, 5)]
    (tmp_path / "t.yaml").write_text(yaml.safe_dump({"waypoints": points}), encoding="utf-8")
    with pytest.raises(RobotError, match=re.escape(said) + "$"):
        load_trajectory("t.yaml", panda, tmp_path)
