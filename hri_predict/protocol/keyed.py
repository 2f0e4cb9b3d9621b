"""Messages under keys, for transports with named payloads (zenoh): ``hri/<site>/<cell>/<what>``.

One message is one payload: its E2E profile 4 frames one after another, each starting with its
length. The key names the message and the robot; a message under any other key is refused. A client
that is limited to one key by access control can therefore send nothing else.
"""

import re
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

from pydantic import StringConstraints

from hri_predict.protocol import e2e
from hri_predict.protocol.codec import robot_of
from hri_predict.protocol.definition import BY_TYPE, frame_table
from hri_predict.protocol.messages import Acknowledge, Message, RobotState
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.profile4 import MAX_FRAME, Profile4Payloads, Profile4Sender

ROOT = "hri"
SCENE = "scene"  # the key of a source's scenes, which this protocol does not define
MAX_PAYLOAD = 16_384  # bytes; a Pose of 255 joints in 37 frames takes 2600
NAME = r"[A-Za-z0-9_-]{1,48}"
Name = Annotated[str, StringConstraints(pattern=f"^{NAME}$")]
"""Name of a site or cell, one chunk of a key: letters, digits, ``_`` and ``-``."""

_FULL = re.compile(f"{ROOT}/({NAME})/({NAME})/([a-z]+(?:/[0-9])?)")


@dataclass(frozen=True, slots=True)
class Keyed:
    """A payload and its key: the full key, or the part within the cell (``advice/0``).

    ``heard_ns``: time of arrival on this machine's monotonic clock; ``None``: not recorded.
    """

    key: str
    data: bytes
    heard_ns: int | None = field(default=None, compare=False)


class CellKey(NamedTuple):
    """The parts of a full key."""

    site: str
    cell: str
    what: str


def prefix(site: str, cell: str) -> str:
    """The prefix of a key that names the cell, with a trailing slash."""
    return f"{ROOT}/{site}/{cell}/"


def split_key(key: str) -> CellKey | None:
    """Return site, cell and the rest; ``None`` if the key does not follow this scheme."""
    found = _FULL.fullmatch(key)
    return CellKey(*found.groups()) if found else None


def key_of(message: Message) -> str:
    """Return the key of a message within its cell."""
    return _key(type(message), robot_of(message))


def _key(kind: type[Message], robot: int) -> str:
    definition = BY_TYPE[kind]
    name = _SHORT.get(kind, definition.name.lower())
    return f"{name}/{robot}" if definition.per_robot else name


_SHORT: dict[type, str] = {RobotState: "state", Acknowledge: "ack"}
_DATA_IDS = {
    _key(definition.type, robot): e2e.data_id_32(number).to_bytes(4, "big")
    for number, (definition, robot, _) in frame_table(classic=False).items()
}


class KeyedSender:
    """Encodes the messages of one cell and keeps their counters."""

    def __init__(self) -> None:
        self._frames = Profile4Sender()

    def watch(self, own: OwnFrames) -> None:
        """Let ``own`` remember the frames sent."""
        self._frames.own = own

    def encode(self, message: Message) -> Keyed:
        """Return the message with its key within the cell.

        Raises:
            ValueError: a field cannot hold its value.
        """
        return Keyed(key_of(message), b"".join(self._frames.encode(message)))


class KeyedReceiver(Profile4Payloads):
    """Decodes the messages of one cell; it counts errors and continues."""

    def feed(self, unit: Keyed) -> list[Message]:
        """Return the fresh messages of one payload; a Zone or Pose may come in several pieces."""
        data_id = _DATA_IDS.get(unit.key)
        if data_id is None or not 0 < len(unit.data) <= MAX_PAYLOAD:
            self.counters.malformed += 1
            return []
        messages: list[Message] = []
        at = 0
        while at < len(unit.data):
            length = int.from_bytes(unit.data[at : at + 2], "big")
            if not e2e.PROFILE_4_HEADER <= length <= min(MAX_FRAME, len(unit.data) - at):
                self.counters.malformed += 1  # the start of the next frame is unknown
                break
            frame = unit.data[at : at + length]
            at += length
            if frame[4:8] != data_id:  # checked before the counter
                self.counters.malformed += 1
                continue
            message = self._frames.take(frame)
            if message is not None:
                messages.append(message)
        return messages
