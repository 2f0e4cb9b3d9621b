"""A received message with its origin, as one unit of bytes."""

from dataclasses import dataclass
from struct import Struct

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
