"""Whether a robot does what it was advised: keeps the speed limit, and stops as its table says.

The node counts on both: a person's separation is judged with the robot's present speed, but a limit
is granted because the robot will keep it, and a stop because it stops in time. The robot must be
no faster than the highest limit advised within the last T_r + T_s: what it has not heard yet, and
what it takes to slow down. No single delay is measured, so a robot that reacts early may brake
later; only the sum counts, as it does for the separation.
"""

from collections import deque
from collections.abc import Callable

SLACK_S = 0.1
"""Added to T_r + T_s: jitter of RobotState and cycles of both sides."""
SPEED_SHARE = 0.1
"""Part of the limit by which a robot may exceed it: servos overshoot, speeds are upper bounds."""
SPEED_SLACK_M_S = 0.05
"""Likewise in m/s: noise of the velocities, at the end of a long arm."""
STANDS_M_S = 0.02
"""A robot that stops is at rest below this speed."""
HELD_NS = 10_000_000_000
"""A robot that was too fast counts as one that does not slow down for this long."""
MOST_STRETCH = 100.0
"""A robot that needs longer than so many times its table does not stop."""


class Obedience:
    """Watches one robot's speed against the limits it was given.

    Args:
        reaction_s: from an advice to the onset of braking, at worst; with the delay of RobotState.
        stopping: speed (m/s) -> T_s (s) and S_s (m) of the stopping table.
        max_speed_m_s: the robot's highest speed in production.

    Attributes:
        stretch: how many times longer than its table says the robot took to stop, at least 1. It
            never falls: the table is wrong until somebody corrects it.
        too_fast, late_stops: how often that began.
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
        self.too_fast = self.late_stops = 0

    def advise(self, limit_m_s: float, now_ns: int) -> None:
        """Note the limit that goes out at ``now_ns``; 0 for a stop."""
        if not self._limits or self._limits[-1][1] != limit_m_s:
            self._limits.append((now_ns, limit_m_s))
        if limit_m_s > 0:
            self._stop = None

    def is_too_fast(self, now_ns: int) -> bool:
        """Whether the robot lately did not keep to its speed limit."""
        return now_ns < self._too_fast_until_ns

    def forget(self) -> None:
        """Nothing is known of the robot for now, or it is not the advice that moves it."""
        self._limits.clear()
        self._speeds.clear()
        self._stop = None

    def see(self, speed_m_s: float, now_ns: int) -> None:
        """Take the speed of the robot's fastest point at ``now_ns``."""
        since_ns = now_ns - round(self._kept_s * max(self.stretch, 1.0) * 1e9)
        self._speeds.append((now_ns, speed_m_s))
        while self._speeds[0][0] < since_ns:
            self._speeds.popleft()
        # of the limits before that time, the last one held on
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
            return  # what was advised before is not known
        held = [limit for at, limit in self._limits if at > since_ns]
        held.append([limit for at, limit in self._limits if at <= since_ns][-1])
        if speed_m_s > max(held) * (1 + SPEED_SHARE) + SPEED_SLACK_M_S:
            self.too_fast += not self.is_too_fast(now_ns)
            self._too_fast_until_ns = now_ns + HELD_NS

    def _see_stop(self, speed_m_s: float, now_ns: int) -> None:
        """Measure a stop from the advice to rest, time and way."""
        if self._stop is None:
            advised_ns = self._limits[-1][0]
            before = [speed for at, speed in self._speeds if at <= advised_ns]
            self._stop = _Stop(advised_ns, max([speed_m_s, *before[-1:]]), now_ns)
        stop = self._stop
        stop.way_m += speed_m_s * (now_ns - stop.seen_ns) * 1e-9
        stop.seen_ns = now_ns
        if stop.ended:
            return
        # a robot may still speed up until it has heard of the stop
        if (now_ns - stop.advised_ns) * 1e-9 <= self._reaction_s:
            stop.speed_m_s = max(stop.speed_m_s, speed_m_s)
        if speed_m_s < STANDS_M_S:
            stop.ended = True
            return
        time_s, way_m = self._stopping(max(stop.speed_m_s, STANDS_M_S))
        braking_s = (now_ns - stop.advised_ns) * 1e-9 - self._reaction_s
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
    """One stop: when it was advised, the robot's speed then, and its way since."""

    def __init__(self, advised_ns: int, speed_m_s: float, seen_ns: int) -> None:
        self.advised_ns = advised_ns
        self.speed_m_s = speed_m_s
        self.seen_ns = seen_ns
        self.way_m = 0.0
        self.ended = self.late = False
