"""A received message with its origin, as one unit of bytes."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Any

HEADER = Struct("<B16sq")
TF, TF_STATIC = 254, 255
"""``topic`` of ``/tf`` and ``/tf_static``."""
NO_GID = bytes(16)
SEVERAL_GIDS = b"\xff" * 16
"""One of several publishers, and the middleware does not state which."""
NO_SEQUENCE = -1
LOOK_S = 0.2
"""Seconds between two looks at who publishes."""


@dataclass(frozen=True, slots=True)
class Heard:
    """One message.

    Attributes:
        topic: index of the configured topic, ``TF`` or ``TF_STATIC``.
        gid: the publisher's identity, 16 bytes; ``NO_GID`` where it is not known, and
            ``SEVERAL_GIDS`` where all that is known is that there are several.
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
    def from_ros(
        cls, topic: int, content: bytes, info: Mapping[str, Any], *, unstated: bytes = NO_GID
    ) -> "Heard":
        """A message with what rclpy says about it; ``unstated`` is the gid if it states none."""
        stated = info.get("publisher_gid") or {}
        gid = bytes(stated.get("data", b"")) if isinstance(stated, dict) else bytes(stated)
        gid = gid or unstated
        sequence = info.get("publication_sequence_number")
        return cls(
            topic,
            (gid + NO_GID)[: len(NO_GID)],
            NO_SEQUENCE if sequence is None else int(sequence),
            bytes(content),
        )


class Graph:
    """The publishers of a topic as the graph shows them, where messages do not name theirs.

    rclpy of Jazzy (7.1) does not: two publishers of one topic would look like one.

    Args:
        publishers: gives those of the topic now (``Node.get_publishers_info_by_topic``).
        monotonic_s: the clock.
    """

    def __init__(
        self,
        publishers: Callable[[], Sequence[Any]],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._publishers = publishers
        self._monotonic_s = monotonic_s
        self._looked_s = -math.inf
        self._gid = NO_GID

    def gid(self, info: Mapping[str, Any]) -> bytes:
        """Return the gid for a message whose ``info`` states none; looked up only then."""
        now_s = self._monotonic_s()
        if not info.get("publisher_gid") and now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            gids = {bytes(shown.endpoint_gid) for shown in self._publishers()}
            if len(gids) > 1:
                self._gid = SEVERAL_GIDS
            else:  # of a message whose publisher has just gone: as before
                self._gid = (*gids, self._gid)[0]
        return self._gid
