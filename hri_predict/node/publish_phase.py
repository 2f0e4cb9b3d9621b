"""When a tick's messages leave: at a fixed time after its deadline, so that they arrive evenly.

A tick's duration varies with people, captures and the machine. Messages that leave as soon as they
are computed pass this variation on to the controllers. Here they wait until most ticks are done
(``docs/decisions/publish-phase.md``). In virtual time nothing waits.
"""

import logging
import math
import time

from hri_predict.base.clock import Clock

log = logging.getLogger(__name__)

LEARN_TICKS_S = 60.0
"""Time with people in view from which the phase is learned, in seconds."""
UPDATE_TICKS = 25
"""Ticks between two updates of the phase, until it is fixed."""
SHARE = 0.995
"""Share of ticks that are computed by the learned phase: a late tick makes one interval too long
and the next too short, so 99 % of intervals are even."""
MOST_WAIT_NS = 5_000_000
"""Maximum wait of the median tick for a learned phase: on a busy machine a few slow ticks would
otherwise make all messages old."""


class PublishPhase:
    """The phase of a node with fixed ticks.

    Args:
        clock: the node's clock.
        phase_s: time after the deadline, seconds; 0: do not wait; ``None``: learn it.
        limit_s: maximum of a learned phase: the delay budget's *encoding*.
        rate_hz: ticks per second.

    Attributes:
        held_ns, held_s: how long the messages of the newest tick waited, by the node's clock and
            by the wall clock.
    """

    def __init__(self, clock: Clock, phase_s: float | None, limit_s: float, rate_hz: float) -> None:
        self._clock, self._rate_hz = clock, rate_hz
        self._limit_ns = round(limit_s * 1e9)
        self._phase_ns = round((phase_s or 0.0) * 1e9)
        self._learn_ticks = math.ceil(LEARN_TICKS_S * rate_hz) if phase_s is None else 0
        self._taken_ns: list[int] = []
        self._deadline_ns: int | None = None
        self.held_ns, self.held_s = 0, 0.0

    @property
    def phase_s(self) -> float:
        """Time after the deadline at which messages leave, seconds; 0: as soon as computed."""
        return self._phase_ns * 1e-9

    @property
    def held_share(self) -> float:
        """Part of a cycle for which the messages of the newest tick waited."""
        return self.held_ns * 1e-9 * self._rate_hz

    def begin(self, deadline_ns: int) -> None:
        """Note the deadline of the tick that begins."""
        self._deadline_ns, self.held_ns, self.held_s = deadline_ns, 0, 0.0

    def hold(self, *, learn: bool, urgent: bool) -> None:
        """Return when the tick's messages may leave.

        Args:
            learn: whether this tick shows how long ticks take (people are in view).
            urgent: do not wait, because an advice has become more severe.
        """
        if self._deadline_ns is None:
            return
        now_ns = self._clock.now_ns()
        if learn and self._learn_ticks:
            self._learn(now_ns - self._deadline_ns)
        leave_ns = self._deadline_ns + self._phase_ns
        if not urgent and now_ns < leave_ns:
            began = time.perf_counter()
            self._clock.wait_until(leave_ns)
            self.held_s = time.perf_counter() - began
            self.held_ns = self._clock.now_ns() - now_ns

    def _learn(self, newest_ns: int) -> None:
        self._taken_ns.append(newest_ns)
        count = len(self._taken_ns)
        if count % UPDATE_TICKS and count < self._learn_ticks:
            return
        taken_ns = sorted(self._taken_ns)
        kept_ns = taken_ns[math.ceil(SHARE * count) - 1]
        waiting_ns = taken_ns[count // 2] + MOST_WAIT_NS
        self._phase_ns = min(kept_ns, waiting_ns, self._limit_ns)
        if count >= self._learn_ticks:
            log.info("messages leave %.1f ms after the deadline of each tick", self.phase_s * 1e3)
            self._learn_ticks = 0
            self._taken_ns.clear()
