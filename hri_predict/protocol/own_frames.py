"""Received frames with a node's ids: its own echoes, or frames from a second sender.

Only one node may use a set of ids. Two nodes with the same ids would contradict each other: a
controller could follow one node and move while the other advises *stop*.
"""

from collections import deque
from collections.abc import Hashable

KEPT = 4096
"""Number of frames remembered: more than any link here sends in a second. A later echo is treated
as a frame from another sender, which errs on the safe side."""
PAIR_NS = 500_000_000
"""Two foreign frames within this time prove a second sender. A node sends at least ten Status
messages a second, whereas damaged frames with a matching CRC (1 in 256 on classic CAN) are
isolated."""


class OwnFrames:
    """Remembers the newest frames that a node sent, and classifies the frames that it receives.

    On some transports a sender receives its own frames (RS-485, udp_multicast, adapters configured
    to echo). A frame identical to one of the newest ``KEPT`` sent is an echo, and harmless. Every
    other complete frame with the node's ids comes from another sender. Callers pass only frames
    with a correct CRC, because a lost character on an slcan line can turn any id into one of the
    node's.

    One thread may call ``sent`` while another calls ``hear``.

    Attributes:
        echoes: number of the node's own frames received.
        foreign: number of frames from another sender.
    """

    def __init__(self) -> None:
        self.echoes = self.foreign = 0
        self._newest: deque[Hashable] = deque()
        self._times: dict[Hashable, int] = {}  # a Counter takes twice as long for a new frame
        self._judged = 0  # of ``foreign``
        self._foreign_ns: int | None = None

    def sent(self, frame: Hashable) -> None:
        """Remember a frame; to be called before the frame is written."""
        self._times[frame] = self._times.get(frame, 0) + 1
        self._newest.append(frame)
        if len(self._newest) > KEPT:
            oldest = self._newest.popleft()
            self._times[oldest] -= 1
            if not self._times[oldest]:
                del self._times[oldest]

    def came_back(self, frame: Hashable) -> bool:
        """Return whether a frame is an echo of one of our own; count it if so."""
        echo = frame in self._times
        self.echoes += echo
        return echo

    def hear(self, frame: Hashable) -> None:
        """Classify and count a complete frame with our ids."""
        if not self.came_back(frame):
            self.foreign += 1

    def prove_second(self, now_ns: int) -> bool:
        """Return whether frames since the last call prove a second sender; see ``PAIR_NS``."""
        new, self._judged = self.foreign - self._judged, self.foreign
        if not new:
            return False
        before_ns, self._foreign_ns = self._foreign_ns, now_ns
        return new > 1 or (before_ns is not None and now_ns - before_ns <= PAIR_NS)
