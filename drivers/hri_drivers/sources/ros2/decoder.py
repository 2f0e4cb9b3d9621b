"""From received messages to scenes; without rclpy."""

import logging
import time
from collections.abc import Callable
from struct import error as StructError
from typing import Any

import numpy as np

from hri_drivers.sources.ros2.captures import Captures
from hri_drivers.sources.ros2.heard import TF, TF_STATIC, Heard
from hri_drivers.sources.ros2.publishers import Publishers
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.ros.bodies import Bodies, Body, MessageError
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.messages import TF_MESSAGE, typestore
from hri_predict.protocol.ros.placing import PeopleReader

MAX_BYTES = 1 << 20
"""Maximum size of one message: 64 people of 38 markers have 400 kB."""

log = logging.getLogger(__name__)


def _boot_ns() -> int:
    clock = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
    return time.clock_gettime_ns(clock)


class Ros2Decoder:
    """See ``hri_drivers.sources.live.Decoder``; of units by ``Heard.packed``.

    Of several topics, each has one person, and a scene has the messages with the same stamp.

    Args:
        kind: type of the messages, a key of ``protocol.ros.bodies.READERS``.
        topics: their topics.
        reader: places people; its frames come from ``tree``.
        tree: takes the transforms that are heard.
        counters: counts packets and what is refused.
        sees_room: whether a scene without people means that the room was seen.
        by_arrival: ignore stamps.
        utc_ns, boot_ns: this machine's clocks, ns.
    """

    def __init__(
        self,
        *,
        kind: str,
        topics: list[str],
        reader: PeopleReader,
        tree: FrameTree,
        counters: SourceCounters,
        sees_room: bool,
        by_arrival: bool = False,
        utc_ns: Callable[[], int] = time.time_ns,
        boot_ns: Callable[[], int] = _boot_ns,
    ) -> None:
        self._kind = kind
        self._topics = topics
        self._reader = reader
        self._tree = tree
        self._counters = counters
        self._sees_room = sees_room
        self._by_arrival = by_arrival
        self._store = typestore("jazzy")
        self._publishers = [Publishers() for _ in topics]
        self._parts: dict[int, Bodies] = {}  # messages of one capture, by topic
        self._sequence = 0
        self.captures = Captures(counters, by_arrival=by_arrival, utc_ns=utc_ns, boot_ns=boot_ns)

    def reset(self) -> None:
        """Forget an incomplete capture."""
        self._parts = {}

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """The scene that one message completes, if any; never raises."""
        self._counters.packets += 1
        try:
            heard = Heard.of(data)
            if heard.topic in (TF, TF_STATIC):
                self._add_transforms(heard)
                return []
            scene = self._scene(heard, received_ns)
        except (MessageError, StructError) as error:
            self._counters.malformed += 1
            self._counters.note(error)
            return []
        if news := self.captures.news():
            log.info("source 'ros2': %s", news)
        return [] if scene is None else [scene]

    def _add_transforms(self, heard: Heard) -> None:
        before = self._tree.refused
        self._tree.add(self._message(heard, TF_MESSAGE), static=heard.topic == TF_STATIC)
        self._counters.malformed += self._tree.refused - before

    def _scene(self, heard: Heard, received_ns: int) -> SentScene | None:
        if heard.topic >= len(self._topics):
            raise MessageError("a message of a topic that is not configured")
        topic, publishers = self._topics[heard.topic], self._publishers[heard.topic]
        lost = publishers.lost(heard)
        self._counters.lost += lost
        self._sequence += 1 + lost
        contradicted = publishers.contradicted(heard, received_ns)
        try:
            bodies = self._reader.read(self._kind, self._message(heard, self._kind))
            capture = self._completed(heard.topic, bodies)
            if capture is None:
                return None
            stamp_ns = self.captures.place(capture.stamp_ns, received_ns)
        except MessageError as error:
            raise MessageError(f"{topic}: {error}") from None
        if stamp_ns is None:
            return None
        if contradicted:
            self._counters.note(f"{topic}: two publishers; stop one of them")
            capture = Bodies(stamp_ns=stamp_ns, frame="", people=())
        sees_room = not contradicted and (self._sees_room or bool(capture.people))
        return SentScene(
            stamp_ns=stamp_ns,
            sequence=self._sequence,
            sees_room=sees_room,
            people=tuple(_sent(body) for body in capture.people),
            session=self.captures.session,
        )

    def _message(self, heard: Heard, kind: str) -> Any:
        if len(heard.content) > MAX_BYTES:
            raise MessageError(f"a message of more than {MAX_BYTES} bytes; send fewer joints")
        try:
            return self._store.deserialize_cdr(heard.content, kind)
        except Exception as error:  # rosbags raises many kinds on damaged bytes
            raise MessageError(f"not a {kind}: damaged, or of another release of ROS") from error

    def _completed(self, topic: int, bodies: Bodies) -> Bodies | None:
        """All people of one capture, once every topic has said who it sees."""
        if len(self._topics) == 1:
            return bodies
        if len(bodies.people) > 1:
            raise MessageError("more than one person; with several 'topics', each has one")
        if any(part.stamp_ns != bodies.stamp_ns for part in self._parts.values()):
            self._counters.incomplete += 1
            self._parts = {}
        self._parts[topic] = bodies
        if len(self._parts) < len(self._topics):
            return None
        parts, self._parts = self._parts, {}
        people = [Body(k + 1, p.positions) for k in sorted(parts) for p in parts[k].people]
        return Bodies(stamp_ns=bodies.stamp_ns, frame=bodies.frame, people=tuple(people))


def _sent(body: Body) -> SentPerson:
    return SentPerson(body.id, body.positions, np.asarray(np.isfinite(body.positions).all(axis=1)))
