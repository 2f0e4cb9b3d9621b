"""A received message with its origin, as one unit of bytes."""

from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Any

HEADER = Struct("<B16sq")
TF, TF_STATIC = 254, 255
"""``topic`` of ``/tf`` and ``/tf_static``."""
NO_GID = bytes(16)
NO_SEQUENCE = -1


@dataclass(frozen=True, slots=True)
class Heard:
    """One message.

    Attributes:
        topic: index of the configured topic, ``TF`` or ``TF_STATIC``.
        gid: the publisher's identity, 16 bytes; ``NO_GID`` where the middleware does not state it.
        sequence: the publisher's counter; ``NO_SEQUENCE`` where it is not stated.
        content: the message in CDR.
    """

    topic: int
    gid: bytes
    sequence: int
    content: bytes

    def packed(self) -> bytes:
        """The unit."""
        return HEADER.pack(self.topic, self.gid, self.sequence) + self.content

    @classmethod
    def of(cls, data: bytes) -> "Heard":
        """Unpack a unit.

        Raises:
            struct.error: it is shorter than its header.
        """
        topic, gid, sequence = HEADER.unpack_from(data)
        return cls(topic, gid, sequence, data[HEADER.size :])

    @classmethod
    def from_ros(cls, topic: int, content: bytes, info: Mapping[str, Any]) -> "Heard":
        """A message with what rclpy says about it."""
        stated = info.get("publisher_gid") or {}
        gid = bytes(stated.get("data", b"")) if isinstance(stated, dict) else bytes(stated)
        sequence = info.get("publication_sequence_number")
        return cls(
            topic,
            (gid + NO_GID)[: len(NO_GID)],
            NO_SEQUENCE if sequence is None else int(sequence),
            bytes(content),
        )
