"""A robot with all that nine joints can be: a rail, an arm, a telescope in its hand, and a turn."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hri_predict.base.arrays import Floats
from hri_predict.base.files import data_path
from hri_predict.base.settings import Pose
from hri_predict.robots.model import RobotModel, load_robot
from tests.arms import arm_settings

UR5E: dict[str, Any] = yaml.safe_load(data_path("robots", "ur5e.yaml").read_text())
PLACED = Pose(xyz=[1.0, -2.0, 0.8], quaternion_xyzw=[0.0, 0.0, 0.6, 0.8])
RAIL: dict[str, Any] = {
    "name": "rail",
    "type": "prismatic",
    "parent": "floor",
    "child": "base",
    "origin": {"xyz": [0.1, 0.0, 0.2], "rpy": [0.0, 0.1, 0.3]},
    "axis": [0.6, 0.8, 0.0],
    "position": [-1.5, 2.0],
    "velocity": 1.2,
}
LIFT: dict[str, Any] = {
    "name": "lift",
    "type": "prismatic",
    "parent": "wrist_3",
    "child": "slide",
    "dh": {"a": 0.05, "alpha": 0.7, "d": 0.02, "theta": 0.3},
    "position": [-0.1, 0.4],
    "velocity": 0.6,
}
TWIST: dict[str, Any] = {
    "name": "twist",
    "parent": "slide",
    "child": "hand",
    "origin": {"xyz": [0.0, 0.03, 0.1]},
    "axis": [0.0, 1.0, 0.0],
    "position": [-3.0, 3.0],
    "velocity": 2.0,
}
POINT: dict[str, Any] = {"a": [0.0, 0.0, 0.0], "b": [0.0, 0.0, 0.1], "radius": 0.05}


def data() -> dict[str, Any]:
    """Its robot file."""
    robot = copy.deepcopy(UR5E)
    robot |= {"name": "nine", "base": "floor", "joints": [RAIL, *robot["joints"], LIFT, TWIST]}
    for link in ("floor", "slide", "hand"):
        robot["capsules"].append({"name": link, "link": link, **POINT})
    return robot


def model(folder: Path) -> RobotModel:
    """The robot at ``PLACED``."""
    (folder / "nine.yaml").write_text(yaml.safe_dump(data()))
    settings = arm_settings("nine.yaml", room_from_robot=PLACED, payload_kg=2.5)
    return load_robot(settings, folder)


def drawn(robot: RobotModel, rng: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """(count, 9) positions within the limits, and velocities."""
    q = rng.uniform(robot.position_min, robot.position_max, (count, robot.dof))
    return q, rng.uniform(-robot.velocity_max, robot.velocity_max, (count, robot.dof))
