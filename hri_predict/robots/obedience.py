"""Check that a robot follows its advice: keeps the speed limit, and stops according to its table.

The node relies on both. It checks separation with the robot's present speed, but it assumes that
the robot will keep a granted limit and will stop in time. The robot must not be faster than the
highest limit advised within the last T_r + T_s: the time until it receives a limit, and the time to
slow down. After a stop it must stay at rest. Single delays are not measured, so a robot that reacts
early may brake later; only the sum matters, as for the separation.
"""

import logging
from collections import deque
from collections.abc import Callable

log = logging.getLogger(__name__)

SLACK_S = 0.1
"""Time added to T_r + T_s for jitter of RobotState and the cycles of both sides."""
SPEED_SHARE = 0.1
"""Tolerated relative excess of the limit, because servos overshoot and speeds are upper bounds."""
SPEED_SLACK_M_S = 0.05
"""Tolerated absolute excess, m/s: velocity noise at the end of a long arm."""
STANDS_M_S = 0.02
"""Speed below which a stopping robot is considered at rest."""
HELD_NS = 10_000_000_000
"""Time for which a robot that was too fast is treated as not following speed limits."""
MOST_STRETCH = 100.0
"""Factor on the stopping time in the table beyond which a robot is considered not to stop."""


class Obedience:
    """Compares one robot's speed with its advised limits.

    Args:
        reaction_s: longest time from an advice to the onset of braking, with RobotState's delay.
        stopping: speed (m/s) -> T_s (s) and S_s (m) of the stopping table.
        max_speed_m_s: the robot's highest speed in production.

    Attributes:
        stretch: measured stopping time divided by the table's, at least 1. It never decreases,
            because the table stays wrong until it is corrected.
        too_fast, late_stops: number of times that each of these started.
    """

    def __init__(
        self,
        reaction_s: float,
        stopping: Callable[[float], tuple[float, float]],
        max_speed_m_s: float,
    ) -> None:
        self._reaction_s = reaction_s
        self._stopping = stopping
        self._kept_s = reaction_s + stopping(max_speed_m_s)[0] + SLACK_S
        self._limits: deque[tuple[int, float]] = deque()  # time, limit from then on
        self._speeds: deque[tuple[int, float]] = deque()
        self._stop: _Stop | None = None
        self._too_fast_until_ns = 0
        self.stretch = 1.0
        self._warned = 0.0
        self.too_fast = self.late_stops = 0

    def warn(self, robot: str) -> None:
        """Log that the robot stops late; to be called after each ``see``.

        It is logged immediately, and again each time the delay has doubled. The correction for the
        table is known only when the stop is over.
        """
        is_over = self._stop is None or self._stop.ended
        is_worse = self.stretch > self._warned if is_over else self.stretch >= 2 * self._warned
        if self.stretch <= 1.0 or not is_worse:
            return
        self._warned = self.stretch
        log.warning(
            "robot %s needed %s%.2f times the time or distance in its stopping table to stop; "
            "from now on the table's values are multiplied by 1.1 times that factor; correct the "
            "table, or find out why the robot does not obey",
            robot,
            "" if is_over else "at least ",
            self.stretch,
        )

    def advise(self, limit_m_s: float, now_ns: int) -> None:
        """Record the limit sent at ``now_ns``; 0 for a stop."""
        if not self._limits or self._limits[-1][1] != limit_m_s:
            self._limits.append((now_ns, limit_m_s))
        if limit_m_s > 0:
            self._stop = None

    def is_too_fast(self, now_ns: int) -> bool:
        """Return whether the robot recently exceeded its speed limit."""
        return now_ns < self._too_fast_until_ns

    def forget(self) -> None:
        """Reset, because the robot's state is unknown or the advice does not control the robot."""
        self._limits.clear()
        self._speeds.clear()
        self._stop = None

    def see(self, speed_m_s: float, now_ns: int) -> None:
        """Process the speed of the robot's fastest point at ``now_ns``."""
        since_ns = now_ns - round(self._kept_s * max(self.stretch, 1.0) * 1e9)
        self._speeds.append((now_ns, speed_m_s))
        while self._speeds[0][0] < since_ns:
            self._speeds.popleft()
        # the last limit before that time stayed in force
        while len(self._limits) > 1 and self._limits[1][0] < since_ns:
            self._limits.popleft()
        if not self._limits:
            return
        if self._limits[-1][1] <= 0:
            self._see_stop(speed_m_s, now_ns)
        else:
            self._see_limit(speed_m_s, now_ns)

    def _see_limit(self, speed_m_s: float, now_ns: int) -> None:
        fastest = max(speed for _, speed in self._speeds)
        within_s = self._reaction_s + self._stopping(fastest)[0] * self.stretch + SLACK_S
        since_ns = now_ns - round(within_s * 1e9)
        if self._limits[0][0] > since_ns:
            return  # the earlier advice is unknown
        held = [limit for at, limit in self._limits if at > since_ns]
        held.append([limit for at, limit in self._limits if at <= since_ns][-1])
        if speed_m_s > max(held) * (1 + SPEED_SHARE) + SPEED_SLACK_M_S:
            self._note_too_fast(now_ns)

    def _note_too_fast(self, now_ns: int) -> None:
        self.too_fast += not self.is_too_fast(now_ns)
        self._too_fast_until_ns = now_ns + HELD_NS

    def _see_stop(self, speed_m_s: float, now_ns: int) -> None:
        """Measure the time and distance of a stop, from the advice to rest."""
        if self._stop is None:
            advised_ns = self._limits[-1][0]
            before = [speed for at, speed in self._speeds if at <= advised_ns]
            self._stop = _Stop(advised_ns, max([speed_m_s, *before[-1:]]), now_ns)
        stop = self._stop
        stop.way_m += speed_m_s * (now_ns - stop.seen_ns) * 1e-9
        stop.seen_ns = now_ns
        braking_s = (now_ns - stop.advised_ns) * 1e-9 - self._reaction_s
        # a robot may still speed up until it has heard of the stop
        if braking_s <= 0.0:
            stop.speed_m_s = max(stop.speed_m_s, speed_m_s)
        if speed_m_s < STANDS_M_S:
            stop.ended = True
            return
        time_s, way_m = self._stopping(max(stop.speed_m_s, STANDS_M_S))
        if stop.ended:  # it rested, perhaps at a waypoint of its path
            if braking_s > time_s * self.stretch + SLACK_S and speed_m_s > SPEED_SLACK_M_S:
                self._note_too_fast(now_ns)
            return
        braking_m = stop.way_m - stop.speed_m_s * self._reaction_s
        late = max(
            (braking_s - SLACK_S) / max(time_s, 1e-3),
            (braking_m - stop.speed_m_s * SLACK_S) / max(way_m, 1e-3),
        )
        if late > 1.0:
            self.late_stops += not stop.late
            stop.late = True
            self.stretch = min(max(self.stretch, late), MOST_STRETCH)


class _Stop:
    """One stop: time of the advice, the robot's speed at that time, and its travel since."""

    def __init__(self, advised_ns: int, speed_m_s: float, seen_ns: int) -> None:
        self.advised_ns = advised_ns
        self.speed_m_s = speed_m_s
        self.seen_ns = seen_ns
        self.way_m = 0.0
        self.ended = self.late = False
