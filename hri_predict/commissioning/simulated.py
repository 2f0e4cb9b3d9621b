"""A simulated cell: simulated people instead of the tracker, and mock controllers at its links.

Every step of a validation can thus be tried before the cell is wired. Its results do not apply to
the real cell, and the report states this.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RobotError
from hri_predict.base.files import data_path
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.contracts.link import LinkSettings, Simulatable
from hri_predict.contracts.source import SourceSettings
from hri_predict.robots.model import RobotModel, StandingMotion
from hri_predict.robots.trajectory import load_trajectory
from hri_predict.run import assemble
from hri_predict.run.config import Config

PROCEDURAL = "procedural"
NOISE_M = 0.004
WALKERS = 4
LANE_M = 0.45
"""Distance between lanes: a body's width leaves no 0.25 m cell uncovered."""
ARM_M = 0.5
"""Horizontal distance from a person who touches a point to that point."""


def is_simulated(config: Config) -> bool:
    """Return whether people or controllers of this configuration are simulated."""
    mock = any(link.simulate is not None for link in config.links)
    return mock or config.source.kind == PROCEDURAL


def simulated(config: Config, circles: Floats) -> Config:
    """Return the cell with simulated people who cover its whole floor, and mock controllers.

    Args:
        config: the cell.
        circles: (R, 3) x, y and radius of the floor to walk, metres.

    Raises:
        ConfigError: a robot is configured as standing, or no shipped trajectory fits it.
    """
    return replace(with_people(config, walkers(circles)), links=_mocked(config))


def with_people(config: Config, people: Sequence[dict[str, Any]]) -> Config:
    """Return the cell with these procedural people; their scripts use the room frame."""
    source = config.source
    if source.kind == PROCEDURAL:
        here = {"people": list(people), "room_from_source": {}, "faults": []}
        return config.with_source(source.model_dump() | here)
    kept = SourceSettings.model_fields.keys() - {"kind", "faults", "room_from_source"}
    made: dict[str, Any] = source.model_dump(include=set(kept))
    made |= {"kind": PROCEDURAL, "noise_m": NOISE_M, "people": list(people)}
    joint_map = getattr(source, "joint_map", None)
    if isinstance(joint_map, str):  # so that they are seen as the cell's tracker sees them
        made["joint_map"] = joint_map
    return config.with_source(made)


def walkers(circles: Floats) -> list[dict[str, Any]]:
    """Return scripts of people who together walk lanes over the whole floor of these circles."""
    lanes = _lanes(circles)
    share = math.ceil(len(lanes) / WALKERS)
    people = []
    for first in range(0, len(lanes), share):
        points: list[list[float]] = []
        for i, (a, b) in enumerate(lanes[first : first + share]):
            points += [a, b] if i % 2 == 0 else [b, a]
        script = [{"do": "walk", "to": point} for point in points[1:]]
        people.append({"start": points[0], "script": script})
    return people


def with_toucher(config: Config, point: Floats) -> Config:
    """Return the cell with a person who holds the finger tips at a point (3,), room frame, metres.

    All joints are sent: without hand joints, the wrist would be used, a hand's length away.
    """
    moved = with_people(config, toucher(point))
    return moved.with_source(moved.source.model_dump() | {"joint_map": None})


def toucher(point: Floats) -> list[dict[str, Any]]:
    """Return the script of a person who holds the right hand at a point (3,), room frame."""
    x, y, z = (float(v) for v in point)
    away = np.array([x, y]) / max(math.hypot(x, y), 1e-9) if math.hypot(x, y) > 0.1 else [1.0, 0.0]
    start = [round(x + ARM_M * float(away[0]), 4), round(y + ARM_M * float(away[1]), 4)]
    yaw = math.atan2(y - start[1], x - start[0])
    reach = {"do": "reach", "hand": "right", "to": [x, y, z], "hold_s": 3600}
    return [{"start": start, "yaw": yaw, "script": [reach]}]


def _lanes(circles: Floats) -> list[tuple[list[float], list[float]]]:
    """Return lines along y through the circles, from left to right, each from its lower end."""
    low = float((circles[:, 0] - circles[:, 2]).min()) + LANE_M / 2
    high = float((circles[:, 0] + circles[:, 2]).max())
    lanes = []
    for x in np.arange(low, high, LANE_M):
        half = np.sqrt(np.maximum(circles[:, 2] ** 2 - (x - circles[:, 0]) ** 2, 0.0))
        if half.max() < LANE_M / 2:
            continue
        crossed = half > 0
        bottom = float((circles[crossed, 1] - half[crossed]).min())
        top = float((circles[crossed, 1] + half[crossed]).max())
        lanes.append(([round(float(x), 3), round(bottom, 3)], [round(float(x), 3), round(top, 3)]))
    return lanes


def _mocked(config: Config) -> tuple[LinkSettings, ...]:
    """Return the links with mock controllers; kinds that cannot be simulated are left out."""
    models = {model.name: model for model in assemble.build_robots(config)}
    driven = {
        (link.simulate or {}).get("robot", next(iter(models)))
        for link in config.links
        if link.simulate is not None and link.simulate.get("role", "drive") == "drive"
    }
    links = []
    for i, link in enumerate(config.links):
        cls = registry.load("links", link.kind)
        if link.simulate is not None:
            links.append(link)
        elif isinstance(cls, Simulatable):
            names = link.robots or list(models)
            robot = next((name for name in names if name not in driven), names[0])
            mock = {"role": "monitor" if robot in driven else "drive", "robot": robot}
            if robot not in driven:
                mock["trajectory"] = _trajectory(config, models[robot])
            driven.add(robot)
            changes: dict[str, Any] = {cls.port_field: "simulated", "simulate": mock}
            if link.kind == "can":
                changes |= {"interface": "slcan", "fd": False, "isotp": None, "options": {}}
            data = {k: v for k, v in link.model_dump().items() if k in link.model_fields_set}
            links.append(validated(cls.settings_model, data | changes, f"--simulate: links.{i}"))
    return tuple(links)


def _trajectory(config: Config, model: RobotModel) -> str:
    """Return the robot's configured trajectory, or the first shipped one that fits the robot."""
    settings = next(robot for robot in config.node.robots if robot.name == model.name)
    if isinstance(settings.motion, StandingMotion):
        raise ConfigError(
            f"--simulate: robot {model.name} has motion 'standing', and the mock controller moves "
            f"it; give it motion {{kind: state}}, or leave --simulate out"
        )
    own = getattr(settings.motion, "plan", None) or getattr(settings.motion, "file", None)
    if own is not None:
        return str(own)
    for path in sorted(data_path("trajectories").glob("*.yaml"), key=lambda p: len(p.stem)):
        try:
            load_trajectory(path.stem, model, None)
        except RobotError:
            continue
        return path.stem
    raise ConfigError(
        f"--simulate: no shipped trajectory fits robot {model.name}; give robots.motion.plan"
    )
