"""The robot file: kinematic chain, capsules and stopping table, in YAML.

``configs/robots/ur5e.yaml`` is the example to copy.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from hri_predict.base.errors import ConfigError, RobotError, nearest
from hri_predict.base.files import mapping_of, read_text, shipped_path
from hri_predict.base.quantities.units import meant
from hri_predict.base.settings import (
    MAX_PAYLOAD_KG,
    MIN_SPEED_M_S,
    Name,
    Radians,
    Settings,
    Vector3,
    validated,
)
from hri_predict.robots.kinematics import Joint, dh_joint, origin_joint

MAX_JOINTS = 9
"""Maximum number of joints in RobotState."""
MAX_SLIDE_M = 8.0
"""Maximum position of a prismatic joint; RobotState carries 8.19 m."""
MAX_SLIDE_M_S = 20.0
MAX_TURN_RAD = 8.19
"""Maximum position of a revolute joint in RobotState: 469 degrees."""
MAX_TURN_RAD_S = 32.7
"""Maximum speed of a revolute joint in RobotState."""
MAX_PART_M = 10.0
"""Maximum distance between neighbouring joints, and from a joint to a capsule's end. The longest
arms on the market reach 4.7 m (FANUC M-2000iA/1700L)."""
MAX_REACH_M = 15.0
"""Maximum reach of the whole chain: the longest arm on the longest slide in RobotState."""
MAX_TIP_M_S = 25.0
"""Maximum speed of the farthest point due to one joint: twice that of the fastest delta robots."""
PartMetres = Annotated[float, Field(ge=-MAX_PART_M, le=MAX_PART_M)]
"""A length within a robot."""
PartVector3 = Annotated[list[PartMetres], Field(min_length=3, max_length=3)]


def _printable(value: str) -> str:
    if not value.isprintable() or not value.strip():
        raise ValueError("a name must be printable; remove line breaks and control characters")
    return value


PartName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_printable)]
"""Name of a joint, link or capsule; names from a URDF are not changed."""


Stopping = Annotated[float, Field(le=100)]  # seconds, metres, m/s: no robot needs more
MIN_STOPPING_S = 0.005
"""Minimum stopping time; a brake's coil needs tens of ms, a drive's ramp one cycle."""
MAX_DECELERATION_M_S2 = 300.0
"""Maximum plausible deceleration: twice the 15 g with which the fastest delta robots accelerate."""


class DhRow(Settings):
    """Classic (distal) Denavit-Hartenberg row: Rz(theta + q) Tz(d) Tx(a) Rx(alpha); m, rad.

    The position q of a prismatic joint is added to d instead.
    """

    a: PartMetres = Field(description="length along x, m")
    alpha: Radians = Field(description="twist about x, rad")
    d: PartMetres = Field(description="offset along z, m")
    theta: Radians = Field(0.0, description="angle about z at joint position 0, rad")


class Origin(Settings):
    """The joint's pose in its parent link, as in URDF; metres, fixed-axis roll, pitch and yaw."""

    xyz: PartVector3 = Field(description="position in the parent link, m")
    rpy: Annotated[list[Radians], Field(min_length=3, max_length=3)] = Field(
        [0.0, 0.0, 0.0], description="fixed-axis roll, pitch, yaw, rad"
    )


class JointFile(Settings):
    """One joint: its links, its pose (``dh``, or ``origin`` and ``axis``), and its limits.

    A revolute joint turns about its axis (rad, rad/s), a prismatic one slides along it (m, m/s).
    """

    name: PartName = Field(description="unique name")
    type: Literal["revolute", "prismatic"] = Field(
        "revolute", description="revolute turns about its axis, prismatic slides along it"
    )
    parent: PartName = Field(description="link that carries it")
    child: PartName = Field(description="link that it moves")
    dh: DhRow | None = Field(
        None, description="pose as a Denavit-Hartenberg row, instead of origin and axis"
    )
    origin: Origin | None = Field(None, description="pose as in URDF, instead of dh")
    axis: Vector3 | None = Field(
        None, description="with origin: unit vector of the axis of rotation or sliding"
    )
    position: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        description="lowest and highest position, rad or m"
    )
    velocity: float = Field(ge=0.001, le=1000, description="highest speed, rad/s or m/s")

    @model_validator(mode="after")
    def _placed_once(self) -> Self:
        if (self.dh is None) == (self.origin is None):
            raise ValueError(f"joint '{self.name}': give either dh or origin, not both or neither")
        if (self.origin is None) != (self.axis is None):
            raise ValueError(f"joint '{self.name}': axis requires origin (with dh the axis is z)")
        if self.axis is not None and not 0.99 < float(np.linalg.norm(self.axis)) < 1.01:
            raise ValueError(f"joint '{self.name}': axis must have length 1")
        if not self.position[0] < self.position[1]:
            raise ValueError(f"joint '{self.name}': position must be [lower, upper]")
        farthest = max(self.position, key=abs)
        if self.slides and (abs(farthest) > MAX_SLIDE_M or self.velocity > MAX_SLIDE_M_S):
            raise ValueError(
                f"joint '{self.name}': a prismatic joint is in metres: position at most "
                f"{MAX_SLIDE_M:g} m from 0, the range of RobotState, and velocity at most "
                f"{MAX_SLIDE_M_S:g} m/s; place position 0 in the middle"
            )
        if not self.slides and abs(farthest) > MAX_TURN_RAD:
            raise ValueError(
                f"joint '{self.name}': position {farthest:g} is more than {MAX_TURN_RAD:g} rad, "
                f"which RobotState carries; {meant(farthest, 'rad')}"
            )
        if not self.slides and self.velocity > MAX_TURN_RAD_S:
            raise ValueError(
                f"joint '{self.name}': velocity {self.velocity:g} is more than {MAX_TURN_RAD_S:g} "
                f"rad/s, which RobotState carries; {meant(self.velocity, 'rad/s')}"
            )
        return self

    @property
    def slides(self) -> bool:
        """Whether it is prismatic."""
        return self.type == "prismatic"

    def joint(self) -> Joint:
        """Return the joint for the kinematics."""
        if self.dh is not None:
            dh = self.dh
            return dh_joint(dh.a, dh.alpha, dh.d, dh.theta, slides=self.slides)
        assert self.origin is not None  # the validator guarantees it
        assert self.axis is not None
        xyz, rpy, axis = (np.array(v) for v in (self.origin.xyz, self.origin.rpy, self.axis))
        return origin_joint(xyz, rpy, axis, slides=self.slides)


class CapsuleFile(Settings):
    """A capsule fixed to a link: ends in the link's frame, metres. Equal ends give a sphere."""

    name: PartName = Field(description="unique name")
    a: PartVector3 = Field(description="first end of its axis, m")
    b: PartVector3 = Field(description="second end, m; equal ends give a sphere")
    radius: float = Field(ge=0.001, le=3, description="radius, m")


class LinkCapsuleFile(CapsuleFile):
    """A capsule with the name of its link."""

    link: PartName = Field(description="link to which it is fixed")


class StoppingRow(Settings):
    """Stopping time and distance by speed, for loads up to ``payload_kg``."""

    payload_kg: float = Field(
        ge=0, le=MAX_PAYLOAD_KG, description="maximum load for which the row holds"
    )
    time_s: Annotated[list[Stopping], Field(min_length=1)] = Field(
        description="stopping time from each speed"
    )
    distance_m: Annotated[list[Stopping], Field(min_length=1)] = Field(
        description="stopping distance of the fastest point from each speed"
    )


class StoppingFile(Settings):
    """Time and distance that the robot moves after its brake or ramp has started.

    ``speed_m_s`` is the speed of the robot's fastest point; each row has a value for every speed.
    """

    source: str = Field(min_length=1, description="source of the values")
    speed_m_s: Annotated[list[Stopping], Field(min_length=1)] = Field(
        description="speeds of the fastest point, ascending"
    )
    rows: Annotated[list[StoppingRow], Field(min_length=1)] = Field(
        description="one row per load, ascending"
    )

    @model_validator(mode="after")
    def _monotone(self) -> Self:
        speed = np.array(self.speed_m_s)
        if speed[0] < MIN_SPEED_M_S or np.any(np.diff(speed) <= 0):
            raise ValueError(f"speed_m_s must increase from {MIN_SPEED_M_S:g} m/s or more")
        if np.any(np.diff([row.payload_kg for row in self.rows]) <= 0):
            raise ValueError("rows must be in order of increasing payload_kg")
        lighter = np.zeros((2, len(speed)))
        for row in self.rows:
            where = f"row of {row.payload_kg:g} kg"
            if not len(row.time_s) == len(row.distance_m) == len(speed):
                raise ValueError(f"{where}: give one time_s and distance_m for every speed_m_s")
            table = np.array([row.time_s, row.distance_m])
            if np.any(table <= 0) or np.any(np.diff(table, axis=1) < 0):
                raise ValueError(f"{where}: time_s and distance_m must not fall as the speed rises")
            if np.any(table < lighter):
                raise ValueError(f"{where}: a heavier payload must not stop sooner")
            least = speed / MAX_DECELERATION_M_S2
            if np.any(table[0] < np.maximum(least, MIN_STOPPING_S) * (1 - 1e-9)) or np.any(
                table[1] < speed * least / 2 * (1 - 1e-9)
            ):
                raise ValueError(
                    f"{where}: implausibly short stop: time_s must be at least {MIN_STOPPING_S:g} "
                    f"s and the deceleration at most {MAX_DECELERATION_M_S2:g} m/s^2; give s and m"
                )
            if np.any(table[1] > speed * table[0] * (1 + 1e-9)):
                raise ValueError(f"{where}: distance_m exceeds speed x time_s; check the units")
            lighter = table
        return self


class ContactFile(Settings):
    """Properties for contact with a person, required by ``contact: allowed``.

    ``area_cm2`` is the smallest contact area of any part of the robot, its tool and its load.
    """

    source: str = Field(min_length=1, description="source of the values")
    moving_mass_kg: float = Field(
        ge=0.1, le=10_000, description="mass of all moving parts, without load"
    )
    area_cm2: float = Field(ge=0.01, le=1000, description="smallest contact area of any part")


class RobotFile(Settings):
    """A robot: joints from the base outwards, capsules of every link, tool and payload."""

    name: Name = Field(description="the model's name")
    source: str = Field(min_length=1, description="origin of the kinematic parameters")
    base: PartName = Field(description="link that does not move")
    joints: Annotated[list[JointFile], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="joints from the base outwards"
    )
    capsules: list[LinkCapsuleFile] = Field(description="capsules around the body of every link")
    tool: list[CapsuleFile] = Field([], description="capsules in the frame of the last link")
    payload: list[CapsuleFile] = Field([], description="capsules of the load in the same frame")
    stopping: StoppingFile = Field(description="stopping table")
    contact: ContactFile | None = Field(
        None, description="properties of a contact with a person; required where contact is allowed"
    )

    def effective_kg(self, loads: Sequence[float | None]) -> float:
        """m_R = M / 2 + m_L with the heaviest load (ISO/TS 15066:2016, A.3.6).

        A load of ``None`` is the heaviest of the stopping table. 0 without ``contact``.
        """
        if self.contact is None:
            return 0.0
        heaviest = self.stopping.rows[-1].payload_kg
        load_kg = max(heaviest if load is None else load for load in loads)
        return self.contact.moving_mass_kg / 2 + load_kg

    def links(self) -> list[str]:
        """Link names in the order of the chain."""
        return [self.base, *(joint.child for joint in self.joints)]


def read_robot_file(model: str, base_dir: Path | None) -> RobotFile:
    """Read and check a robot by a shipped name ("ur5e") or the path of a YAML file.

    Args:
        model: a name under ``configs/robots``, or a path ending in .yaml.
        base_dir: base of relative paths.

    Raises:
        RobotError: one line that names the file, the mistake, and the remedy.
    """
    path = robot_path(model, base_dir)
    try:
        return _checked(path, read_text(path, "robot file"))
    except ConfigError as error:
        raise RobotError(str(error)) from error


@lru_cache(maxsize=16)
def _checked(path: Path, text: str) -> RobotFile:
    """Parse the robot in the text of a file; cached, because a cell needs it in many places."""
    robot = validated(RobotFile, mapping_of(text, path, "robot file"), f"robot file {path}")
    problem = _chain_problem(robot) or _capsule_problem(robot) or size_problem(robot)
    if problem:
        raise RobotError(f"robot file {path}: {problem}")
    return robot


def robot_path(model: str, base_dir: Path | None) -> Path:
    """Return the path of the robot's file; if ``model`` is a path, it may not exist.

    Raises ``RobotError`` if no robot of this name is shipped.
    """
    try:
        return shipped_path("robot model", "robots", model, base_dir)
    except ConfigError as error:
        raise RobotError(str(error)) from error


def _chain_problem(robot: RobotFile) -> str:
    """Return why the joints do not form one chain from the base outwards, in order; or ""."""
    seen = [robot.base]
    children = robot.links()
    names = [joint.name for joint in robot.joints]
    for joint in robot.joints:
        if names.count(joint.name) > 1:
            return f"joint name '{joint.name}' is used twice; rename one"
        if joint.parent not in children:
            return (
                f"joint '{joint.name}': broken chain: its parent link '{joint.parent}' does not "
                "exist; correct it, or add the joint that leads to "
                f"it{nearest(joint.parent, children)}"
            )
        if joint.child in seen:
            return (
                f"joint '{joint.name}': broken chain: its child link '{joint.child}' is already in "
                "the chain, so the joints form a loop; give each joint a different child"
            )
        if joint.parent != seen[-1]:
            return (
                f"joint '{joint.name}': broken chain: its parent link is '{joint.parent}', but the "
                f"chain ends at '{seen[-1]}'; list the joints from the base outwards, each joint "
                "attached to the previous one"
            )
        seen.append(joint.child)
    return ""


def _capsule_problem(robot: RobotFile) -> str:
    links = robot.links()
    for capsule in robot.capsules:
        if capsule.link not in links:
            return (
                f"capsule '{capsule.name}': there is no link '{capsule.link}'"
                f"{nearest(capsule.link, links)}"
            )
    bare = [link for link in links if link not in {c.link for c in robot.capsules}]
    if bare:
        return f"link '{bare[0]}' has no capsule, so no distance would be kept from it; add one"
    names = [c.name for c in (*robot.capsules, *robot.tool, *robot.payload)]
    twice = next((name for name in names if names.count(name) > 1), None)
    return f"capsule name '{twice}' is used twice; rename one" if twice else ""


def size_problem(robot: RobotFile) -> str:
    """Return why the robot is implausibly large or fast, which suggests wrong units; or "".

    Lengths are added as for a fully stretched arm, so both values are upper bounds.
    """
    links = robot.links()
    extent = {
        link: max(
            [_farthest(capsule) for capsule in robot.capsules if capsule.link == link], default=0.0
        )
        for link in links
    }
    beyond = 0.0  # from the axis of the joint after ``link`` to the farthest point that it moves
    for joint in reversed(robot.joints):
        before, after = _lengths(joint)
        beyond = after + max(beyond, extent[joint.child])
        if not joint.slides and beyond * joint.velocity > MAX_TIP_M_S:
            return (
                f"joint '{joint.name}': velocity {joint.velocity:g} rad/s would move the arm's end "
                f"at {beyond * joint.velocity:.3g} m/s, {beyond:.3g} m from its axis; "
                f"{meant(joint.velocity, 'rad/s')}"
            )
        beyond += before
    reach = max(beyond, extent[robot.base])
    if reach > MAX_REACH_M:
        return f"its arm reaches {reach:.4g} m; {meant(reach, 'm')}"
    return ""


def _farthest(capsule: CapsuleFile) -> float:
    """Return the distance from the frame's origin to the capsule's farthest point, metres."""
    return max(math.hypot(*capsule.a), math.hypot(*capsule.b)) + capsule.radius


def _lengths(joint: JointFile) -> tuple[float, float]:
    """Return maximum distances, m: parent link to joint axis, joint axis to child."""
    slide = max(map(abs, joint.position)) if joint.slides else 0.0
    if joint.dh is not None:
        return 0.0, math.hypot(joint.dh.a, joint.dh.d) + slide
    assert joint.origin is not None  # the validator guarantees it
    return math.hypot(*joint.origin.xyz), slide
