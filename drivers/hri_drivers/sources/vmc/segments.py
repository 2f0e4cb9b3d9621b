"""Collects the bones of one capture: those between two times of the performer.

VMC does not mark the end of a capture, which may need several datagrams. A performer sends its time
with every capture, before the bones or after them. A capture is complete when every bone of the
avatar has arrived since the newest time. If a datagram is lost, its bones are missing, and the
capture is dropped and counted. Thus no body combines two captures or lacks a parent bone.
"""

from hri_drivers.sources.vmc.bones import Pose
from hri_predict.contracts.source import SourceCounters

GONE_AFTER = 10
"""Number of captures in a row without one of the bones after which another avatar is assumed."""


class Segments:
    """Collects the bones of captures.

    Args:
        counters: counts ``incomplete``.

    Attributes:
        bones: local poses since the newest time.
    """

    def __init__(self, counters: SourceCounters) -> None:
        self.bones: dict[str, Pose] = {}
        self._counters = counters
        self._avatar: frozenset[str] | None = None  # its bones, known from two equal captures
        self._before: frozenset[str] = frozenset()
        self._given = True  # nothing is whole before the first time
        self._short = 0

    def reset(self) -> None:
        """Discard the capture in progress."""
        self.bones, self._given = {}, True

    def add(self, bone: str, pose: Pose) -> None:
        """Add a bone; a bone that arrives twice belongs to a capture whose time was lost."""
        if bone in self.bones and not self._given:
            self._counters.incomplete += 1
            self._counters.note("vmc: bones arrive twice without a new /VMC/Ext/T between them")
            self._given = True
        self.bones[bone] = pose

    def end(self) -> None:
        """Process a time: the bones that follow belong to another capture."""
        seen = frozenset(self.bones)
        if not seen:
            self._given = False
            return
        if self._avatar is None or seen - self._avatar:
            self._avatar = seen if seen == self._before else None
            self._short = 0
        elif seen < self._avatar:
            self._counters.incomplete += 1
            self._short += 1
            if self._short >= GONE_AFTER:
                self._avatar = None
        else:
            self._short = 0
        self._before = seen
        self.bones, self._given = {}, False

    def whole(self) -> bool:
        """Whether the capture is complete; true only once for each capture."""
        if self._given or self._avatar is None or not self._avatar <= self.bones.keys():
            return False
        self._given = True
        return True
