"""Frames with a node's ids: an echo of its own, or a second sender's.

Only one node may send with one set of ids. Two of them on one bus would contradict each other, and
a controller that believes one of them may move while the other says *stop*.
"""

from collections import deque
from collections.abc import Hashable

KEPT = 4096
"""Frames that are remembered: more than a second of what any link here sends. A later echo counts
as another's frame, which is the safe mistake."""
PAIR_NS = 500_000_000
"""Two frames of another within this time prove a second sender. A node sends at least ten Status a
second; a damaged frame whose CRC happens to be right (1 of 256 on classic CAN) comes alone."""


class OwnFrames:
    """Remembers the newest frames that a node sent, and judges those that it hears.

    Some wires give a sender its own frames back (RS-485, udp_multicast, adapters set so). A frame
    that equals one of the newest ``KEPT`` byte for byte is such an echo; it says nothing that the
    node did not say. Every other whole frame with the node's ids comes from another sender. Callers
    judge only frames whose CRC is right: a lost character on an slcan line can turn any id into one
    of the node's.

    One thread may call ``sent`` while another calls ``hear``.

    Attributes:
        echoes: our own frames that came back.
        foreign: frames of another sender.
    """

    def __init__(self) -> None:
        self.echoes = self.foreign = 0
        self._newest: deque[Hashable] = deque()
        self._times: dict[Hashable, int] = {}  # a Counter takes twice as long for a new frame
        self._judged = 0  # of ``foreign``
        self._foreign_ns: int | None = None

    def sent(self, frame: Hashable) -> None:
        """Remember a frame; call it before the frame is written."""
        self._times[frame] = self._times.get(frame, 0) + 1
        self._newest.append(frame)
        if len(self._newest) > KEPT:
            oldest = self._newest.popleft()
            self._times[oldest] -= 1
            if not self._times[oldest]:
                del self._times[oldest]

    def came_back(self, frame: Hashable) -> bool:
        """Whether a frame is an echo of our own; count it if so."""
        echo = frame in self._times
        self.echoes += echo
        return echo

    def hear(self, frame: Hashable) -> None:
        """Judge a whole frame with our ids, and count it."""
        if not self.came_back(frame):
            self.foreign += 1

    def prove_second(self, now_ns: int) -> bool:
        """Whether the frames heard since the last call prove a second sender; see ``PAIR_NS``."""
        new, self._judged = self.foreign - self._judged, self.foreign
        if not new:
            return False
        before_ns, self._foreign_ns = self._foreign_ns, now_ns
        return new > 1 or (before_ns is not None and now_ns - before_ns <= PAIR_NS)
