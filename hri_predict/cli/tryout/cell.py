"""The cell of ``try``: the demo's cell with a moved robot and, optionally, a camera."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path, read_yaml
from hri_predict.run.config import Config, checked

FARTHEST_M = 20.0
"""Maximum distance of the robot from the room's origin, along x and along y."""
ACKNOWLEDGED_S = 4.0
"""Time after which the simulated controllers acknowledge a lost person."""


@dataclass(frozen=True, slots=True)
class Place:
    """Pose of the robot: metres, and radians counter-clockwise from +x."""

    x: float
    y: float
    yaw: float = 0.0

    def moved(self, point: list[float]) -> list[float]:
        """Return a point [x, y] of the robot's frame in the room's frame."""
        x, y = point
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return [self.x + c * x - s * y, self.y + s * x + c * y]

    def pose(self) -> dict[str, list[float]]:
        """Return the block ``room_from_robot`` of a configuration."""
        turn = [0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2)]
        return {"xyz": [self.x, self.y, 0.0], "quaternion_xyzw": turn}


def place_of(text: str) -> Place:
    """Return the pose given by ``--robot``.

    Raises:
        ConfigError: it is not two or three numbers, or too far away.
    """
    try:
        place = Place(*(float(part) for part in text.split(",")))
    except (ValueError, TypeError):
        raise ConfigError(
            f"--robot {text}: give X,Y or X,Y,YAW (m, m, rad), such as 1.5,0.8"
        ) from None
    if not (abs(place.x) <= FARTHEST_M and abs(place.y) <= FARTHEST_M):
        raise ConfigError(f"--robot {text}: x and y must be from -{FARTHEST_M:g} to {FARTHEST_M:g}")
    if not abs(place.yaw) <= 2 * math.pi:
        raise ConfigError(f"--robot {text}: the yaw must be from -6.28 to 6.28 rad")
    return place


def with_person(robot: Place) -> Config:
    """Return the demo's cell with the robot at ``robot``; exits and the person move with it."""
    data = _demo(robot)
    data["source"]["room_from_source"] = robot.pose()
    for region in data["people"]["exits"]:
        region["polygon"] = [robot.moved(corner) for corner in region["polygon"]]
    return _checked(data)


def with_camera(robot: Place, port: int, key_file: Path, *, repeats: bool = False) -> Config:
    """Return the shipped ``camera.yaml``, heard at a port of this machine, with the demo's robot.

    Its rate and predictor need less computing time than the demo's, because the computer also
    processes images.

    Args:
        robot: pose of the robot.
        port: UDP port of the source.
        key_file: with the source's key.
        repeats: whether the input is a looping video: repeated joints are then normal, while from a
            camera they mean that it is frozen.
    """
    data: dict[str, Any] = read_yaml(data_path("camera.yaml"), "configuration")
    data |= {key: value for key, value in _demo(robot).items() if key in ("robots", "links")}
    data["source"] |= {"port": port, "key_file": str(key_file), "declares_noise": not repeats}
    for link in data["links"]:
        link["simulate"]["acknowledge_after_s"] = ACKNOWLEDGED_S
    return _checked(data)


def _demo(robot: Place) -> dict[str, Any]:
    data: dict[str, Any] = read_yaml(data_path("demo.yaml"), "configuration")
    data["robots"][0]["room_from_robot"] = robot.pose()
    return data


def _checked(data: dict[str, Any]) -> Config:
    return checked(data_path("try.yaml"), yaml.safe_dump(data), data)
