"""A robot's entry in the configuration: base, tools and source of its motion."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from hri_predict.base.errors import QUARTER, TURNED
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.quantities.units import meant
from hri_predict.base.settings import MAX_PAYLOAD_KG, MIN_SPEED_M_S, Name, Pose, Settings
from hri_predict.robots.file import MAX_PART_M, CapsuleFile, StoppingFile
from hri_predict.robots.modes import ModeSettings

MAX_TOOL = 254
"""Maximum tool number in RobotState."""


MIN_STALE_S = 0.005
"""Minimum of ``stale_s``; controllers send RobotState every 2 to 20 ms."""
MIN_ACCELERATION_M_S2 = 0.5
"""Minimum of ``acceleration_m_s2``; arms exceed 1 m/s^2. The default, if not measured, is 5."""
MIN_STILL_S = 0.5
"""Minimum of ``still_s``: reaction and first steps of a robot that is free to move."""
POSITION_TOLERANCE = 0.01
"""Tolerance of reported positions beyond a limit, rad or m, for sensor noise and rounding."""


class StateMotion(Settings):
    """The robot's motion is reported by its controller in RobotState."""

    kind: Literal["state"] = Field(
        "state", description="position as reported by its controller in RobotState"
    )
    stale_s: float = Field(
        0.1, ge=MIN_STALE_S, le=2, description="age at which RobotState is stale"
    )
    delay_s: float = Field(
        0.0, ge=0, le=1, description="age of a RobotState at receipt: the delay of its link"
    )
    acceleration_m_s2: float = Field(
        5.0,
        ge=MIN_ACCELERATION_M_S2,
        le=1000,
        description="maximum acceleration of the fastest point; bounds its motion since RobotState",
    )
    still_s: float | None = Field(
        None,
        ge=MIN_STILL_S,
        le=3600,
        description="maximum time without any change of RobotState while the robot is free to "
        "move; after this time, people within its reach stop it until RobotState "
        "changes; default: never",
    )
    plan: str | None = Field(
        None,
        min_length=1,
        description="trajectory of the robot, shipped name or path of a YAML file; while its "
        "state is on the trajectory, its motion is predicted along it",
    )

    safety: ClassVar[Safety] = harmless("still_s") | {
        "stale_s": LessSafe(
            above="the robot may have moved for {value:g} s since the RobotState in use"
        ),
        "delay_s": LessSafe(
            below="a RobotState counts as {more:.2g} s fresher than it is on arrival; the robot "
            "moves during this time"
        ),
        "acceleration_m_s2": LessSafe(
            below="the robot is assumed to gain, since a RobotState, {more:.2g} m/s less in each "
            "second"
        ),
    }


class TrajectoryMotion(Settings):
    """The robot follows a trajectory file, independent of its controller's reports."""

    kind: Literal["trajectory"] = Field(description="the robot follows a trajectory file")
    file: str = Field(min_length=1, description="shipped name or path of a YAML file")
    start_s: float = Field(
        0.0, ge=0, le=86_400, description="time within the cycle when the node starts"
    )

    safety: ClassVar[Safety] = harmless("start_s")


class StandingMotion(Settings):
    """The robot does not move."""

    kind: Literal["standing"] = Field(description="the robot does not move")
    positions: Annotated[list[float], Field(min_length=1)] = Field(
        description="positions of its joints, rad or m"
    )


Motion = Annotated[StateMotion | TrajectoryMotion | StandingMotion, Field(discriminator="kind")]


class ToolSettings(Settings):
    """One tool, with load, that the robot may carry, for example from a tool changer."""

    name: Name = Field(description="its own name")
    number: int | None = Field(
        None,
        strict=True,
        ge=0,
        le=MAX_TOOL,
        description="value of `tool` in RobotState for this tool; without a number it is used "
        "only in the worst case",
    )
    tool: list[CapsuleFile] = Field([], description="capsules in the frame of the last link")
    payload: list[CapsuleFile] = Field(
        [], description="capsules of the load that the tool may hold, in the same frame"
    )
    payload_kg: float | None = Field(
        None,
        ge=0,
        le=MAX_PAYLOAD_KG,
        description="mass of tool and load; default: the heaviest load of the stopping table",
    )

    safety: ClassVar[Safety] = harmless("number") | {
        "payload_kg": LessSafe(
            below="with more than {value:g} kg the robot stops later than assumed"
        )
    }

    @model_validator(mode="after")
    def _has_a_shape(self) -> Self:
        if self.payload_kg != 0 and not self.tool and not self.payload:
            raise ValueError(
                f"tool '{self.name}' has no capsules, so no distance would be kept from it; "
                "describe it under tool: and payload:, or set payload_kg: 0 if nothing is mounted"
            )
        return self


class MobileBaseSettings(Settings):
    """A base that moves over the floor; its controller reports its pose in RobotState."""

    kind: Literal["state"] = Field(
        description="position as reported by its controller in RobotState"
    )
    base_from_robot: Pose = Field(description="start of the arm's chain, in the base's frame")
    capsules: Annotated[list[CapsuleFile], Field(min_length=1, max_length=16)] = Field(
        description="capsules of all of the base's body, in its frame: origin on the floor, "
        "x forward, z up"
    )
    max_speed_m_s: float = Field(
        ge=MIN_SPEED_M_S, le=20, description="maximum possible speed of the base"
    )
    max_turn_rad_s: float = Field(
        ge=0.01, le=20, description="maximum possible turn rate of the base"
    )
    acceleration_m_s2: float = Field(
        2.0,
        ge=0.1,
        le=100,
        description="maximum acceleration of any point due to the base since RobotState was sent",
    )
    uncertainty_m: float = Field(ge=0, le=1, description="uncertainty of its reported position")
    uncertainty_rad: float = Field(ge=0, le=0.5, description="uncertainty of its reported heading")
    stopping: StoppingFile = Field(
        description="stopping table, by speed of the robot's fastest point due to the base"
    )

    safety: ClassVar[Safety] = {
        "acceleration_m_s2": LessSafe(
            below="the base is assumed to gain, since a RobotState, {more:.2g} m/s less in each "
            "second"
        )
    }

    @field_validator("base_from_robot")
    @classmethod
    def _is_on_it(cls, value: Pose) -> Pose:
        if (far := max(value.xyz, key=abs)) and abs(far) > MAX_PART_M:
            raise ValueError(f"xyz: {far:g} m is beyond {MAX_PART_M:g} m; {meant(far, 'm')}")
        return value


class RobotSettings(Settings):
    """One entry of ``robots:`` in the configuration."""

    name: Name = Field(description="unique name, for messages and alerts")
    model: str = Field(min_length=1, description="shipped name (ur5e) or path of a YAML file")
    room_from_robot: Pose | None = Field(None, description="pose of its base")
    base: MobileBaseSettings | None = Field(
        None, description="a base that moves, instead of a fixed pose"
    )
    payload_kg: float | None = Field(
        None,
        ge=0,
        le=MAX_PAYLOAD_KG,
        description="largest mass of tool and load together; default: the heaviest of the stopping "
        "table",
    )
    tools: Annotated[list[ToolSettings], Field(min_length=1, max_length=32)] | None = Field(
        None, description="tools that may be mounted, instead of the robot file's tool and payload"
    )
    max_speed_m_s: float = Field(
        ge=MIN_SPEED_M_S, le=20, description="maximum speed of the fastest point in production"
    )
    motion: Motion = Field(StateMotion(), description="source of its motion")
    contact: Literal["allowed"] | None = Field(
        None, description="in mode hybrid: the robot may touch people within their contact limits"
    )

    modes: ModeSettings = Field(ModeSettings(), description="allowed operating modes")

    safety: ClassVar[Safety] = {
        "payload_kg": LessSafe(
            below="with more than {value:g} kg the robot stops later than assumed"
        ),
        "contact": LessSafe(other="the robot may touch people while moving"),
    }

    @model_validator(mode="after")
    def _modes_can_be_asked_for(self) -> Self:
        allowed = self.modes.allowed
        if allowed and not isinstance(self.motion, StateMotion):
            raise ValueError(
                f"modes.{allowed[0]} is requested in RobotState; set motion: {{kind: state}}, or "
                "leave modes out"
            )
        if self.modes.recovery and isinstance(self.motion, StateMotion) and not self.motion.plan:
            raise ValueError(
                "modes.recovery needs motion.plan: without the robot's path, the way back is "
                "unknown; configure its trajectory, or leave recovery out"
            )
        return self

    @model_validator(mode="after")
    def _based_once(self) -> Self:
        if (self.room_from_robot is None) == (self.base is None):
            raise ValueError(
                f"robot '{self.name}': give either room_from_robot (fixed base) or base (moving "
                f"base); {TURNED}: room_from_robot: {{xyz: [0, 0, 0], quaternion_xyzw: {QUARTER}}}"
            )
        moves_by_plan = not isinstance(self.motion, StateMotion) or self.motion.plan is not None
        if self.base is not None and moves_by_plan:
            raise ValueError(
                f"robot '{self.name}': its base moves, so a plan cannot predict its path; set "
                "motion to 'kind: state' without plan"
            )
        return self

    @model_validator(mode="after")
    def _tools_differ(self) -> Self:
        if self.tools is None:
            return self
        if self.payload_kg is not None:
            raise ValueError(
                f"robot '{self.name}': payload_kg belongs in each of its tools; remove it here"
            )
        names = [f"name '{tool.name}'" for tool in self.tools]
        names += [f"number {tool.number}" for tool in self.tools if tool.number is not None]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"robot '{self.name}': two tools have the {twice}; change one")
        for tool in self.tools:
            names = [capsule.name for capsule in (*tool.tool, *tool.payload)]
            if len(names) > len(set(names)):
                raise ValueError(
                    f"robot '{self.name}': tool '{tool.name}' has two capsules with the same name"
                )
        return self
