"""Turns received messages into scenes; needs no rclpy."""

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from struct import error as StructError
from typing import Any

import numpy as np

from hri_drivers.sources.sent import SentPerson, SentScene
from hri_drivers.wires.ros2_heard import TF, TF_STATIC, Heard
from hri_drivers.wires.ros2_publishers import Publishers
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.ros.bodies import Bodies, Body, MessageError
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.messages import TF_MESSAGE, of_cdr, typestore
from hri_predict.protocol.ros.placing import NotYet, PeopleReader
from hri_predict.protocol.ros.stamps import CLOCK_TEXTS, StampClock, clock_of

MAX_BYTES = 1 << 20
"""Maximum size of one message: 64 people with 38 markers each need 400 kB."""
WAIT_NS = 200_000_000
"""Maximum time that a message waits for transforms that are published after it."""
MAX_WAITING = 16
"""Maximum number of waiting messages."""

log = logging.getLogger(__name__)


def _boot_ns() -> int:
    clock = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
    return time.clock_gettime_ns(clock)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Waiting:
    """A message that was parsed but not yet placed in the room.

    Attributes:
        topic: index of its topic.
        bodies: its people, in its own frame.
        sequence: number of the scene that it makes.
        contradicted: whether another publisher was heard recently.
        received_ns: its arrival on the node's clock.
    """

    topic: int
    bodies: Bodies
    sequence: int
    contradicted: bool
    received_ns: int


class Ros2Decoder:
    """See ``hri_drivers.sources.live.Decoder``; decodes units made by ``Heard.packed``.

    With several topics, each topic has one person, and a scene combines the messages with the same
    stamp. A message waits for its transforms, and later messages wait behind it.

    Args:
        kind: type of the messages, a key of ``protocol.ros.placing.READERS``.
        topics: their topics.
        reader: places people; its frames come from ``tree``.
        tree: stores the received transforms.
        counters: counts packets and refusals.
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
        self._contradicted: set[int] = set()  # topics with two publishers since the last capture
        self._waiting: deque[_Waiting] = deque()
        self._sequence = 0
        self.captures = Captures(counters, by_arrival=by_arrival, utc_ns=utc_ns, boot_ns=boot_ns)

    def reset(self) -> None:
        """Discard incomplete captures."""
        self._parts = {}
        self._waiting.clear()

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """The scenes that one message completes, if any; never raises."""
        self._counters.packets += 1
        try:
            heard = Heard.of(data)
            if heard.topic in (TF, TF_STATIC):
                self._add_transforms(heard)
            else:
                self._waiting.append(self._parsed(heard, received_ns))
        except (MessageError, StructError) as error:
            self._refuse(error)
        scenes = []
        while self._waiting:
            try:
                scene = self._scene(self._waiting[0], received_ns)
            except NotYet:
                break
            except MessageError as error:
                self._refuse(f"{self._topics[self._waiting[0].topic]}: {error}")
                scene = None
            self._waiting.popleft()
            scenes += [] if scene is None else [scene]
        if scenes and (news := self.captures.news()):
            log.info("source 'ros2': %s", news)
        return scenes

    def _refuse(self, why: Exception | str) -> None:
        self._counters.malformed += 1
        self._counters.note(why)

    def _add_transforms(self, heard: Heard) -> None:
        before = self._tree.refused
        self._tree.add(
            self._message(heard, TF_MESSAGE),
            static=heard.topic == TF_STATIC,
            publisher=heard.gid,
        )
        self._counters.malformed += self._tree.refused - before

    def _parsed(self, heard: Heard, received_ns: int) -> _Waiting:
        if heard.topic >= len(self._topics):
            raise MessageError("a message of a topic that is not configured")
        topic, publishers = self._topics[heard.topic], self._publishers[heard.topic]
        lost = publishers.lost(heard)
        self._counters.lost += lost
        self._sequence += 1 + lost
        contradicted = publishers.contradicted(heard, received_ns)
        try:
            bodies = self._reader.parse(self._kind, self._message(heard, self._kind))
        except MessageError as error:
            raise MessageError(f"{topic}: {error}") from None
        return _Waiting(
            topic=heard.topic,
            bodies=bodies,
            sequence=self._sequence // len(self._topics),  # of the capture
            contradicted=contradicted,
            received_ns=received_ns,
        )

    def _scene(self, waiting: _Waiting, now_ns: int) -> SentScene | None:
        """The scene that a message completes, if any.

        Raises:
            NotYet: its transforms may still arrive.
            MessageError: it cannot be used.
        """
        waits = now_ns - waiting.received_ns < WAIT_NS and len(self._waiting) <= MAX_WAITING
        placed = self._reader.place(waiting.bodies, waits=waits)
        found = self._completed(waiting.topic, placed, waiting.contradicted)
        if found is None:
            return None
        capture, contradicted = found
        stamp_ns = self.captures.place(capture.stamp_ns, waiting.received_ns)
        if stamp_ns is None:
            return None
        if contradicted:
            topics = ", ".join(self._topics[each] for each in contradicted)
            self._counters.note(f"{topics}: two publishers; stop one of them")
            capture = Bodies(stamp_ns=stamp_ns, frame="", people=())
        sees_room = not contradicted and (self._sees_room or bool(capture.people))
        return SentScene(
            stamp_ns=stamp_ns,
            sequence=waiting.sequence,
            sees_room=sees_room,
            people=tuple(_sent(body) for body in capture.people),
            session=self.captures.session,
        )

    def _message(self, heard: Heard, kind: str) -> Any:
        if len(heard.content) > MAX_BYTES:
            raise MessageError(f"a message of more than {MAX_BYTES} bytes; send fewer joints")
        try:
            return of_cdr(self._store, heard.content, kind)
        except Exception as error:  # rosbags raises many kinds on damaged bytes
            raise MessageError(f"not a {kind}: damaged, or of another release of ROS") from error

    def _completed(
        self, topic: int, bodies: Bodies, contradicted: bool
    ) -> tuple[Bodies, list[int]] | None:
        """All people of one capture, once a message of every topic has arrived, and the topics on
        which two publishers sent parts of it.
        """
        if len(self._topics) == 1:
            return bodies, [topic] if contradicted else []
        if len(bodies.people) > 1:
            raise MessageError("more than one person; with several 'topics', each must have one")
        if any(part.stamp_ns != bodies.stamp_ns for part in self._parts.values()):
            self._counters.incomplete += 1
            self._parts = {}
        if contradicted:  # until a whole capture has been refused for it
            self._contradicted.add(topic)
        self._parts[topic] = bodies
        if len(self._parts) < len(self._topics):
            return None
        parts, self._parts = self._parts, {}
        contradicted_on, self._contradicted = sorted(self._contradicted), set()
        people = [Body(k + 1, p.positions) for k in sorted(parts) for p in parts[k].people]
        capture = Bodies(stamp_ns=bodies.stamp_ns, frame=bodies.frame, people=tuple(people))
        return capture, contradicted_on


def _sent(body: Body) -> SentPerson:
    return SentPerson(body.id, body.positions, np.asarray(np.isfinite(body.positions).all(axis=1)))


LATE_NS = 500_000_000
"""A stamp earlier by at most this arrived out of order; an even earlier stamp means a restart."""
LATE_RUN = 10
"""This many of them in a row also mean a restart."""


class Captures:
    """Orders the captures of one publisher.

    Args:
        counters: counts ``replayed`` and ``out_of_order``.
        by_arrival: ignore stamps; the capture time is the message's arrival.
        utc_ns: this machine's UTC clock, ns.
        boot_ns: time since this machine started, ns.

    Attributes:
        session: increases when the publisher's clock goes back.
        clock: the clock of the newest session's stamps; ``None`` before the first.
    """

    def __init__(
        self,
        counters: SourceCounters,
        *,
        by_arrival: bool,
        utc_ns: Callable[[], int],
        boot_ns: Callable[[], int],
    ) -> None:
        self.session = 0
        self.clock: StampClock | None = None
        self._counters = counters
        self._by_arrival = by_arrival
        self._utc_ns = utc_ns
        self._boot_ns = boot_ns
        self._newest: tuple[int, int] | None = None  # stamp, and when it arrived
        self._late = 0

    def place(self, stamp_ns: int | None, received_ns: int) -> int | None:
        """The capture's time on the publisher's clock; ``None``: the message is not used.

        Args:
            stamp_ns: the header's; ``None`` for a message without a header, whose capture time is
                the previous one plus the time between the two arrivals.
            received_ns: arrival on the node's clock.

        Raises:
            MessageError: the stamp is zero.
        """
        if self._by_arrival:
            stamp_ns = received_ns
        elif stamp_ns is None:
            stamp_ns = self._without_header(received_ns)
        elif stamp_ns == 0:
            raise MessageError(
                "header.stamp is zero; let the publisher stamp captures, or set 'stamp: arrival'"
            )
        if self._newest is not None and not self._advances(stamp_ns, self._newest[0]):
            return None
        self._late = 0
        self._newest = stamp_ns, received_ns
        return stamp_ns

    def news(self) -> str | None:
        """Return one line if the stamps come from a new clock."""
        if self._by_arrival or self._newest is None:
            return None
        clock = clock_of(self._newest[0], self._utc_ns(), self._boot_ns())
        if clock == self.clock:
            return None
        self.clock = clock
        return f"stamps are {CLOCK_TEXTS[clock]}"

    def _without_header(self, received_ns: int) -> int:
        if self._newest is None:
            return self._utc_ns()
        stamp_ns, before_ns = self._newest
        return stamp_ns + max(1, received_ns - before_ns)

    def _advances(self, stamp_ns: int, newest_ns: int) -> bool:
        if stamp_ns > newest_ns:
            return True
        if stamp_ns == newest_ns:
            self._counters.replayed += 1
            self._counters.note("a message with the same stamp as the previous one")
            return False
        self._late += 1
        if newest_ns - stamp_ns <= LATE_NS and self._late < LATE_RUN:
            self._counters.out_of_order += 1
            return False
        self.session += 1
        return True
