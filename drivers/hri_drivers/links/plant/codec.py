"""Messages as registers, and a PLC's registers as messages."""

import math
from collections.abc import Callable, Sequence

from hri_drivers.links.plant.image import Block
from hri_drivers.links.plant.nearest import Nearest, Seen
from hri_predict.base.settings import Pose
from hri_predict.contracts.link import LinkCounters
from hri_predict.protocol.definition import SCHEMA_HASH
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Message,
    OperatingMode,
    RobotMode,
    RobotState,
    SetChoice,
    Status,
    Zone,
)
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.protocol.registers import (
    CHOOSE_BASE,
    CHOSEN,
    MAP_VERSION,
    NEAREST,
    NO_ANGLE,
    NO_PERSON,
    NO_STATE,
    NODE,
    NOT_AVAILABLE,
    ROBOT,
    SETS,
    SETS_BASE,
    STATE,
    STATE_BASE,
    STATE_STRIDE,
    WRITE_BASE,
    WRITTEN,
    nearest_address,
    offset_of,
    packed,
    robot_address,
    unpacked,
    words_of,
)
from hri_predict.protocol.robot_state import MAX_JOINTS

BITRATE = 10_000_000
OVERHEAD_BYTES = 120
"""Maximum bytes of Ethernet, IPv6, TCP and Modbus around the registers of one reply."""
_ACK_AT = offset_of(WRITTEN, "ACK_LATCH_ID")
_MODES = frozenset(RobotMode)
_REQUESTS = frozenset(OperatingMode)


class RegisterCodec:
    """Registers of the node and of its robots; see ``hri_drivers.links.codec.Codec``.

    Args:
        plc_timeout_s: a PLC's heartbeat unchanged for longer counts as stopped.
        refused: returns the number of write requests that the server refused.

    Attributes:
        now_ns: time of the next block to encode or decode, on the node's clock.
        alive: whether the PLC's heartbeat has changed within ``plc_timeout_s``; ``None`` before the
            first one.
        counters: see ``contracts.link.Receiver``.
    """

    def __init__(self, plc_timeout_s: float = 1.0, refused: Callable[[], int] = lambda: 0) -> None:
        self.now_ns = 0
        self.counters = ReceiveCounters()
        self._plc_timeout_ns = round(plc_timeout_s * 1e9)
        self._refused = refused
        self._nearest: dict[int, Nearest] = {}
        self._people: int | None = None  # before the first Status
        self._permits: dict[int, float] = {}  # robot -> age of an advice that permits motion, s
        self._heartbeat = self._ack_taken = 0
        self._advices: dict[int, int] = {}
        self._beat: int | None = None
        self._beaten_ns: int | None = None
        self._ack: list[int] | None = None
        self._set_counter: int | None = None
        self._down = 0  # ACK_ID of the press that has not been released

    def stand(self, robots: Sequence[int], bases: Sequence[Pose | None]) -> None:
        """Set the robots of this link, and the poses of their bases in the room."""
        self._nearest = {r: Nearest(base) for r, base in zip(robots, bases, strict=True)}

    @property
    def alive(self) -> bool | None:
        """See the class."""
        if self._beaten_ns is None:
            return None
        return self.now_ns - self._beaten_ns < self._plc_timeout_ns

    def carries(self, message: Message) -> bool:
        """Status, Advice, and the zones at the time of the capture."""
        if isinstance(message, Zone):
            return message.step == 0 and bool(self._nearest)
        return isinstance(message, Status | Advice)

    def watch(self, own: OwnFrames) -> None:
        """Do nothing: the node is the only server at its port, and its frames never return."""

    def encode(self, message: Message) -> list[Block]:
        """Blocks of one message."""
        if isinstance(message, Status):
            changed = message.people != self._people
            status = self._status(message)
            near = map(self._near, self._nearest if changed else ())
            return [status, *near, *_sets(message)]
        if isinstance(message, Advice):
            return [self._advice(message), self._near(message.robot)]
        assert isinstance(message, Zone)
        for nearest in self._nearest.values():
            nearest.take(message, self.now_ns)
        return [self._near(robot) for robot in self._nearest]

    def _status(self, status: Status) -> Block:
        self._people = status.people
        self._heartbeat = (self._heartbeat + 1) % (1 << 16)
        values = {
            "MAP_VERSION": MAP_VERSION,
            "HEARTBEAT": self._heartbeat,
            "NODE_STATE": int(status.node_state),
            "NODE_REASON": int(status.reason),
            "PEOPLE": status.people,
            "NODE_AGE": _age(status.age_s),
            "PROTOCOL_HASH": SCHEMA_HASH,
            "ACK_TAKEN": self._ack_taken,
            "WRITES_REFUSED": (self._refused() + self.counters.malformed) % (1 << 16),
            "PLC_ALIVE": int(self.alive is True),
        }
        return Block.of(0, packed(NODE, values))

    def _advice(self, advice: Advice) -> Block:
        robot = advice.robot
        self._advices[robot] = (self._advices.get(robot, 0) + 1) % (1 << 16)
        limit = advice.speed_limit_m_s
        permits = advice.level.may_move and limit is not None and math.isfinite(limit)
        self._permits.pop(robot, None)
        if advice.level.may_move and advice.age_s is not None:
            self._permits[robot] = advice.age_s
        values = {
            "LEVEL": int(advice.level),
            "SPEED_LIMIT": _speed(limit or 0.0) if permits else 0,
            "REASON": int(advice.reason),
            "AGE": _age(advice.age_s),
            "ADVICE_COUNTER": self._advices[robot],
            "LATCH_ID": advice.latch_id,
            "OPERATING_MODE": int(advice.mode),
            "TOOL": _index(advice.tool),
            "SEPARATION": _milli(advice.separation_m),
            "PREDICTED_SEPARATION": _milli(advice.predicted_separation_m),
            "TIME_TO_BREACH": _milli(advice.time_to_breach_s),
            "BODY_PART": _index(advice.body_part),
            "POSTED": self.now_ns // 1_000_000 % (1 << 32),
        }
        if advice.age_s is None:  # nothing bounds it: as an old one
            values |= {"LEVEL": 0, "SPEED_LIMIT": 0}
        return Block.of(robot_address(robot), packed(ROBOT, values))

    def _near(self, robot: int) -> Block:
        """Registers of the nearest person: unknown, none, or distance and angle."""
        values: dict[str, int] = {}
        nearest = self._nearest.get(robot)
        age_s = self._permits.get(robot)
        if self._people == 0:
            if age_s is not None:  # the node sees an empty room, or the robot could not move
                values = {"NEAREST": NO_PERSON, "NEAREST_AGE": _age(age_s)}
        elif nearest is not None and (seen := self._seen(nearest)) is not None:
            angle = round(math.degrees(seen.angle_rad) * 10)
            values = {
                "NEAREST": math.floor(min(seen.distance_m * 1e3, NO_PERSON - 1)),
                "NEAREST_ANGLE": angle & 0xFFFF,
                "NEAREST_PERSON": seen.person & 0xFFFF,
                "NEAREST_AGE": _age(seen.age_s),
            }
        if "NEAREST_ANGLE" not in values:
            values["NEAREST_ANGLE"] = NO_ANGLE
        return Block.of(nearest_address(robot), packed(NEAREST, values))

    def _seen(self, nearest: Nearest) -> Seen | None:
        return None if self._people is None else nearest.at(self._people, self.now_ns)

    def decode(self, unit: Block) -> list[Message]:
        """Return the messages that a PLC has written; writes outside the map are counted."""
        words, address = unit.words, unit.address
        robot, at = divmod(address - STATE_BASE, STATE_STRIDE)
        message: Message | None = None
        if address == WRITE_BASE and len(words) in (1, words_of(WRITTEN)):
            self._take_beat(words[0])
            message = self._pressed(words[_ACK_AT:]) if len(words) > 1 else None
        elif address == WRITE_BASE + _ACK_AT and len(words) == words_of(WRITTEN) - _ACK_AT:
            message = self._pressed(words)
        elif robot >= 0 and at == 0 and len(words) == words_of(STATE):
            message = self._state(robot, words)
            self.counters.malformed += message is None
        elif address == CHOOSE_BASE and len(words) == words_of(CHOSEN):
            message = self._choice(*words)
        else:
            self.counters.malformed += 1
        self.counters.received += message is not None
        return [] if message is None else [message]

    feed = decode
    """See ``contracts.link.Receiver``."""

    def _take_beat(self, beat: int) -> None:
        if beat != self._beat:
            self._beat, self._beaten_ns = beat, self.now_ns

    def _pressed(self, words: list[int]) -> Acknowledge | None:
        """Return a press or its release if the pair has changed.

        PLCs write the same registers repeatedly. The release has the press's ACK_ID, and 0 as
        ACK_LATCH_ID; a 0 with any other ACK_ID is ignored.
        """
        if words == self._ack:
            return None
        self._ack = words
        latch_id, ack_id = words[0], words[1] << 16 | words[2]
        if not ack_id or (not latch_id and ack_id != self._down):
            return None
        self._down = ack_id if latch_id else 0
        self._ack_taken = ack_id
        return Acknowledge(latch_id, ack_id)

    def _choice(self, number: int, counter: int) -> SetChoice | None:
        """A choice of a set, if its counter has changed: a gateway may repeat old writes.

        So the first write after the server's start chooses nothing.
        """
        before, self._set_counter = self._set_counter, counter
        return SetChoice(number) if before not in (None, counter) else None

    def _state(self, robot: int, words: list[int]) -> RobotState | None:
        values = unpacked(STATE, words)
        joints = values["JOINTS"]
        if robot not in self._nearest or not 1 <= joints <= MAX_JOINTS:
            return None
        mode, request = values["ROBOT_MODE"], values["REQUEST"]
        tool = values["STATE_TOOL"]
        return RobotState(
            robot=robot,
            mode=RobotMode(mode) if mode in _MODES else RobotMode.UNKNOWN,
            counter=values["STATE_COUNTER"],
            positions=tuple(_micro(values[f"POSITION_{j + 1}"]) for j in range(joints)),
            velocities=tuple(_micro(values[f"VELOCITY_{j + 1}"]) for j in range(joints)),
            request=(OperatingMode(request) if request in _REQUESTS else OperatingMode.AUTOMATIC),
            enabling=values["ENABLING"] == 1,
            tool=None if tool > 254 else tool,
            tool_confirmed=values["TOOL_CONFIRMED"] == 1,
        )

    def reset(self) -> None:
        """Discard the PLC's state: the server has restarted."""
        self._beat = self._beaten_ns = self._ack = None
        self._down = 0
        self._set_counter = None

    def count(self, counters: LinkCounters) -> None:
        """Copy the counts of refused writes."""
        counters.malformed = self.counters.malformed + self._refused()

    def worst_s(self, message: Message) -> float:
        """Seconds on the network of one reply with all registers of a robot."""
        return 8 * (OVERHEAD_BYTES + 2 * words_of(ROBOT + NEAREST)) / BITRATE

    def unit_s(self, unit: Block) -> float:
        """Seconds on the network of one reply with these registers."""
        return 8 * (OVERHEAD_BYTES + len(unit.data)) / BITRATE

    def raw(self, unit: Block) -> bytes:
        """The address and the words, big-endian."""
        return unit.address.to_bytes(2, "big") + unit.data

    def size(self, unit: Block) -> int:
        """Number of bytes of the words."""
        return len(unit.data)


def _sets(status: Status) -> list[Block]:
    """Registers of the configuration sets, if any."""
    if status.set_number is None:
        return []
    values = {"SET_IN_FORCE": status.set_number, "SET_HASH": status.set_hash or 0}
    return [Block.of(SETS_BASE, packed(SETS, values))]


def _age(age_s: float | None) -> int:
    """Milliseconds, rounded up; 65535 for no value."""
    if age_s is None or not math.isfinite(age_s):
        return NOT_AVAILABLE
    return math.ceil(min(max(age_s, 0.0) * 1e3, NOT_AVAILABLE - 1))


def _milli(value: float | None) -> int:
    """Thousandths, rounded down; 65535 for no value."""
    if value is None or not math.isfinite(value):
        return NOT_AVAILABLE
    return math.floor(min(max(value, 0.0) * 1e3, NOT_AVAILABLE - 1))


def _speed(limit_m_s: float) -> int:
    """The limit in mm/s, rounded down."""
    return math.floor(min(max(limit_m_s, 0.0) * 1e3 + 1e-6, NOT_AVAILABLE - 1))


def _index(value: int | None) -> int:
    return NOT_AVAILABLE if value is None else value


def _micro(value: int) -> float:
    """A joint's value in rad or m; NaN if the PLC does not know it."""
    return math.nan if value == NO_STATE else value * 1e-6
