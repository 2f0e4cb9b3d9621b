"""The level machine: determines the advised level from this tick's demand and its memory.

Levels become stricter without delay: one capture is enough, and the speed limit falls immediately.
They become milder slowly: a milder level requires its condition, plus a band, for a number of
*distinct* captures, and the speed limit rises at a limited rate. A latch also requires an
acknowledgement, which alone does not start any motion. The causes of a latch are configured
(``risk.latch``), and all causes since the last acknowledgement are listed.

An id identifies the content of an acknowledgement: the latch, lost people, or both. When something
is added, the id changes, because the operator who presses the button has not seen the addition.

A stop also removes its own cause: a person who is too close to a moving robot is not too close to a
standing robot. So a stop is released only if the new speed can be kept: if the permitted speed
falls while captures are counted, it must remain sufficient for the same number of further captures.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand, by_rank
from hri_predict.risk.settings import RiskSettings

# -- first sight: a person whose speed cannot be measured yet slows the robot only until it is -----
#
# The speed of a person who appears is unknown for the first captures, and unknown does not mean
# slow: the level rises at once. When the speed has been measured, the earlier advice holds again,
# as far as the demand of this tick permits it with its band. No captures are counted: counting
# protects against noise at a threshold, and here nothing crossed a threshold. This happens at
# most once within ``captures`` captures, so a speed that comes and goes is released like
# everything else.


class FirstSight:
    """Keeps the advice from before a person of unknown speed appeared.

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
            level, limit_m_s: the level and limit advised so far.
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


# --------------------------------------------------------------------------------------------------

_MAX_STEP_S = 1.0
"""Maximum time between ticks that is credited to the rise of the speed limit."""


@dataclass(frozen=True, slots=True)
class Advised:
    """Advice: level, reason, speed limit, id to acknowledge, causes of the latch.

    ``latch_id`` is 0 while there is nothing to acknowledge.
    """

    level: Level
    reason: Reason
    limit_m_s: float
    latch_id: int
    causes: tuple[str, ...] = ()


class LevelMachine:
    """Memory for one robot's advice.

    It starts at *unknown*, so that the robot cannot move before ``release_captures`` captures.

    Args:
        settings: band, counts, rates.
        max_speed_m_s: the robot's highest speed.
        next_latch_id: returns a new id for acknowledgement, never 0.
    """

    def __init__(
        self, settings: RiskSettings, max_speed_m_s: float, next_latch_id: Callable[[], int]
    ) -> None:
        self._settings = settings
        self._robot_m_s = self._max_speed = max_speed_m_s
        self._next_latch_id = next_latch_id
        self._level = Level.UNKNOWN
        self._limit = 0.0
        self._latch_id = 0
        self._causes: tuple[str, ...] = ()
        self._lost = 0  # the set of lost people that an acknowledgement would end; 0: none
        self._has_grown = False  # since the number was given
        self._cause_cleared = False
        self._cleared_ns = 0  # since when
        self._agreed = 0
        self._counted_from = 0.0  # the permitted speed when counting began
        self._last_capture: int | None = None
        self._last_ns: int | None = None
        self._first_sight = FirstSight(settings.release_captures)

    @property
    def latch_id(self) -> int:
        """Id to acknowledge now; 0 if there is nothing to acknowledge."""
        return self._latch_id if self._lost or self._cause_cleared else 0

    def reset(self) -> None:
        """Forget everything that supports a release, after a failed tick; a latch stays."""
        self._level = Level.UNKNOWN
        self._limit = 0.0
        self._agreed = 0
        self._cause_cleared = False
        self._first_sight.reset()

    def latch(self, cause: str) -> None:
        """Latch for ``cause`` if it is configured; add the cause to an existing latch."""
        if cause not in self._settings.latch or cause in self._causes:
            return
        self._causes += (cause,)
        self._has_grown = True

    def remember(self) -> dict[str, Any]:
        """Return the data to be kept over a restart: the latch."""
        return {"causes": list(self._causes)}

    def recall(self, data: Mapping[str, Any]) -> None:
        """Restore the latch of an earlier run; ``data``: result of ``remember``."""
        causes = [str(cause) for cause in data["causes"]]
        self._causes = tuple(dict.fromkeys([*causes, *self._causes]))
        self._has_grown = True

    def update(
        self,
        demand: Demand,
        captures: int,
        now_ns: int,
        causes: Sequence[str] = (),
        *,
        lost: int = 0,
        cap_m_s: float = math.inf,
        muted: Demand | None = None,
    ) -> Advised:
        """Advance by one tick.

        Args:
            demand: this tick's demand.
            captures: number of distinct captures so far.
            now_ns: the tick's time.
            causes: present causes of a latch, other than a stop.
            lost: as ``PeopleSnapshot.to_acknowledge``.
            cap_m_s: additional speed limit, which does not change the level by itself.
            muted: the demand that muting replaced: muting does not clear the cause of a latch.
        """
        self._max_speed = min(self._robot_m_s, cap_m_s)
        seconds = 0.0 if self._last_ns is None else (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        for cause in causes:
            self.latch(cause)
        lasting = any(cause in self._causes for cause in causes)
        cleared = self._allows(demand) and (muted is None or self._allows(muted))
        before, self._cause_cleared = self._cause_cleared, cleared and not lasting
        if not before:
            self._cleared_ns = now_ns
        again = self._first_sight.update(demand, self._level, self._limit, captures)
        if again is not None and not self._causes:
            self._level, self._limit = again
            self._agreed = 0
        pending = self._advance(demand, captures)
        self._last_capture = captures
        self._move_limit(demand, min(max(seconds, 0.0), _MAX_STEP_S))
        reason = pending or demand.reason
        self._renumber(lost)
        return Advised(self._level, reason, self._limit, self.latch_id, self._causes)

    def acknowledge(self, latch_id: int, down_ns: int = 0) -> bool:
        """Release the latch if ``latch_id`` is the present id and its cause has cleared.

        For a supervised restart the cause must also have been cleared when the button was pressed,
        at ``down_ns``. The id is then used up; anything that remains gets a new id. The captures
        for a release are counted from now on.
        """
        if latch_id == 0 or latch_id != self._latch_id:
            return False
        self._has_grown = True
        if not self._causes or not self._cause_cleared:
            return False
        if self._settings.restart == "supervised" and self._cleared_ns > down_ns:
            return False
        self._causes = ()
        self._agreed = 0
        return True

    def _allows(self, demand: Demand) -> bool:
        """Return whether this tick's demand permits acknowledging a latch."""
        if self._settings.restart == "supervised":
            return demand.release is Level.CLEAR
        return demand.release.may_move

    def _renumber(self, lost: int) -> None:
        """Assign a new id if something was added."""
        self._has_grown |= lost not in (0, self._lost)
        self._lost = lost
        if not self._causes and not lost:
            self._latch_id = 0
        elif self._has_grown or not self._latch_id:
            self._latch_id = self._next_latch_id()
            self._has_grown = False

    def _advance(self, demand: Demand, captures: int) -> Reason | None:
        """Update the level. Return why it is stricter than the demand; ``None`` if it is not."""
        if demand.level is Level.STOP:
            self.latch("stop")
        if self._causes and demand.level.may_move:
            self._agreed = 0
            self._level = Level.STOP
            return Reason.LATCHED
        if demand.level.rank >= self._level.rank:
            self._agreed = 0
            self._level = demand.level
            return None
        release = demand.release
        rising = self._limit < self._max_speed  # a robot that is not yet at full speed is slowed
        if rising:
            release = max(release, Level.SLOW, key=by_rank)
        if release.rank >= self._level.rank:  # within the band, or still rising
            self._agreed = 0
            if release.rank == self._level.rank:
                self._level = release  # the unknown is now known
            within = demand.release.rank >= self._level.rank
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
        return None if release.rank == demand.level.rank else Reason.RELEASE_PENDING

    def _lasts(self, demand: Demand) -> bool:
        """Return whether a speed that keeps falling suffices for that many further captures."""
        then = 2 * demand.release_limit_m_s - self._counted_from
        return self._level.may_move or then >= self._settings.min_speed_m_s

    def _move_limit(self, demand: Demand, seconds: float) -> None:
        if not self._level.may_move:
            self._limit = 0.0
            return
        rising = self._limit + self._settings.speed_rise_m_s2 * seconds
        allowed = max(self._limit, min(rising, demand.release_limit_m_s))
        self._limit = min(allowed, demand.limit_m_s, self._max_speed)
