"""Whether a robot follows its advice: it keeps the speed limit and stops as its table says.

The node relies on both. It judges a person's separation with the robot's present speed. But it
grants a limit because the robot will keep it, and it relies on a stop because the robot stops in
time. The robot must be no faster than the highest limit advised within the last T_r + T_s: the time
until it hears a limit, and the time to slow down. No single delay is measured, so a robot that
reacts early may brake later; only the sum counts, as it does for the separation.
"""

import logging
from collections import deque
from collections.abc import Callable

log = logging.getLogger(__name__)

SLACK_S = 0.1
"""Added to T_r + T_s: jitter of RobotState and cycles of both sides."""
SPEED_SHARE = 0.1
"""A robot may exceed its limit by this part of it: servos overshoot, speeds are upper bounds."""
SPEED_SLACK_M_S = 0.05
"""The same in m/s: noise of the velocities, at the end of a long arm."""
STANDS_M_S = 0.02
"""A robot that stops is at rest below this speed."""
HELD_NS = 10_000_000_000
"""For this long, a robot that was too fast counts as a robot that does not slow down."""
MOST_STRETCH = 100.0
"""A robot that needs more than this many times the time in its table does not stop."""


class Obedience:
    """Watches one robot's speed against the limits it was given.

    Args:
        reaction_s: longest time from an advice to the onset of braking, with RobotState's delay.
        stopping: speed (m/s) -> T_s (s) and S_s (m) of the stopping table.
        max_speed_m_s: the robot's highest speed in production.

    Attributes:
        stretch: the robot's time to stop divided by its table's, at least 1. It never falls: the
            table is wrong until it is corrected.
        too_fast, late_stops: number of times each of these began.
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
        """Log that the robot stops late; call it after each ``see``.

        It is logged at once, and each time that the robot is twice as late. What the table has to
        be corrected by is known only when the stop is over.
        """
        is_over = self._stop is None or self._stop.ended
        is_worse = self.stretch > self._warned if is_over else self.stretch >= 2 * self._warned
        if self.stretch <= 1.0 or not is_worse:
            return
        self._warned = self.stretch
        log.warning(
            "robot %s needed %s%.2f times what its stopping table says to stop; from now on the "
            "table's values count times that factor and a tenth more; correct it, or find why the "
            "robot does not obey",
            robot,
            "" if is_over else "at least ",
            self.stretch,
        )

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
        """Nothing is known of the robot now, or something other than the advice moves it."""
        self._limits.clear()
        self._speeds.clear()
        self._stop = None

    def see(self, speed_m_s: float, now_ns: int) -> None:
        """Take the speed of the robot's fastest point at ``now_ns``."""
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
    """One stop: when it was advised, the robot's speed then, and its travel since."""

    def __init__(self, advised_ns: int, speed_m_s: float, seen_ns: int) -> None:
        self.advised_ns = advised_ns
        self.speed_m_s = speed_m_s
        self.seen_ns = seen_ns
        self.way_m = 0.0
        self.ended = self.late = False
