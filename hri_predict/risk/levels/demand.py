"""Demands: the demand of one tick on one robot, and the combination of several demands."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding

by_rank = attrgetter("rank")


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """Demand of one tick on one robot.

    Attributes:
        level: the level demanded now.
        release: level demanded if all hazards were nearer by the band. A release may go no further
            than this level, which is never milder than ``level``.
        limit_m_s: speed limit now.
        release_limit_m_s: maximum value to which the speed limit may rise.
        reason: reason of ``level``.
    """

    level: Level
    release: Level
    limit_m_s: float
    release_limit_m_s: float
    reason: Reason

    @classmethod
    def nothing(cls, max_speed_m_s: float) -> "Demand":
        """No person is near."""
        return cls(
            level=Level.CLEAR,
            release=Level.CLEAR,
            limit_m_s=max_speed_m_s,
            release_limit_m_s=max_speed_m_s,
            reason=Reason.NONE,
        )

    @classmethod
    def unknown(cls, reason: Reason) -> "Demand":
        """Return the demand for an unknown situation with this ``reason``."""
        return cls(
            level=Level.UNKNOWN,
            release=Level.UNKNOWN,
            limit_m_s=0.0,
            release_limit_m_s=0.0,
            reason=reason,
        )

    def milder(self, other: "Demand") -> "Demand":
        """Combine demands if one is sufficient: the lower levels and the higher limits."""
        rank, other_rank = self.level.rank, other.level.rank
        mild = other if (other_rank, self.limit_m_s) < (rank, other.limit_m_s) else self
        return Demand(
            level=mild.level,
            release=min(self.release, other.release, key=by_rank),
            limit_m_s=max(self.limit_m_s, other.limit_m_s),
            release_limit_m_s=max(self.release_limit_m_s, other.release_limit_m_s),
            reason=mild.reason,
        )

    def at_least(self, level: Level, reason: Reason) -> "Demand":
        """Return this demand, but no milder than ``level``, with this ``reason``."""
        milder = self.level.rank < level.rank
        return replace(
            self,
            level=level if milder else self.level,
            release=max(self.release, level, key=by_rank),
            reason=reason if milder else self.reason,
        )

    def full_or_stop(self, reason: Reason) -> "Demand":
        """Return this demand for a robot that does not follow speed limits: slow becomes stop."""
        slows = self.level is Level.SLOW
        release_slows = self.release.rank >= Level.SLOW.rank
        return Demand(
            level=Level.STOP if slows else self.level,
            release=max(self.release, Level.STOP, key=by_rank) if release_slows else self.release,
            limit_m_s=0.0 if slows else self.limit_m_s,
            release_limit_m_s=0.0 if release_slows else self.release_limit_m_s,
            reason=reason if slows else self.reason,
        )

    def __or__(self, other: "Demand") -> "Demand":
        """Combine demands that both apply: the stricter level with its reason, the lower limits."""
        rank, other_rank = self.level.rank, other.level.rank
        worse = other if (other_rank, self.limit_m_s) > (rank, other.limit_m_s) else self
        release = max(self.release, other.release, key=by_rank)
        return Demand(
            level=worse.level,
            release=release,
            limit_m_s=min(self.limit_m_s, other.limit_m_s),
            release_limit_m_s=min(self.release_limit_m_s, other.release_limit_m_s),
            reason=worse.reason,
        )


def demand_of(
    finding: Finding, settings: RiskSettings, max_speed_m_s: float, reason: Reason
) -> Demand:
    """Return level and limits of one finding; its ``limits`` correspond to ``settings.margins_m``.

    stop: the separation is violated at the present speed, or the limit is below ``min_speed_m_s``.
    slow: the limit is below the robot's highest speed. warn: the limit would be below it if the
    hazard were nearer by ``warn_margin_m``.
    """
    slow, slow_band, warn, warn_band = finding.limits

    def level(slack_m: float, slow_limit: float, warn_limit: float) -> Level:
        if not slack_m >= 0 or slow_limit < settings.min_speed_m_s:
            return Level.STOP
        if slow_limit < max_speed_m_s:
            return Level.SLOW
        return Level.WARN if warn_limit < max_speed_m_s else Level.CLEAR

    now = level(finding.slack_m, slow, warn)
    release = level(finding.slack_m - settings.band_m, slow_band, warn_band)
    return Demand(
        level=now,
        release=max(now, release, key=by_rank),
        limit_m_s=0.0 if now is Level.STOP else slow,
        release_limit_m_s=0.0 if release is Level.STOP else slow_band,
        reason=reason if now is not Level.CLEAR else Reason.NONE,
    )


def combined(demands: Sequence[Demand], max_speed_m_s: float) -> Demand:
    """Return the combination of all demands."""
    result = Demand.nothing(max_speed_m_s)
    for demand in demands:
        result = result | demand
    return result
