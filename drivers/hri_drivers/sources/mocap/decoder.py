"""Turns captures into scenes, for every kind of motion capture."""

from collections.abc import Callable

import numpy as np

from hri_drivers.sources.mocap.frames import Frame, FrameError, Reader
from hri_drivers.sources.mocap.order import Order
from hri_drivers.sources.mocap.rooted import Rooted
from hri_drivers.sources.mocap.settings import MocapSettings
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.source import SourceCounters

PAUSE_NS = 300_000_000
"""Minimum silence after which a sender may have restarted."""
REFUSED_NS = 1_000_000_000
"""Time for which a person found only in captures that do not advance keeps the room unseen."""
ELSEWHERE_M = 0.5
"""A body farther than this from its id's position in the newest capture is another person."""


class MocapDecoder:
    """See ``hri_drivers.sources.live.Decoder``.

    A capture without people does not by itself mean that the room is empty: ``sees_room`` of the
    settings states whether every person who can approach is tracked.

    Args:
        reader: extracts captures from datagrams.
        settings: the source's.
        joint_map: the sender's joints and axes.
        counters: counts packets and refusals.
        root: root joint of the body, if the sender may send positions relative to it.
        contradicted: returns whether a second sender was heard recently.

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
                f"source.joint_map: {joint_map.name} has no joint '{root}', the root of the body "
                f"in '{settings.kind}'; add it to 'joints'"
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
        self._scale_to_m = joint_map.scale_to_m
        self._newest: dict[int, SentPerson] = {}
        self._refused_ns: int | None = None

    def reset(self) -> None:
        """Discard incomplete captures."""
        self._reader.reset()

    def feed(self, data: bytes, received_ns: int) -> list[SentScene]:
        """The scene that one datagram completes, if any."""
        self._counters.packets += 1
        if received_ns - self._received_ns > PAUSE_NS:
            self._reader.pause()
        self._received_ns = received_ns
        try:
            frame = self._reader.read(data)
            stamp_ns = None if frame is None else self._stamp(frame, received_ns)
        except FrameError as error:
            self._counters.malformed += 1
            self._counters.note(f"{self._settings.kind}: {error}")
            return []
        if frame is None or stamp_ns is None:
            return []
        if not self._order.advances(stamp_ns, frame.number):
            self._look_at_refused(frame, received_ns)
            return []
        self._newest = {person.id: person for person in frame.people}
        people = self._placed(frame)
        whole = frame.tracks and frame.complete and len(people) == len(frame.people)
        whole = whole and not self._refused_lately(received_ns)
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

    def _look_at_refused(self, frame: Frame, received_ns: int) -> None:
        """Detect a person found only in captures that do not advance: a second program may send it.

        Two programs behind one address look like one program with captures out of order: only the
        captures of the program that is ahead are used, and the people of the other would not be
        seen.
        """
        if any(self._is_elsewhere(person) for person in frame.people):
            self._refused_ns = received_ns
            self._counters.note(
                f"{self._settings.kind}: a person appears only in captures that do not advance: "
                "two programs send to this port; stop one of them"
            )

    def _refused_lately(self, received_ns: int) -> bool:
        return self._refused_ns is not None and received_ns - self._refused_ns < REFUSED_NS

    def _is_elsewhere(self, person: SentPerson) -> bool:
        """Whether the newest capture lacks this person, or shows the person elsewhere."""
        if not person.observed.any():
            return False
        newest = self._newest.get(person.id)
        if newest is None or not newest.observed.any():
            return True
        apart = _middle(person) - _middle(newest)
        return float(np.linalg.norm(apart)) * self._scale_to_m > ELSEWHERE_M

    def _placed(self, frame: Frame) -> tuple[SentPerson, ...]:
        """The people with a known position in the room."""
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
                    "while the body moves; let the sender stream room coordinates"
                )
        return tuple(placed)


def _middle(person: SentPerson) -> Floats:
    """(3,) mean of the observed joints; at least one must be observed."""
    middle: Floats = person.positions[person.observed].mean(axis=0)
    return middle
