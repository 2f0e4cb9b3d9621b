"""Detection of a second program whose samples are mixed into the stream of the first."""

import numpy as np

from hri_drivers.sources.mocap.decoder import ELSEWHERE_M, REFUSED_NS
from hri_drivers.sources.mvn.codec import Datagram, MvnPose, Sample, add_segments
from hri_predict.contracts.source import SourceCounters

NOTE = "mvn: two programs send to this port; stop one of them"
RESTART_NS = 1_000_000_000
"""A sender that restarts twice within this time is two senders with different counters."""


class SecondSender:
    """Whether a second program sends into the same stream.

    MVN may use several ports and connections, one for each character, so the address does not tell
    two programs apart. Only the samples of the program that is ahead are used, and the people of
    the other would be missing from a room that counts as seen.

    Args:
        counters: gets a note.
        scale_to_m: metres per unit of the stream.
    """

    def __init__(self, counters: SourceCounters, scale_to_m: float) -> None:
        self._counters = counters
        self._scale_to_m = scale_to_m
        self._newest: dict[int, MvnPose] = {}
        self._session = 0
        self._restarted_ns: int | None = None
        self._heard_ns: int | None = None

    def used(self, sample: Sample) -> None:
        """Process a sample that becomes a scene."""
        self._newest = sample.poses

    def refused(self, datagram: Datagram, received_ns: int) -> None:
        """Process a datagram that was late or came twice: it may show another person."""
        pose = MvnPose()
        add_segments(datagram, pose)
        if self._is_elsewhere(datagram.character, pose):
            self._hear(received_ns)

    def in_session(self, session: int, received_ns: int) -> None:
        """Process the session of the newest datagram; see ``Assembler.session``."""
        if session == self._session:
            return
        if self._restarted_ns is not None and received_ns - self._restarted_ns < RESTART_NS:
            self._hear(received_ns)
        self._session, self._restarted_ns = session, received_ns

    def heard_lately(self, received_ns: int) -> bool:
        """Whether a second program sent within the last second."""
        return self._heard_ns is not None and received_ns - self._heard_ns < REFUSED_NS

    def _hear(self, received_ns: int) -> None:
        self._heard_ns = received_ns
        self._counters.note(NOTE)

    def _is_elsewhere(self, character: int, pose: MvnPose) -> bool:
        """Whether the newest sample lacks this character, or shows the same segments elsewhere."""
        if not pose.observed.any():
            return False
        newest = self._newest.get(character)
        if newest is None:
            return True
        both = pose.observed & newest.observed
        if not both.any():
            return True
        apart = np.linalg.norm((pose.positions - newest.positions)[both], axis=1)
        return float(apart.mean()) * self._scale_to_m > ELSEWHERE_M
