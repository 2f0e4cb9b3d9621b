"""From captures to scenes: the same for every kind of motion capture."""

from collections.abc import Callable

import numpy as np

from hri_drivers.sources.mocap.frames import Frame, FrameError, Reader
from hri_drivers.sources.mocap.order import Order
from hri_drivers.sources.mocap.rooted import Rooted
from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.base.errors import ConfigError
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

PAUSE_NS = 300_000_000
"""After a longer silence a sender may have started again."""


class MocapDecoder:
    """See ``hri_drivers.sources.live.Decoder``.

    That no person is in a capture never means by itself that the room is empty: ``sees_room`` of
    the settings says whether every person who can come near is tracked.

    Args:
        reader: finds captures in datagrams.
        settings: the source's.
        joint_map: the sender's joints and axes.
        counters: counts packets and what is refused.
        root: joint that carries the body, if the sender may send positions relative to it.
        contradicted: whether a second sender was heard a moment ago.

    Raises:
        ConfigError: the joint map has no such joint.
    """

    def __init__(
        self,
        *,
        reader: Reader,
        settings: MocapSettings,
        joint_map: JointMap,
        counters: SourceCounters,
        root: str | None = None,
        contradicted: Callable[[], bool] = lambda: False,
    ) -> None:
        if root is not None and root not in joint_map.source_joints:
            raise ConfigError(
                f"source.joint_map: {joint_map.name} has no joint '{root}', which carries the "
                f"body in '{settings.kind}'; add it to 'joints'"
            )
        self._reader = reader
        self._settings = settings
        self._counters = counters
        self._root = root
        self._root_index = joint_map.source_joints.index(root) if root is not None else 0
        self._up = int(np.argmax(np.abs(joint_map.rotation[2])))
        self._contradicted = contradicted
        self._order = Order(counters)
        self._rooted: dict[int, Rooted] = {}
        self._received_ns = 0

    def reset(self) -> None:
        """Forget incomplete captures."""
        self._reader.reset()

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """The scene that one datagram completes, if any."""
        self._counters.packets += 1
        if received_ns - self._received_ns > PAUSE_NS:
            self._reader.reset()  # what came before belongs to no capture that comes now
        self._received_ns = received_ns
        try:
            frame = self._reader.read(data)
            stamp_ns = None if frame is None else self._stamp(frame, received_ns)
        except FrameError as error:
            self._counters.malformed += 1
            self._counters.note(f"{self._settings.kind}: {error}")
            return []
        if frame is None or stamp_ns is None or not self._order.advances(stamp_ns, frame.number):
            return []
        people = self._placed(frame)
        whole = frame.tracks and frame.complete and len(people) == len(frame.people)
        return [
            SentScene(
                stamp_ns=stamp_ns,
                sequence=self._order.sequence,
                sees_room=whole and self._settings.sees_room and not self._contradicted(),
                people=people,
                session=self._order.session,
            )
        ]

    def _stamp(self, frame: Frame, received_ns: int) -> int:
        if self._settings.stamp == "arrival":
            return received_ns
        if frame.stamp_ns is None:
            raise FrameError("the sender sends no time; set 'stamp: arrival'")
        return frame.stamp_ns

    def _placed(self, frame: Frame) -> tuple[SentPerson, ...]:
        """The people whose place in the room is known."""
        if not frame.tracks or self._root is None:
            return frame.people if frame.tracks else ()
        known, self._rooted = self._rooted, {}
        placed = []
        for person in frame.people:
            rooted = known.get(person.id) or Rooted(self._root_index, self._up)
            self._rooted[person.id] = rooted
            if rooted.sees(person):
                placed.append(person)
            elif rooted.still:
                self._counters.note(
                    f"{self._settings.kind}: a relative stream: '{self._root}' stays at one point "
                    "while the body moves; let the sender stream positions in the room"
                )
        return tuple(placed)
