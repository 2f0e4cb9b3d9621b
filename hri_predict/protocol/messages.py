"""The messages between node and controller, in physical units; ``None`` means "not available".

Only ``definition`` defines the encoding of each field (bits, scaling, frames).
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, NamedTuple

from hri_predict.protocol.reasons import Reason


class Level(IntEnum):
    """Request to a robot; any value except CLEAR, WARN and SLOW means stop."""

    UNKNOWN = 0
    CLEAR = 1
    WARN = 2
    SLOW = 3
    STOP = 4
    FAULT = 5

    @property
    def rank(self) -> int:
        """Severity for the robot: 0 for CLEAR, 3 for STOP, UNKNOWN and FAULT, which all stop it.

        Advice is decided, combined and compared in this order (docs/decisions/levels.md).
        """
        return min(_URGENCY[self], _URGENCY[Level.STOP])

    @property
    def may_move(self) -> bool:
        """Whether the robot may move at all."""
        return self in _MAY_MOVE

    @property
    def urgency(self) -> int:
        """Severity for people: like ``rank``, but UNKNOWN exceeds STOP, and FAULT exceeds both.

        Screens and alerts use this order to choose the level to show: a stop clears when people
        step back, but *unknown* and *fault* must be fixed.
        """
        return _URGENCY[self]


LEVELS = (Level.CLEAR, Level.WARN, Level.SLOW, Level.STOP, Level.UNKNOWN, Level.FAULT)
"""All levels, least urgent first."""
_URGENCY = {level: urgency for urgency, level in enumerate(LEVELS)}
_MAY_MOVE = frozenset((Level.CLEAR, Level.WARN, Level.SLOW))


class NodeState(IntEnum):
    """Life cycle of the node."""

    UNKNOWN = 0
    STARTING = 1
    RUNNING = 2
    DEGRADED = 3
    FAULT = 4
    STOPPING = 5


class RobotMode(IntEnum):
    """Operating mode reported by the controller."""

    UNKNOWN = 0
    AUTOMATIC = 1
    MANUAL = 2
    MAINTENANCE = 3
    DRIVES_OFF = 4


class OperatingMode(IntEnum):
    """Operating mode: as requested (RobotState), or in force (Advice)."""

    AUTOMATIC = 0
    TEACH = 1
    RECOVERY = 2
    MUTED = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """State of the node, sent every cycle even without input.

    ``reason`` is the worst active condition, ``predictor`` the predictor's index. ``capture_ns`` is
    the time of the newest good capture; it is not sent, but ``age_s`` is computed from it at
    encoding. ``set_number`` and ``set_hash`` identify the configuration set in force, for register
    maps only: 0 if no set is in force, ``None`` if no sets are configured.
    """

    node_state: NodeState
    reason: Reason
    people: int
    predictor: int
    cycle: int
    age_s: float | None = None
    capture_ns: int | None = None
    set_number: int | None = None
    set_hash: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """The node's advice to one robot, its reason and its capture.

    Attributes:
        robot: the robot's index in the configuration.
        level, reason: the request, and the reason for it.
        latch_id: id that an Acknowledge must carry now to end a latch or lost people; it is never
            reused. 0: there is nothing to acknowledge.
        separation_m: smallest distance between a body and the robot now, minus the deductions of
            the mode.
        predicted_separation_m: smallest distance until the robot can have stopped.
        time_to_breach_s: time until the separation may be violated; 0 if it already is.
        speed_limit_m_s: limit for the robot's fastest point; ``None`` means 0.
        body_part: index of the deciding body segment.
        robot_link: index of the deciding robot capsule.
        echo: counter of the last RobotState received on the same link; filled in by the link.
        age_s: age of the capture at encoding; the link computes it from ``capture_ns``.
        capture_ns: time of the capture, node's clock; not sent.
        mode: the operating mode in force.
        tool: number of the tool set that the node assumes; ``None``: no tool is named, or the worst
            case over all tools is assumed.
        detail: one line for people, with names; not sent.
    """

    robot: int
    level: Level
    reason: Reason
    latch_id: int = 0
    separation_m: float | None = None
    predicted_separation_m: float | None = None
    time_to_breach_s: float | None = None
    speed_limit_m_s: float | None = None
    body_part: int | None = None
    robot_link: int | None = None
    echo: int | None = None
    age_s: float | None = None
    capture_ns: int | None = None
    mode: OperatingMode = OperatingMode.AUTOMATIC
    tool: int | None = None
    detail: str = ""


class ZoneCapsule(NamedTuple):
    """The capsule of one body segment: ends ``a``, ``b`` and ``radius`` in metres, room frame.

    A named tuple, because a tick with many people creates hundreds, and a dataclass takes three
    times as long.
    """

    segment: int
    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Zone:
    """Space that the body segments of one person may occupy at one horizon."""

    person: int
    step: int
    horizon_s: float
    capsules: tuple[ZoneCapsule, ...]
    age_s: float | None = None
    capture_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Predicted joints of one person at one horizon: (joint index, x, y, z), metres, room frame."""

    person: int
    step: int
    horizon_s: float
    joints: tuple[tuple[int, float, float, float], ...]
    age_s: float | None = None
    capture_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Schema:
    """Protocol version and definition hash; receivers discard all messages unless both match."""

    version: int
    hash: int


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseMotion:
    """Pose and twist of a robot's base on the floor, in the room's frame: m, rad, m/s, rad/s."""

    x_m: float
    y_m: float
    yaw_rad: float
    vx_m_s: float
    vy_m_s: float
    yaw_rate_rad_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotState:
    """State of a robot, from its controller.

    Attributes:
        robot: the robot's index in the configuration.
        mode: operating mode of the controller.
        counter: counts 0..65535.
        positions, velocities: at most 9 joints, rad and rad/s; m and m/s for prismatic joints.
        request: the operating mode that the operator asks for.
        enabling: whether the enabling device is held.
        tool: number of the tool set in use; ``None``: not reported.
        tool_confirmed: whether the controller has checked the tool, for example with the tool
            changer's code.
        base: pose and velocity of the robot's base; ``None``: fixed at the configured pose.
    """

    robot: int
    mode: RobotMode
    counter: int
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    request: OperatingMode = OperatingMode.AUTOMATIC
    enabling: bool = False
    tool: int | None = None
    tool_confirmed: bool = False
    base: BaseMotion | None = None


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """A person acknowledges the ``latch_id`` of an Advice.

    The sender chooses an ``ack_id`` other than 0 for each press; repeats of the same number count
    once. A ``latch_id`` of 0 reports that the button of the press ``ack_id`` was released, which
    acknowledges nothing by itself (``node.presses``).
    """

    latch_id: int
    ack_id: int


@dataclass(frozen=True, slots=True)
class SetChoice:
    """A PLC's choice of a configuration set by number; only register maps carry it."""

    number: int


FromController = RobotState | Acknowledge | SetChoice
Message = Status | Advice | Zone | Pose | Schema | FromController


def at_encoding(message: Message, now_ns: int, echo: int | None = None) -> Message:
    """Fill in the values known only at sending: the age, and the echo of an Advice."""
    known: dict[str, Any] = {}
    if isinstance(message, Status | Advice | Zone | Pose) and message.capture_ns is not None:
        known["age_s"] = max(0.0, (now_ns - message.capture_ns) * 1e-9)
    if isinstance(message, Advice) and echo is not None:
        known["echo"] = echo
    return replace(message, **known) if known else message
