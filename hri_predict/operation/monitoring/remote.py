"""Detects a robot that no observed person ever comes near.

A robot with a wrong position (another unit, another room) is far from every person, and its advice
is always *clear*. It is reported if people are observed for a while, but none near it.
"""

from hri_predict.protocol.messages import Advice

FAR_M = 8.0
"""Near a robot at a workplace, a person comes nearer than this within a minute of observation."""
WATCH_S = 60.0
REMEDY = "check that its position and the source's are in metres and in the same room frame"
"""Remedy for a robot that is far from everything observed."""


class Remote:
    """Reports a robot once if all people observed in ``WATCH_S`` were farther than ``FAR_M``.

    After a person was nearer, the robot's position is plausible and is no longer watched.
    """

    def __init__(self) -> None:
        self._seen_s: dict[int, float] = {}
        self._last_s: dict[int, float] = {}
        self._nearest_m: dict[int, float] = {}
        self._done: set[int] = set()

    def observe(self, advice: Advice, now_s: float) -> float | None:
        """Process an advice; return the minimum distance in metres if its robot is to be reported.

        Args:
            advice: advice of one tick; its separation is ``None`` without a person.
            now_s: the node's time.
        """
        robot, away_m = advice.robot, advice.separation_m
        since_s = now_s - self._last_s.get(robot, now_s)
        self._last_s[robot] = now_s
        if robot in self._done or away_m is None:
            return None
        if away_m <= FAR_M:
            self._done.add(robot)
            return None
        self._nearest_m[robot] = min(away_m, self._nearest_m.get(robot, away_m))
        self._seen_s[robot] = self._seen_s.get(robot, 0.0) + min(since_s, 1.0)
        if self._seen_s[robot] < WATCH_S:
            return None
        self._done.add(robot)
        return self._nearest_m[robot]
