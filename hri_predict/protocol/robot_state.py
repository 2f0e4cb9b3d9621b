"""Definition of RobotState, whose number of parts depends on the robot.

On classic CAN, RobotState has nine parts for nine joints and a moving base, but most robots need
only five. Parts that a robot does not need are neither sent nor expected. Only part 0 (JOINTS and
BASE) determines the required parts. The receiver's configuration does not, because it could differ
from the sender's. Part 0 has the CRC and counter of its message, so it also determines which other
parts must arrive with this counter. An extra part invalidates the message, as a repeated part does.
On serial lines and zenoh the payload ends after the last needed part; on FD it is always whole, so
that each id has one length. The numbers 0x46 and 0x47 are left out: by default ISO-TP uses these
ids. The base of robots 4 to 7 has no numbers, because CANopen leaves no more ids free; robots on
several vehicles do not share a bus anyway.
"""

from hri_predict.protocol.fields import MAX_ROBOTS, Definition, Extra, Field, index_of
from hri_predict.protocol.messages import OperatingMode, RobotMode, RobotState

MAX_JOINTS = 9
BASE_ROBOTS = 4  # robots 0 to 3 may have a moving base on classic CAN


def _position(number: int) -> Field:
    """Return the field of a joint's position; "not available" if the robot has fewer joints."""
    return Field(
        signal=f"POSITION_{number}",
        bits=16,
        text=f"position of joint {number}; in m if it is prismatic",
        unit="rad",
        scale=4000,
        signed=True,
        optional=True,
        bounded=True,
    )


def _velocity(number: int) -> Field:
    """Return the field of a joint's velocity; "not available" if the robot has fewer joints."""
    return Field(
        signal=f"VELOCITY_{number}",
        bits=16,
        text=f"velocity of joint {number}; in m/s if it is prismatic",
        unit="rad/s",
        scale=1000,
        signed=True,
        optional=True,
    )


def _base(signal: str, text: str, unit: str, scale: int) -> Field:
    """Return a field of a moving base; "not available" if the base does not move."""
    return Field(
        signal=f"BASE_{signal}",
        bits=16,
        text=text,
        unit=unit,
        scale=scale,
        signed=True,
        optional=True,
        bounded=unit == "m",
    )


def _extra(part: int, number: int, robots: int, asked: tuple[str, int]) -> Extra:
    """Return an extra part; each robot has two consecutive frame numbers."""
    signal, least = asked
    return Extra(part=part, number=number, stride=2, robots=robots, signal=signal, least=least)


ROBOT_STATE = Definition(
    type=RobotState,
    number=0x03,
    text="position and motion of one robot",
    sender="controller",
    cycle_ms=20,
    priority=2,
    fields=(
        Field(
            signal="MODE",
            bits=4,
            text="operating mode of the robot",
            enum=RobotMode,
            fallback=RobotMode.UNKNOWN,
        ),
        Field(signal="JOINTS", bits=4, text=f"number of joints, at most {MAX_JOINTS}"),
        Field(
            signal="STATE_COUNTER",
            bits=16,
            text="advances by 1 with every RobotState, modulo 65536; Advice echoes it",
            wraps=True,
            attribute="counter",
        ),
        Field(
            signal="REQUEST",
            bits=8,
            text="operating mode requested by the operator",
            enum=OperatingMode,
            fallback=OperatingMode.AUTOMATIC,
        ),
        index_of("TOOL", 8, "number of the tool set in use"),
        Field(
            signal="ENABLING",
            bits=2,
            text="1: the enabling device is held; any other value: it is not held",
            flag=True,
        ),
        Field(
            signal="TOOL_CONFIRMED",
            bits=2,
            text="1: the controller has checked TOOL; any other value: not checked",
            flag=True,
        ),
        Field(
            signal="BASE",
            bits=4,
            text="0: the base does not move; 1: its motion is in BASE_X to BASE_YAW_RATE",
            attribute="base_moves",  # the class has the numbers as ``base``, or ``None``
        ),
        *(_position(i) for i in range(1, 7)),
        *(_velocity(i) for i in range(1, 7)),
        *(field(i) for i in range(7, MAX_JOINTS + 1) for field in (_position, _velocity)),
        _base("X", "position of the base on the room's floor", "m", 1000),
        _base("Y", "position of the base on the room's floor", "m", 1000),
        _base("YAW", "rotation of the base about the room's z axis, -pi to pi", "rad", 10_000),
        _base("VX", "velocity of the base in the room's frame", "m/s", 1000),
        _base("VY", "velocity of the base in the room's frame", "m/s", 1000),
        _base("YAW_RATE", "turn rate of the base", "rad/s", 1000),
    ),
    per_robot=True,
    extra=(
        _extra(5, 0x48, MAX_ROBOTS, ("JOINTS", 7)),
        _extra(6, 0x49, MAX_ROBOTS, ("JOINTS", 8)),
        _extra(7, 0x58, BASE_ROBOTS, ("BASE", 1)),
        _extra(8, 0x59, BASE_ROBOTS, ("BASE", 1)),
    ),
)
