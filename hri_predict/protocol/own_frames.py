"""Frames with a node's ids: an echo of its own, or a second sender's.

Only one node may send with one set of ids. Two of them on one bus would contradict each other, and
a controller that believes one of them may move while the other says *stop*.
"""

from collections import Counter, deque
from collections.abc import Hashable

KEPT = 4096
"""Frames that are remembered: more than a second of what any link here sends. A later echo counts
as another's frame, which is the safe mistake."""


class OwnFrames:
    """Remembers the newest frames that a node sent, and judges those that it hears.

    Some wires give a sender its own frames back (RS-485, udp_multicast, adapters set so). A frame
    that equals one of the newest ``KEPT`` byte for byte is such an echo; it says nothing that the
    node did not say. Every other frame with the node's ids comes from another sender.

    One thread may call ``sent`` while another calls ``hear``.

    Attributes:
        echoes: our own frames that came back.
        foreign: frames of another sender.
    """

    def __init__(self) -> None:
        self.echoes = self.foreign = 0
        self._newest: deque[Hashable] = deque()
        self._times: Counter[Hashable] = Counter()

    def sent(self, frame: Hashable) -> None:
        """Remember a frame; call it before the frame is written."""
        self._times[frame] += 1
        self._newest.append(frame)
        if len(self._newest) > KEPT:
            oldest = self._newest.popleft()
            self._times[oldest] -= 1
            if not self._times[oldest]:
                del self._times[oldest]

    def hear(self, frame: Hashable) -> None:
        """Judge a frame with our ids, and count it."""
        if frame in self._times:
            self.echoes += 1
        else:
            self.foreign += 1
