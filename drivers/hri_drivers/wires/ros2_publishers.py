"""The publishers on a topic, and the number of their lost messages."""

from hri_drivers.wires.ros2_heard import NO_GID, NO_SEQUENCE, SEVERAL_GIDS, Heard

CONTRADICTED_NS = 1_000_000_000
"""Two publishers on a topic within this time contradict each other: neither is believed."""
MAX_KNOWN = 16
MAX_LOST = 100_000
"""Maximum jump in the counter that is counted as lost messages."""


class Publishers:
    """The publishers on one topic.

    A publisher that is started again has another identity. So a publisher that returns within a
    second is not believed for the rest of that second.
    """

    def __init__(self) -> None:
        self._heard_ns: dict[bytes, int] = {}
        self._sequences: dict[bytes, int] = {}

    def lost(self, heard: Heard) -> int:
        """Number of messages of the same publisher that were lost before this one."""
        if heard.sequence == NO_SEQUENCE or heard.gid == SEVERAL_GIDS:
            return 0
        before = self._sequences.pop(heard.gid, None)
        self._sequences[heard.gid] = heard.sequence
        while len(self._sequences) > MAX_KNOWN:
            del self._sequences[next(iter(self._sequences))]
        ahead = 1 if before is None else heard.sequence - before
        return ahead - 1 if 1 <= ahead <= MAX_LOST else 0

    def contradicted(self, heard: Heard, received_ns: int) -> bool:
        """Whether another publisher was heard on the topic within ``CONTRADICTED_NS``."""
        if heard.gid in (NO_GID, SEVERAL_GIDS):
            return heard.gid == SEVERAL_GIDS
        self._heard_ns.pop(heard.gid, None)
        recent = received_ns - CONTRADICTED_NS
        self._heard_ns = {g: ns for g, ns in self._heard_ns.items() if ns > recent}
        others = bool(self._heard_ns)
        if len(self._heard_ns) < MAX_KNOWN:
            self._heard_ns[heard.gid] = received_ns
        return others
