"""Whether any person was ever seen near a robot.

A robot whose place is wrong (another unit, another room) is far from every person, and its advice
is always *clear*. Where people are seen for a while and none of them near it, that is reported.
"""

from hri_predict.protocol.messages import Advice

FAR_M = 8.0
"""A robot at a work place has people nearer than this within a minute in which people are seen."""
WATCH_S = 60.0


class Remote:
    """Reports a robot, once, if all people seen in ``WATCH_S`` were farther than ``FAR_M``.

    Once a person was nearer, the robot is where people are, and is not watched any more.
    """

    def __init__(self) -> None:
        self._seen_s: dict[int, float] = {}
        self._last_s: dict[int, float] = {}
        self._nearest_m: dict[int, float] = {}
        self._done: set[int] = set()

    def observe(self, advice: Advice, now_s: float) -> float | None:
        """Take an advice; return the minimum distance, metres, if its robot is to be reported.

        Args:
            advice: of one tick; without a person its separation is ``None``.
            now_s: time of the node.
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
