"""First sight: a person whose speed cannot be measured yet slows the robot only until it is.

The speed of a person who appears is unknown for the first captures, and unknown does not mean slow:
the level rises at once. When the speed has been measured, the earlier advice holds again, as far as
the demand of this tick permits it with its band. No captures are counted: counting protects against
noise at a threshold, and here nothing crossed a threshold. This happens at most once within
``captures`` captures, so a speed that comes and goes is released like everything else.
"""

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand, by_rank


class FirstSight:
    """The advice from before a person of unknown speed appeared.

    Args:
        captures: grace period in captures, during which an unknown speed is accepted.
    """

    def __init__(self, captures: int) -> None:
        self._captures = captures
        self._before: tuple[Level, float, int] | None = None
        self._last: int | None = None

    def reset(self) -> None:
        """Forget the earlier advice."""
        self._before = None

    def update(
        self, demand: Demand, level: Level, limit_m_s: float, captures: int
    ) -> tuple[Level, float] | None:
        """Advance by one tick.

        Args:
            demand: this tick's demand.
            level, limit_m_s: the level and limit advised until now.
            captures: number of distinct captures so far.

        Returns:
            the level and limit that hold again; ``None``: none.
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
        if not demand.release.may_move:
            return None
        self._last = captures
        return max(level, demand.release, key=by_rank), min(limit_m_s, demand.release_limit_m_s)
