"""Levels: from what is found now to what is advised, with memory.

Down at once: one capture is enough, and the speed limit falls without delay. Up slowly: a milder
level needs its condition beyond a band for a number of *distinct* captures, and the speed limit
rises at a limited rate. A latched stop also needs an acknowledgement; that alone starts nothing.

A stop also makes its own cause go away: what was too near for a moving robot is not too near for
the standing one. So a stop is released only where the speed that the robot is then given can last:
if the permitted speed falls while the captures are counted, it must be enough for as many more.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hri_predict.protocol.messages import Level
from hri_predict.reasons import Reason
from hri_predict.risk.separation import Finding
from hri_predict.risk.settings import RiskSettings

_SEVERITY = {
    Level.CLEAR: 0,
    Level.WARN: 1,
    Level.SLOW: 2,
    Level.STOP: 3,
    Level.UNKNOWN: 3,
    Level.FAULT: 3,
}
_MAX_STEP_S = 1.0
"""A pause between ticks counts for at most this long when the speed limit rises."""


def severity(level: Level) -> int:
    """How much a level asks; *unknown* and *fault* ask for a stop."""
    return _SEVERITY[level]


@dataclass(frozen=True, slots=True)
class Demand:
    """What one tick asks of one robot.

    Attributes:
        level: what is asked now.
        release: what would be asked if everything were nearer by the band: as mild as a release
            may go, never milder than ``level``.
        limit_m_s: speed limit now.
        release_limit_m_s: up to which the speed limit may rise.
        reason: of ``level``.
    """

    level: Level
    release: Level
    limit_m_s: float
    release_limit_m_s: float
    reason: Reason

    @classmethod
    def nothing(cls, max_speed_m_s: float) -> "Demand":
        """Nobody is near."""
        return cls(Level.CLEAR, Level.CLEAR, max_speed_m_s, max_speed_m_s, Reason.NONE)

    @classmethod
    def unknown(cls, reason: Reason) -> "Demand":
        """Nothing can be said, for ``reason``."""
        return cls(Level.UNKNOWN, Level.UNKNOWN, 0.0, 0.0, reason)

    def milder(self, other: "Demand") -> "Demand":
        """What either permits, where one is enough: the lower levels, the higher limits."""
        rank, other_rank = severity(self.level), severity(other.level)
        mild = other if (other_rank, self.limit_m_s) < (rank, other.limit_m_s) else self
        return Demand(
            mild.level,
            min(self.release, other.release, key=severity),
            max(self.limit_m_s, other.limit_m_s),
            max(self.release_limit_m_s, other.release_limit_m_s),
            mild.reason,
        )

    def __or__(self, other: "Demand") -> "Demand":
        """Both at once: the severer level with its reason, the lower limits."""
        rank, other_rank = severity(self.level), severity(other.level)
        worse = other if (other_rank, self.limit_m_s) > (rank, other.limit_m_s) else self
        release = max(self.release, other.release, key=severity)
        return Demand(
            worse.level,
            release,
            min(self.limit_m_s, other.limit_m_s),
            min(self.release_limit_m_s, other.release_limit_m_s),
            worse.reason,
        )


def margins(settings: RiskSettings) -> tuple[float, float, float, float]:
    """The margins at which ``demand_of`` wants the speed limits of a finding."""
    slow, warn = settings.slow_margin_m, settings.slow_margin_m + settings.warn_margin_m
    return slow, slow + settings.band_m, warn, warn + settings.band_m


def demand_of(
    finding: Finding, settings: RiskSettings, max_speed_m_s: float, reason: Reason
) -> Demand:
    """Level and limits of one finding, whose ``limits`` are for ``margins(settings)``.

    stop: the separation is violated at the present speed, or the limit is below ``min_speed_m_s``.
    slow: the limit is below the robot's highest speed. warn: it would be if the hazard were nearer
    by ``warn_margin_m``.
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
        now,
        max(now, release, key=severity),
        0.0 if now is Level.STOP else slow,
        0.0 if release is Level.STOP else slow_band,
        reason if now is not Level.CLEAR else Reason.NONE,
    )


def combined(demands: Sequence[Demand], max_speed_m_s: float) -> Demand:
    """All demands at once."""
    result = Demand.nothing(max_speed_m_s)
    for demand in demands:
        result = result | demand
    return result


@dataclass(frozen=True, slots=True)
class Advised:
    """What is advised: level, reason, speed limit, id of the latched stop (0: none)."""

    level: Level
    reason: Reason
    limit_m_s: float
    latch_id: int


class LevelMachine:
    """The memory of one robot's advice.

    It begins at *unknown*, so that it takes ``release_captures`` captures before anything moves.

    Args:
        settings: band, counts, rates.
        max_speed_m_s: of the robot.
        next_latch_id: gives each latched stop its own id, never 0.
    """

    def __init__(
        self, settings: RiskSettings, max_speed_m_s: float, next_latch_id: Callable[[], int]
    ) -> None:
        self._settings = settings
        self._max_speed = max_speed_m_s
        self._next_latch_id = next_latch_id
        self._level = Level.UNKNOWN
        self._limit = 0.0
        self._latch_id = 0
        self._cause_cleared = False
        self._agreed = 0
        self._counted_from = 0.0  # the permitted speed when counting began
        self._last_capture: int | None = None
        self._last_ns: int | None = None

    @property
    def latch_id(self) -> int:
        """Id of the latched stop, 0 when none is latched."""
        return self._latch_id

    def reset(self) -> None:
        """Forget all that speaks for a release (a tick has failed); a latch stays."""
        self._level = Level.UNKNOWN
        self._limit = 0.0
        self._agreed = 0
        self._cause_cleared = False

    def update(self, demand: Demand, captures: int, now_ns: int) -> Advised:
        """Advance by one tick.

        Args:
            demand: what this tick asks.
            captures: number of distinct captures so far.
            now_ns: the tick's time.
        """
        seconds = 0.0 if self._last_ns is None else (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        self._cause_cleared = severity(demand.release) < severity(Level.STOP)
        pending = self._advance(demand, captures)
        self._last_capture = captures
        self._move_limit(demand, min(max(seconds, 0.0), _MAX_STEP_S))
        return Advised(self._level, pending or demand.reason, self._limit, self._latch_id)

    def acknowledge(self, latch_id: int) -> bool:
        """Release the latch if ``latch_id`` is the present one and its cause has cleared.

        The captures that a release needs are counted from here on.
        """
        if latch_id == 0 or latch_id != self._latch_id or not self._cause_cleared:
            return False
        self._latch_id = 0
        self._agreed = 0
        return True

    def _advance(self, demand: Demand, captures: int) -> Reason | None:
        """Change the level; the reason why it is severer than what is asked, if it is."""
        if severity(demand.level) >= severity(self._level):
            self._agreed = 0
            self._level = demand.level
            if demand.level is Level.STOP and self._settings.latch_stop and not self._latch_id:
                self._latch_id = self._next_latch_id()
            return None
        if self._latch_id:
            self._agreed = 0
            self._level = Level.STOP
            return Reason.LATCHED if self._cause_cleared else Reason.RELEASE_PENDING
        release = demand.release
        rising = self._limit < self._max_speed  # a robot that is not yet at full speed is slowed
        if rising:
            release = max(release, Level.SLOW, key=severity)
        if severity(release) >= severity(self._level):  # within the band, or still rising
            self._agreed = 0
            if severity(release) == severity(self._level):
                self._level = release  # what was unknown is known now
            within = severity(demand.release) >= severity(self._level)
            return demand.reason if within and demand.reason else Reason.RELEASE_PENDING
        if captures != self._last_capture:
            if self._agreed == 0:
                self._counted_from = demand.release_limit_m_s
            self._agreed += 1
        if self._agreed < self._settings.release_captures:
            return Reason.RELEASE_PENDING
        self._agreed = 0
        if not self._lasts(demand):
            return Reason.RELEASE_PENDING
        self._level = release
        return None if severity(release) == severity(demand.level) else Reason.RELEASE_PENDING

    def _lasts(self, demand: Demand) -> bool:
        """Whether the speed would do for as many captures more, should it go on as it was."""
        then = 2 * demand.release_limit_m_s - self._counted_from
        return severity(self._level) < severity(Level.STOP) or then >= self._settings.min_speed_m_s

    def _move_limit(self, demand: Demand, seconds: float) -> None:
        if severity(self._level) >= severity(Level.STOP):
            self._limit = 0.0
            return
        rising = self._limit + self._settings.speed_rise_m_s2 * seconds
        allowed = max(self._limit, min(rising, demand.release_limit_m_s))
        self._limit = min(allowed, demand.limit_m_s, self._max_speed)
