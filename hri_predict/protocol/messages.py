"""The messages between node and controller, in physical units; ``None`` means "not available".

How each field travels (bits, scaling, frames) stands in ``definition``; nothing else knows it.
"""

from dataclasses import dataclass, replace
from enum import IntEnum

from hri_predict.reasons import Reason


class Level(IntEnum):
    """What a robot is asked to do; whatever is not CLEAR, WARN or SLOW means stop."""

    UNKNOWN = 0
    CLEAR = 1
    WARN = 2
    SLOW = 3
    STOP = 4
    FAULT = 5


class NodeState(IntEnum):
    """Life cycle of the node."""

    UNKNOWN = 0
    STARTING = 1
    RUNNING = 2
    DEGRADED = 3
    FAULT = 4
    STOPPING = 5


class RobotMode(IntEnum):
    """Operating mode that the controller reports."""

    UNKNOWN = 0
    AUTOMATIC = 1
    MANUAL = 2
    MAINTENANCE = 3
    DRIVES_OFF = 4


@dataclass(frozen=True, slots=True)
class Status:
    """How the node is: sent every cycle, input or not.

    ``reason`` is the worst condition, ``predictor`` the predictor's index, ``capture_ns`` (not on
    the wire) the newest good capture, from which ``age_s`` is filled at encoding.
    """

    node_state: NodeState
    reason: Reason
    people: int
    predictor: int
    cycle: int
    age_s: float | None = None
    capture_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Advice:
    """What the node asks of one robot, why, and what it rests on.

    Attributes:
        robot: the robot's index in the configuration.
        level, reason: what is asked, and why.
        latch_id: id of a latched stop, 0 when none is latched.
        separation_m: smallest distance now between a body and the robot, less what the mode takes.
        predicted_separation_m: smallest distance until the robot would have stopped.
        time_to_breach_s: until the separation may be violated, 0 when it is.
        speed_limit_m_s: of the fastest point of the robot; ``None`` means 0.
        body_part: index of the body segment that decides.
        robot_link: index of the robot capsule that decides.
        echo: counter of the last RobotState from the link that this is sent on (link fills it).
        age_s: age of the capture at encoding (link fills it from ``capture_ns``).
        capture_ns: not on the wire.
        detail: not on the wire; names, for people.
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
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ZoneCapsule:
    """The capsule of one body segment: ends ``a``, ``b`` and ``radius`` in metres, room frame."""

    segment: int
    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float


@dataclass(frozen=True, slots=True)
class Zone:
    """Where the segments of one person may be at one horizon."""

    person: int
    step: int
    horizon_s: float
    capsules: tuple[ZoneCapsule, ...]
    age_s: float | None = None
    capture_ns: int | None = None


@dataclass(frozen=True, slots=True)
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
    """Protocol version and hash of the definitions: until it matches, all is unknown."""

    version: int
    hash: int


@dataclass(frozen=True, slots=True)
class RobotState:
    """Where the robot is: rad and rad/s, up to 7 joints; ``counter`` 0..65535 advances."""

    robot: int
    mode: RobotMode
    counter: int
    positions: tuple[float, ...]
    velocities: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """A person's acknowledgement of the latched stop ``latch_id`` (0: of a lost person).

    ``ack_id`` is the sender's own number, non-zero: repeats of one number count once.
    """

    latch_id: int
    ack_id: int


Message = Status | Advice | Zone | Pose | Schema | RobotState | Acknowledge


def at_encoding(message: Message, now_ns: int, echo: int | None = None) -> Message:
    """Fill what is only known when the message goes out: its age, and an Advice's echo."""
    if isinstance(message, Status | Advice | Zone | Pose) and message.capture_ns is not None:
        message = replace(message, age_s=max(0.0, (now_ns - message.capture_ns) * 1e-9))
    if isinstance(message, Advice) and echo is not None:
        message = replace(message, echo=echo)
    return message
