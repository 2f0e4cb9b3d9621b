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
"""An unknown one of several publishers: the middleware does not identify the sender."""
NO_SEQUENCE = -1
LOOK_S = 0.2
"""Minimum seconds between two look-ups of the publishers."""


@dataclass(frozen=True, slots=True)
class Heard:
    """One message.

    Attributes:
        topic: index of the configured topic, ``TF`` or ``TF_STATIC``.
        gid: the publisher's identity, 16 bytes; ``NO_GID`` if unknown, and ``SEVERAL_GIDS`` if it
            is one of several.
        sequence: the publisher's counter; ``NO_SEQUENCE`` if it is not stated.
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
        """A message with rclpy's information on it; ``unstated`` is the gid if rclpy gives none."""
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
    """The publishers of a topic according to the graph, for messages that do not name theirs.

    In Jazzy, rclpy (7.1) does not name them: two publishers of one topic would look like one.

    Args:
        publishers: returns the topic's current publishers (``Node.get_publishers_info_by_topic``).
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
        """Return the gid for a message; it is looked up only if ``info`` states none."""
        now_s = self._monotonic_s()
        if not info.get("publisher_gid") and now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            gids = {bytes(shown.endpoint_gid) for shown in self._publishers()}
            if len(gids) > 1:
                self._gid = SEVERAL_GIDS
            else:  # of a message whose publisher has just gone: as before
                self._gid = (*gids, self._gid)[0]
        return self._gid
