"""Messages as ROS 2 publications: one protected frame, and plain messages with the same content."""

from dataclasses import dataclass
from typing import Literal

from hri_drivers.links.codec import FrameCodec
from hri_drivers.links.ros2.joint_states import JointStateReader
from hri_predict.protocol import e2e
from hri_predict.protocol.definition import BY_TYPE, frame_table
from hri_predict.protocol.messages import Advice, Message, Pose, Schema, Status, Zone
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.profile4 import MAX_FRAME, Profile4Payloads, Profile4Sender
from hri_predict.protocol.ros.markers import PARTS
from hri_predict.protocol.ros.plain import PlainMessages, Sample
from hri_predict.protocol.wire import wire_bits

SAMPLE_BYTES = 320
"""Largest overhead of a sample and its acknowledgement on Ethernet: 38 + 48 bytes of Ethernet, IPv6
and UDP each, 88 of RTPS with time and heartbeat, 52 of its acknowledgement."""
ADVICE_BYTES, STATUS_BYTES, MARKER_BYTES = 2600, 500, 420
"""Largest plain content of an Advice (diagnostics included), of a Status, and of one marker. Tests
compare them with encoded messages; a frame_id has at most 64 bytes."""
FRAMES: dict[str, Literal["frames", "controller_frames"]] = {
    "node": "frames",
    "controller": "controller_frames",
}
"""Topic of the protected frames for each sender."""
_TOPICS = {
    e2e.data_id_32(number).to_bytes(4, "big"): FRAMES[definition.sender]
    for number, (definition, _, _) in frame_table(classic=False).items()
}
JOINT_BYTES = 80
"""Maximum bytes of one joint in a JointState: a name of 40, position, velocity, effort, lengths."""
JOINT_STATES: Literal["joint_states"] = "joint_states"
Topic = Literal["frames", "controller_frames", "joint_states"]
BONE_BYTES = 48 + 56  # of a joint in a forecast's markers and in its PoseArray


@dataclass(frozen=True, slots=True)
class Publication:
    """A unit of the wire.

    Attributes:
        data: a frame of E2E profile 4; a unit of ``Heard`` with a JointState; empty for Zone and
            Pose.
        topic: topic of the frame, or ``joint_states``.
        plain: the same data for readers of plain ROS 2 messages; empty for a received publication.
    """

    data: bytes
    topic: Topic = "frames"
    plain: tuple[Sample, ...] = ()


class FramesReceiver(Profile4Payloads):
    """Decodes the messages of ``frames`` or ``controller_frames``; counts errors and continues."""

    def feed(self, unit: Publication) -> list[Message]:
        """Return the message of a frame if it is whole, fresh, and on its sender's topic."""
        if unit.topic == JOINT_STATES:
            self.counters.ignored += 1
            return []
        topic = _TOPICS.get(unit.data[4:8], unit.topic)
        if not 0 < len(unit.data) <= MAX_FRAME or topic != unit.topic:
            self.counters.malformed += 1  # before its counter is compared
            return []
        message = self._frames.take(unit.data)
        return [] if message is None else [message]


class Ros2Codec(FrameCodec[Publication]):
    """See ``hri_drivers.links.codec.Codec``; Zone and Pose are sent as plain messages only.

    Args:
        plain: makes the plain messages.
        bitrate: bandwidth of the network that the link may use, bit/s.
        states: reads JointStates into the counters of ``receiver``; ``None``: no JointStates.
        receiver: reads frames.
    """

    def __init__(
        self,
        plain: PlainMessages,
        bitrate: float,
        states: JointStateReader | None = None,
        receiver: FramesReceiver | None = None,
    ) -> None:
        super().__init__(receiver or FramesReceiver())
        self.plain = plain
        self.states = states
        self._bitrate = bitrate
        self._sender = Profile4Sender()

    def watch(self, own: OwnFrames) -> None:
        """See ``Codec``."""
        self._sender.own = own
        self._receiver.watch(own)

    def encode(self, message: Message) -> list[Publication]:
        """One publication."""
        plain = tuple(self.plain.of(message))
        if isinstance(message, Zone | Pose):
            return [Publication(b"", plain=plain)]
        (frame,) = self._sender.encode(message)
        return [Publication(frame, FRAMES[BY_TYPE[type(message)].sender], plain)]

    def decode(self, unit: Publication) -> list[Message]:
        """Messages in a publication."""
        if self.states is not None and unit.topic == JOINT_STATES:
            state = self.states.read(unit.data)
            return [] if state is None else [state]
        return super().decode(unit)

    @property
    def refused(self) -> str:
        """The reason for the last refusal of a JointState; see ``ConfiguredLink``."""
        return "" if self.states is None else self.states.refused

    def worst_s(self, message: Message) -> float:
        """Worst-case seconds on the network of the message."""
        return worst_bits(message) / self._bitrate

    def unit_s(self, unit: Publication) -> float:
        """Seconds on the network of this publication."""
        samples = len(unit.plain) + bool(unit.data)
        return 8 * (samples * SAMPLE_BYTES + self.size(unit)) / self._bitrate

    def raw(self, unit: Publication) -> bytes:
        """The frame; for a Zone or Pose its first plain message."""
        return unit.data or unit.plain[0].data

    def size(self, unit: Publication) -> int:
        """Number of payload bytes."""
        return len(unit.data) + sum(len(sample.data) for sample in unit.plain)


def worst_bits(message: Message | type[Message]) -> int:
    """Worst-case bits on the network of one message: frame, plain messages, overhead."""
    kind = message if isinstance(message, type) else type(message)
    frame = 0 if kind in (Zone, Pose) else wire_bits(kind, "serial").nominal * 8 // 10
    samples, content = 1 + bool(frame), 0
    match message:
        case Zone():
            content = 2 * MARKER_BYTES * min(len(message.capsules), PARTS // 2)
        case Pose():
            samples, content = 2, 2 * MARKER_BYTES + BONE_BYTES * len(message.joints)
    if kind is Advice:
        samples, content = 5, ADVICE_BYTES
    elif kind is Status:
        samples, content = 2, STATUS_BYTES
    elif kind is Schema:
        samples = 1
    return frame + 8 * (samples * SAMPLE_BYTES + content)
