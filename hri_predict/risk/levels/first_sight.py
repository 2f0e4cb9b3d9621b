"""First sight: a person whose speed cannot be measured yet slows the robot only until it is.

Whoever appears is of unknown speed for the first captures, and unknown is not slow: the level rises
at once. When the speed has been measured, what was advised before holds again, as far as the demand
of this tick permits it with its band. No captures are counted: that guards against noise at a
threshold, and here nothing crossed one. It happens at most once within ``captures`` captures, so a
speed that comes and goes is released like everything else.
"""

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand, severity


class FirstSight:
    """What was advised before somebody of unknown speed appeared.

    Args:
        captures: a speed that is unknown for longer is no first sight.
    """

    def __init__(self, captures: int) -> None:
        self._captures = captures
        self._before: tuple[Level, float, int] | None = None
        self._last: int | None = None

    def reset(self) -> None:
        """Forget what was advised before."""
        self._before = None

    def update(
        self, demand: Demand, level: Level, limit_m_s: float, captures: int
    ) -> tuple[Level, float] | None:
        """Advance by one tick.

        Args:
            demand: of this tick.
            level, limit_m_s: advised until now.
            captures: number of distinct captures so far.

        Returns:
            level and limit that hold again; ``None``: none do.
        """
        if demand.reason is Reason.SPEED_UNKNOWN:
            if self._before is None:
                self._before = level, limit_m_s, captures
            return None
        if self._before is None:
            return None
        level, limit_m_s, since = self._before
        self._before = None
        recently = self._last is not None and captures - self._last <= self._captures
        if captures - since > self._captures or recently:
            return None
        if severity(demand.release) >= severity(Level.STOP):
            return None
        self._last = captures
        return max(level, demand.release, key=severity), min(limit_m_s, demand.release_limit_m_s)
