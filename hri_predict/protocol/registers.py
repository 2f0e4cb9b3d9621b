"""The Modbus register map: single definition for ``drivers/MODBUS.md``, server and PLC code.

A register is a 16-bit word; a value of two words has the high word first (big-endian). A PLC reads
the node's registers with function 3 or 4, and writes its own with function 6 or 16.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from hri_predict.protocol.fields import MAX_ROBOTS
from hri_predict.protocol.robot_state import MAX_JOINTS

MAP_VERSION = 1
"""Increases with every change that requires a change in the PLC."""
NOT_AVAILABLE = 0xFFFF
NO_PERSON = 0xFFFE
"""Value of NEAREST_MM if the sensor sees the room and no person is in it."""
NO_ANGLE = 0x8000
NO_STATE = -(2**31)
"""Value of a position or velocity that the PLC does not know."""
ROBOT_BASE, ROBOT_STRIDE = 100, 40
SETS_BASE = 20
WRITE_BASE, CHOOSE_BASE = 1000, 1010
STATE_BASE, STATE_STRIDE = 1100, 60


@dataclass(frozen=True, slots=True)
class Register:
    """One value of the map.

    Attributes:
        name: in capitals; the field's name in PROTOCOL.md, if there is one.
        text: its meaning.
        unit: "" for a plain number.
        words: 1 or 2.
        signed: whether the value is two's complement.
        stale: value without fresh data; ``None``: the last value is kept.
    """

    name: str
    text: str
    unit: str = ""
    words: int = 1
    signed: bool = False
    stale: int | None = 0


NODE = (
    Register("MAP_VERSION", f"{MAP_VERSION}; a PLC with a different version stops", stale=None),
    Register("HEARTBEAT", "advances with each Status of the node, modulo 65536", stale=None),
    Register("NODE_STATE", "see PROTOCOL.md, node states"),
    Register("NODE_REASON", "worst active condition; see PROTOCOL.md, reasons"),
    Register("PEOPLE", "people in the room, including lost ones", stale=NOT_AVAILABLE),
    Register("NODE_AGE", "age of the newest capture, now", "ms", stale=NOT_AVAILABLE),
    Register(
        "PROTOCOL_HASH",
        "hash of the definition in PROTOCOL.md, which numbers the reasons",
        words=2,
        stale=None,
    ),
    Register("ACK_TAKEN", "ACK_ID of the newest press that reached the node", words=2, stale=None),
    Register("WRITES_REFUSED", "refused write requests, modulo 65536", stale=None),
    Register("PLC_ALIVE", "1: PLC_HEARTBEAT has changed within plc_timeout_s"),
)
ROBOT = (
    Register("LEVEL", "1 clear, 2 warn, 3 slow: the robot may move; every other value: stop"),
    Register("SPEED_LIMIT", "for the robot's fastest point; 0: stop", "mm/s"),
    Register("REASON", "see PROTOCOL.md, reasons; 65535: no fresh Advice", stale=NOT_AVAILABLE),
    Register("AGE", "age of the advice's capture, now", "ms", stale=NOT_AVAILABLE),
    Register("ADVICE_COUNTER", "advances with each Advice, modulo 65536", stale=None),
    Register("LATCH_ID", "id that an Acknowledge must carry now; 0: nothing to acknowledge"),
    Register("OPERATING_MODE", "in force: 0 automatic, 1 teach, 2 recovery, 3 muted"),
    Register("TOOL", "tool set that the node assumes; 65535: none is named", stale=65535),
    Register("SEPARATION", "smallest distance now, minus deductions", "mm", stale=65535),
    Register(
        "PREDICTED_SEPARATION",
        "smallest distance until the robot can have stopped",
        "mm",
        stale=65535,
    ),
    Register(
        "TIME_TO_BREACH",
        "time until the separation may be violated; 65535: not expected",
        "ms",
        stale=NOT_AVAILABLE,
    ),
    Register("BODY_PART", "index of the deciding segment", stale=NOT_AVAILABLE),
    Register(
        "POSTED", "time when the node issued the advice, node's clock", "ms", words=2, stale=None
    ),
)
NEAREST = (
    Register(
        "NEAREST",
        "from the robot's base to the nearest person's body, in the base's x-y plane; 65534: no "
        "person in the room",
        "mm",
        stale=NOT_AVAILABLE,
    ),
    Register(
        "NEAREST_ANGLE",
        "direction of that point, from the base's x axis towards its y axis; -32768: not available",
        "0.1 deg",
        signed=True,
        stale=NO_ANGLE,
    ),
    Register("NEAREST_PERSON", "id of that person", stale=NOT_AVAILABLE),
    Register(
        "NEAREST_AGE", "age, now, of the capture that shows that person", "ms", stale=NOT_AVAILABLE
    ),
)
WRITTEN = (
    Register("PLC_HEARTBEAT", "any changing number"),
    Register(
        "ACK_LATCH_ID", "LATCH_ID shown when the button was pressed; 0: the button is released"
    ),
    Register(
        "ACK_ID", "a new number, not 0, for each press; the release uses the same number", words=2
    ),
)
SETS = (
    Register("SET_IN_FORCE", "number of the set in force; 0: none, or it is changing"),
    Register("SET_HASH", "hash of the set, as printed by `hri-predict check`; 0: none", words=2),
)
CHOSEN = (
    Register("SET_NUMBER", "number of the configuration set to use"),
    Register(
        "SET_COUNTER", "a new number with each write; an unchanged number means an old choice"
    ),
)
STATE = (
    Register("STATE_COUNTER", "advances by 1 with every state, modulo 65536"),
    Register("ROBOT_MODE", "see PROTOCOL.md, robot modes"),
    Register("JOINTS", f"number of joints, 1 to {MAX_JOINTS}"),
    Register("REQUEST", "operating mode requested by the operator"),
    Register("ENABLING", "1: the enabling device is held"),
    Register("STATE_TOOL", "number of the tool set in use; 65535: not reported"),
    Register("TOOL_CONFIRMED", "1: the controller has checked the tool"),
    Register("RESERVED", "0"),
    *(
        Register(f"{name}_{joint}", text, unit, words=2, signed=True)
        for name, text, unit in (
            ("POSITION", "-2147483648: not known", "urad, um"),
            ("VELOCITY", "-2147483648: not known", "urad/s, um/s"),
        )
        for joint in range(1, MAX_JOINTS + 1)
    ),
)


def words_of(registers: tuple[Register, ...]) -> int:
    """Number of words of a block."""
    return sum(register.words for register in registers)


def placed(registers: tuple[Register, ...]) -> Iterator[tuple[int, Register]]:
    """Yield offset and register of a block."""
    at = 0
    for register in registers:
        yield at, register
        at += register.words


def offset_of(registers: tuple[Register, ...], name: str) -> int:
    """Return the offset of a register in its block."""
    return next(at for at, register in placed(registers) if register.name == name)


def packed(registers: tuple[Register, ...], values: Mapping[str, int]) -> list[int]:
    """Return the words of a block; missing values are stale, values out of range are limited."""
    words: list[int] = []
    for register in registers:
        value = values.get(register.name, register.stale or 0)
        bits = 16 * register.words
        if not register.signed:  # the highest number is "not available"
            value = max(0, min(value, (1 << bits) - 1))
        words += [(value >> shift) & 0xFFFF for shift in range(bits - 16, -1, -16)]
    return words


def unpacked(registers: tuple[Register, ...], words: list[int]) -> dict[str, int]:
    """Return the values of a block by name."""
    values = {}
    for at, register in placed(registers):
        value = 0
        for word in words[at : at + register.words]:
            value = value << 16 | word
        if register.signed and value >> (16 * register.words - 1):
            value -= 1 << 16 * register.words
        values[register.name] = value
    return values


def robot_address(robot: int) -> int:
    """Address of the first register of a robot."""
    return ROBOT_BASE + ROBOT_STRIDE * robot


def state_address(robot: int) -> int:
    """Address of the first register to which a PLC writes the robot's state."""
    return STATE_BASE + STATE_STRIDE * robot


def nearest_address(robot: int) -> int:
    """Address of the first register for the person nearest to a robot."""
    return robot_address(robot) + words_of(ROBOT)


READ_WORDS = robot_address(MAX_ROBOTS)
"""Registers below this address belong to the node; unnamed ones are 0."""
