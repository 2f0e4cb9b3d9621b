"""Turns captures into scenes, for every kind of motion capture."""

from collections.abc import Callable

import numpy as np

from hri_drivers.sources.mocap.frames import Frame, FrameError, Reader
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


STILL = 30
"""Number of captures in a row in which the body moves but its root is bit-identical."""


class Rooted:
    """Whether a person's root moves in the room.

    Programs that track only limbs put the body at one place. While the body moves, a measured root
    never keeps a bit-identical horizontal position. Captures without a measured root are skipped:
    the comparison uses the measured roots before and after them.

    Args:
        root: index of the root joint of the body (the pelvis).
        up: index of the vertical coordinate.

    Attributes:
        still: number of captures in a row in which the body moved and its root did not.
    """

    def __init__(self, root: int, up: int) -> None:
        self._root = root
        self._level = [axis for axis in range(3) if axis != up]
        self.still = 0
        self._newest: Floats | None = None
        self._root_at: Floats | None = None
        self._moved = False

    def sees(self, person: SentPerson) -> bool:
        """Process the next capture; return whether its position is credible."""
        newest, self._newest = self._newest, person.positions
        now = person.positions[self._root, self._level]
        if not np.isfinite(now).all():
            return self._moved
        before, self._root_at = self._root_at, now
        if newest is None or before is None:
            return False
        if not np.array_equal(before, now):
            self._moved, self.still = True, 0
        elif not np.array_equal(newest, person.positions, equal_nan=True):
            self.still += 1
            self._moved = self._moved and self.still < STILL
        return self._moved


LATE_NS = 500_000_000
"""A stamp earlier by at most this arrived out of order; an even earlier stamp means a restart."""
LATE_RUN = 10
"""This many late captures in a row also mean a restart."""
MAX_LOST = 100_000
"""Maximum number of lost captures; a larger jump ahead means that the sender restarted."""
LATE_NUMBERS = 30
"""The equivalent of ``LATE_NS`` for capture numbers."""


class Order:
    """Orders the captures of one sender by their numbers, or else by their stamps.

    Args:
        counters: counts ``lost``, ``replayed`` and ``out_of_order``.

    Attributes:
        session: increases when the sender restarts.
        sequence: number of the newest capture; increases by one, or by more if captures are lost.
    """

    def __init__(self, counters: SourceCounters) -> None:
        self.session = 0
        self.sequence = 0
        self._counters = counters
        self._stamp_ns: int | None = None
        self._number: int | None = None
        self._late = 0

    def advances(self, stamp_ns: int, number: int | None) -> bool:
        """Process the next capture; return whether to use it."""
        if stamp_ns == self._stamp_ns:
            self._repeats()
            return False
        if number is not None and self._number is not None:
            used = self._counts(number - self._number)
        else:
            used = self._stamp_ns is None or self._follows(stamp_ns - self._stamp_ns, LATE_NS)
        if used:
            self.sequence += 1
            self._late = 0
            self._stamp_ns, self._number = stamp_ns, number
        return used

    def _counts(self, risen: int) -> bool:
        if risen > MAX_LOST:
            self.session += 1
        elif self._follows(risen, LATE_NUMBERS):
            lost = max(0, risen - 1)
            self._counters.lost += lost
            self.sequence += lost
        else:
            return False
        return True

    def _follows(self, risen: int, late: int) -> bool:
        if risen > 0:
            return True
        if risen == 0:
            self._repeats()
            return False
        self._late += 1
        if -risen <= late and self._late < LATE_RUN:
            self._counters.out_of_order += 1
            return False
        self.session += 1
        return True

    def _repeats(self) -> None:
        self._counters.replayed += 1
        self._counters.note("the sender's time does not advance; see 'stamp'")
