"""The Modbus register map: the one definition of ``drivers/MODBUS.md``, server and PLC code.

A register is a 16-bit word; a value of two words has the high word first (big-endian). The node's
registers are read by function 3 or 4, those of the PLC are written by function 6 or 16.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from hri_predict.protocol.fields import MAX_ROBOTS
from hri_predict.protocol.robot_state import MAX_JOINTS

MAP_VERSION = 1
"""Rises with every change that a PLC must follow."""
NOT_AVAILABLE = 0xFFFF
NO_PERSON = 0xFFFE
"""Value of NEAREST_MM: the sensor sees the room, and it is empty of people."""
NO_ANGLE = 0x8000
NO_STATE = -(2**31)
"""A position or velocity that the PLC does not know."""
ROBOT_BASE, ROBOT_STRIDE = 100, 40
SETS_BASE = 20
WRITE_BASE, CHOOSE_BASE = 1000, 1010
STATE_BASE, STATE_STRIDE = 1100, 60


@dataclass(frozen=True, slots=True)
class Register:
    """One value of the map.

    Attributes:
        name: in capitals, as PROTOCOL.md names the field where there is one.
        text: its meaning.
        unit: "" for a plain number.
        words: 1 or 2.
        signed: whether the value is in two's complement.
        stale: its value without fresh data; ``None``: it keeps its value.
    """

    name: str
    text: str
    unit: str = ""
    words: int = 1
    signed: bool = False
    stale: int | None = 0


NODE = (
    Register("MAP_VERSION", f"{MAP_VERSION}; a PLC of another version stops", stale=None),
    Register("HEARTBEAT", "advances with each Status of the node, modulo 65536", stale=None),
    Register("NODE_STATE", "see PROTOCOL.md, node states"),
    Register("NODE_REASON", "worst active condition; see PROTOCOL.md, reasons"),
    Register("PEOPLE", "people in the room, lost ones included", stale=NOT_AVAILABLE),
    Register("NODE_AGE", "age of the newest capture, now", "ms", stale=NOT_AVAILABLE),
    Register(
        "PROTOCOL_HASH", "hash of PROTOCOL.md's definition: numbers of reasons", words=2, stale=None
    ),
    Register("ACK_TAKEN", "ACK_ID of the newest press that reached the node", words=2, stale=None),
    Register("WRITES_REFUSED", "requests to write that were refused, modulo 65536", stale=None),
    Register("PLC_ALIVE", "1: PLC_HEARTBEAT has changed within plc_timeout_s"),
)
ROBOT = (
    Register("LEVEL", "1 clear, 2 warn, 3 slow: the robot may move; every other value: stop"),
    Register("SPEED_LIMIT", "for the robot's fastest point; 0: stop", "mm/s"),
    Register("REASON", "see PROTOCOL.md, reasons; 65535: no fresh Advice", stale=NOT_AVAILABLE),
    Register("AGE", "age of the advice's capture, now", "ms", stale=NOT_AVAILABLE),
    Register("ADVICE_COUNTER", "advances with each Advice, modulo 65536", stale=None),
    Register("LATCH_ID", "what an acknowledge would end now; 0: nothing"),
    Register("OPERATING_MODE", "in force: 0 automatic, 1 teach, 2 recovery, 3 muted"),
    Register("TOOL", "tool set that the node counts with; 65535: none is named", stale=65535),
    Register("SEPARATION", "smallest distance now, less deductions", "mm", stale=65535),
    Register("PREDICTED_SEPARATION", "by the time it can have stopped", "mm", stale=65535),
    Register("TIME_TO_BREACH", "65535: none is expected", "ms", stale=NOT_AVAILABLE),
    Register("BODY_PART", "index of the deciding segment", stale=NOT_AVAILABLE),
    Register("POSTED", "when the node posted the advice, its own clock", "ms", words=2, stale=None),
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
        "where that point is: from the base's x axis towards its y axis; -32768: not available",
        "0.1 deg",
        signed=True,
        stale=NO_ANGLE,
    ),
    Register("NEAREST_PERSON", "id of that person", stale=NOT_AVAILABLE),
    Register("NEAREST_AGE", "age of the capture that shows it, now", "ms", stale=NOT_AVAILABLE),
)
WRITTEN = (
    Register("PLC_HEARTBEAT", "any number that changes"),
    Register("ACK_LATCH_ID", "LATCH_ID that was shown when the button went down; 0: it is up"),
    Register("ACK_ID", "another number for each press, not 0; its release has the same", words=2),
)
SETS = (
    Register("SET_IN_FORCE", "number of the set in force; 0: none is, or it changes just now"),
    Register("SET_HASH", "its hash, as `hri-predict check` prints it; 0: none", words=2),
)
CHOSEN = (
    Register("SET_NUMBER", "number of the configuration set to use"),
    Register("SET_COUNTER", "another number with each write: one that stays is an old choice"),
)
STATE = (
    Register("STATE_COUNTER", "advances by 1 with every state, modulo 65536"),
    Register("ROBOT_MODE", "see PROTOCOL.md, robot modes"),
    Register("JOINTS", f"number of joints, 1 to {MAX_JOINTS}"),
    Register("REQUEST", "operating mode that the operator asks for"),
    Register("ENABLING", "1: the enabling device is held"),
    Register("STATE_TOOL", "number of the tool set in use; 65535: not said"),
    Register("TOOL_CONFIRMED", "1: the controller has checked it"),
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
    """Return the words of a block; what is not given is stale, what does not fit is limited."""
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
    """Address of the first register into which a PLC writes the robot's state."""
    return STATE_BASE + STATE_STRIDE * robot


def nearest_address(robot: int) -> int:
    """Address of the first register about the person nearest to a robot."""
    return robot_address(robot) + words_of(ROBOT)


READ_WORDS = robot_address(MAX_ROBOTS)
"""Registers 0 to this one less 1 are the node's; those without a name are 0."""
