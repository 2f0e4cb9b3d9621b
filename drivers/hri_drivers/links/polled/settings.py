"""Settings of links that poll a robot's state: addresses, and the meaning of the values."""

from typing import Annotated, ClassVar, Generic, Literal, Self, TypeVar

from pydantic import Field, model_validator

from hri_drivers.links.configured import ConfiguredLinkSettings
from hri_predict.base.quantities.safe_side import LessSafe, Safety, harmless
from hri_predict.base.settings import Settings
from hri_predict.protocol.robot_state import MAX_JOINTS

A = TypeVar("A")
"""An address at the server: a register, or a node."""

HEARTBEAT, MODE = "heartbeat", "mode"
BASE = ("x", "y", "yaw")
BASE_VELOCITY = ("vx", "vy", "yaw_rate")


class JointAt(Settings, Generic[A]):
    """One joint, an entry of ``joints``."""

    position: A = Field(description="address of the joint's position")
    velocity: A | None = Field(
        None, description="address of its velocity; default: from the change of its position"
    )
    sign: Literal[1, -1] = Field(
        1, description="-1 if its positive direction is opposite to the robot model's"
    )
    offset_rad: float = Field(
        0.0, ge=-1e4, le=1e4, description="added after scale and sign; m for a prismatic joint"
    )
    scale: float | None = Field(
        None, ge=1e-9, le=1e6, description="instead of scale and velocity_scale, for this joint"
    )

    safety: ClassVar[Safety] = harmless("sign", "offset_rad", "scale")


class BaseAt(Settings, Generic[A]):
    """Pose and velocity of a moving base in the room's frame (``base``)."""

    x: A = Field(description="address of x")
    y: A = Field(description="address of y")
    yaw: A = Field(description="address of the heading")
    vx: A | None = Field(
        None, description="address of the velocity in x; default: from the change of x"
    )
    vy: A | None = Field(
        None, description="address of the velocity in y; default: from the change of y"
    )
    yaw_rate: A | None = Field(
        None, description="address of the yaw rate; default: from the change of the heading"
    )
    scale_m: float = Field(1.0, ge=1e-9, le=1e6, description="metres, or m/s, per unit")
    scale_rad: float = Field(1.0, ge=1e-9, le=1e6, description="radians, or rad/s, per unit")

    safety: ClassVar[Safety] = harmless("scale_m", "scale_rad")

    @property
    def velocities(self) -> list[A | None]:
        """Addresses of the three velocities."""
        return [self.vx, self.vy, self.yaw_rate]


class StateAt(Settings, Generic[A]):
    """Addresses of the robot's state at the server."""

    heartbeat: A = Field(
        description="a number or a time stamp that the controller changes each time it writes the"
        " state; if it does not change, the state is stale"
    )
    mode: A | None = Field(None, description="address of the operating mode; default: none")
    automatic_values: list[Annotated[int, Field(ge=-(2**31), lt=2**32)]] = Field(
        [], max_length=64, description="values of mode that are automatic mode; others are unknown"
    )
    automatic: bool = Field(
        False,
        description="the server does not report the robot's mode, which is assumed to be "
        "automatic; without this or mode the advice is unknown",
    )
    joints: list[JointAt[A]] = Field(
        min_length=1,
        max_length=MAX_JOINTS,
        description="the joints, in the order of the robot's model",
    )
    base: BaseAt[A] | None = Field(None, description="state of a base that moves; default: none")
    scale: float = Field(
        1.0,
        ge=1e-9,
        le=1e6,
        description="rad per unit of a position (m if prismatic): 0.0174532925 for degrees",
    )
    velocity_scale: float | None = Field(
        None, ge=1e-9, le=1e6, description="rad/s per unit of a velocity; default: scale"
    )
    tick_s: float | None = Field(
        None,
        ge=1e-9,
        le=1,
        description="time per unit step of the heartbeat, needed if a velocity is left out; 1 if "
        "it is a time in seconds",
    )

    safety: ClassVar[Safety] = harmless("automatic_values", "scale", "velocity_scale", "tick_s") | {
        "automatic": LessSafe(
            other="the robot counts as in automatic mode even while its controller is in another "
            "mode"
        ),
    }

    @property
    def derives(self) -> bool:
        """Whether velocities are derived from the change of positions."""
        velocities = [joint.velocity for joint in self.joints]
        velocities += [] if self.base is None else self.base.velocities
        return None in velocities

    @property
    def places(self) -> list[tuple[str, A]]:
        """Name and address of all values to read: first the heartbeat, then the mode."""
        found = [(HEARTBEAT, self.heartbeat)]
        found += [] if self.mode is None else [(MODE, self.mode)]
        for number, joint in enumerate(self.joints, start=1):
            found.append((f"joint {number} position", joint.position))
            if joint.velocity is not None:
                found.append((f"joint {number} velocity", joint.velocity))
        if self.base is not None:
            for name in (*BASE, *BASE_VELOCITY):
                if (at := getattr(self.base, name)) is not None:
                    found.append((f"base {name}", at))
        return found

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        for what, velocities in (
            ("joints", [joint.velocity for joint in self.joints]),
            ("base", [] if self.base is None else self.base.velocities),
        ):
            if None in velocities and any(each is not None for each in velocities):
                raise ValueError(f"{what}: give the velocity of all or of none")
        if self.derives and self.tick_s is None:
            raise ValueError(
                "velocities are left out, so tick_s must give the time of a step of the heartbeat; "
                "or give the address of each velocity"
            )
        if self.tick_s is not None and not self.derives:
            raise ValueError("tick_s is used only if velocities are left out; remove it")
        if (self.mode is None) == bool(self.automatic_values):
            raise ValueError("mode and automatic_values go together; give both or neither")
        if self.mode is not None and self.automatic:
            raise ValueError("automatic: true is for robots whose mode is not read; remove it")
        seen: dict[A, str] = {}
        for name, at in self.places:
            if at in seen:
                raise ValueError(f"{name} and {seen[at]} are both at {at}; correct one")
            seen[at] = name
        return self


READS_ONLY = "it only reads the robot's state, and sends no advice"
NO_MODE = "it reads no mode, and automatic is not set, so the advice stays unknown"


class PolledLinkSettings(ConfiguredLinkSettings):
    """Settings common to these links."""

    host: str = Field(min_length=1, max_length=253, description="address of the server")
    robot_state_rate_hz: float = Field(
        50.0, ge=2, le=250, description="rate at which the state is read"
    )
    reply_timeout_s: float = Field(
        0.25,
        ge=0.01,
        le=2,
        description="maximum time for a reply; after it the connection counts as lost",
    )
    controller_delay_s: float = Field(
        0.01,
        ge=0,
        le=1,
        description="maximum time from the measurement of the joints until the server provides "
        "them",
    )
    max_state_age_s: float | None = Field(
        None,
        ge=0.001,
        le=1,
        description="a state that may be older than this on arrival is refused; default and "
        "maximum: the robot's motion.delay_s",
    )

    safety: ClassVar[Safety] = harmless("reply_timeout_s", "max_state_age_s") | {
        "controller_delay_s": LessSafe(
            below="the controller is expected to provide the joints {more:.2g} s sooner, while "
            "the robot keeps moving"
        ),
    }

    advises: ClassVar[bool] = False

    @model_validator(mode="after")
    def _no_mock(self) -> Self:
        if self.simulate is not None:
            raise ValueError(
                f"a {self.kind} link has no simulated controller; start `python -m "
                "hri_sim.robot_server`, give its address as host, and leave 'simulate' out"
            )
        return self
