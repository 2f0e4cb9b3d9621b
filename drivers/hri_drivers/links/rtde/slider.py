"""The speed slider: converts advice to values for the robot's registers.

A slider that jumps up from 0 puts some robots into a protective stop (Universal_Robots_Client_
Library, issue 58), and their drivers therefore send no fraction between 0 and 0.01. Therefore the
slider stays at 0 for a minimum time and rises with a limited slope. It falls immediately.
"""

import math
from dataclasses import dataclass

from hri_predict.protocol.messages import Advice, Level

LEAST = 0.01
"""The smallest fraction above 0 that is written."""
LONGEST_STEP_S = 0.02
"""After a longer delay of the link, the slider rises only as far as in this time: it must not
jump."""
COUNTS = 2**31
"""The watchdog's register is an INT32; it counts from 0 to 2147483647."""


@dataclass(frozen=True, slots=True)
class Written:
    """Values written into the robot's registers together.

    Attributes:
        fraction: fraction set on the speed slider, 0 to 1.
        watchdog: counts fresh Advice; if it does not change, the robot must stop.
        level: the Advice's level; 0 (*unknown*) without a fresh Advice.
    """

    fraction: float
    watchdog: int
    level: int


NOTHING = Written(0.0, 0, Level.UNKNOWN)


class SpeedSlider:
    """Follows the advice to one robot.

    Args:
        full_speed_m_s: speed of the robot's fastest point with the slider at 1.
        rise_per_s: slope at which the slider rises, per second.
        hold_s: minimum time at 0.
        silence_s: time for which an Advice is valid.
        max_age_s: maximum age of its capture, after which it is no longer valid.

    Attributes:
        timeouts: number of times that 0 was written because an Advice that permits motion had
            become invalid.
    """

    def __init__(
        self,
        *,
        full_speed_m_s: float,
        rise_per_s: float,
        hold_s: float,
        silence_s: float,
        max_age_s: float,
    ) -> None:
        self._full_speed = full_speed_m_s
        self._rise_per_s = rise_per_s
        self._hold_ns = round(hold_s * 1e9)
        self._silence_s, self._max_age_s = silence_s, max_age_s
        self.timeouts = 0
        self._timed_out = False
        self._wanted = 0.0
        self._level = Level.UNKNOWN
        self._until_ns: int | None = None
        self._watchdog = 0
        self._slope = 0.0  # the fraction, before ``LEAST``
        self._at_ns: int | None = None
        self._stopped_ns: int | None = None

    def restart(self) -> None:
        """Restart at 0: the position of the robot's slider is not known."""
        self._until_ns = self._at_ns = self._stopped_ns = None
        self._slope = 0.0

    def take(self, advice: Advice, now_ns: int) -> None:
        """Process a fresh Advice; without an age, or from an old capture, it permits nothing."""
        limit = advice.speed_limit_m_s
        permits = advice.level.may_move and limit is not None and math.isfinite(limit)
        self._wanted = max(0.0, min(1.0, (limit or 0.0) / self._full_speed)) if permits else 0.0
        self._level = advice.level
        left_s = 0.0
        if advice.age_s is not None:  # not a number: 0 is left, as of any age that is too high
            left_s = max(0.0, min(self._max_age_s - advice.age_s, self._silence_s))
        self._until_ns = now_ns + round(left_s * 1e9)
        self._watchdog = (self._watchdog + 1) % COUNTS

    def at(self, now_ns: int) -> Written:
        """Return the values to write now; times never go back."""
        silent = self._until_ns is None or now_ns >= self._until_ns
        self._count(silent)
        wanted = 0.0 if silent else self._wanted
        step_s = 0.0 if self._at_ns is None else (now_ns - self._at_ns) * 1e-9
        self._at_ns = now_ns
        if wanted < LEAST:
            self._slope = 0.0
            self._stopped_ns = now_ns
        elif wanted <= self._slope:
            self._slope = wanted
        elif self._may_rise(now_ns):
            step = self._rise_per_s * min(step_s, LONGEST_STEP_S)
            self._slope = min(wanted, self._slope + step)
        fraction = self._slope if self._slope >= LEAST else 0.0
        return Written(fraction, self._watchdog, Level.UNKNOWN if silent else self._level)

    def _count(self, silent: bool) -> None:
        """Count a timeout once, until the next valid Advice."""
        if not silent:
            self._timed_out = False
        elif self._until_ns is not None and self._wanted >= LEAST and not self._timed_out:
            self._timed_out = True
            self.timeouts += 1

    def _may_rise(self, now_ns: int) -> bool:
        """Whether 0 was held for long enough; at the start, it is timed from the first call."""
        if self._stopped_ns is None:
            self._stopped_ns = now_ns
        return now_ns - self._stopped_ns >= self._hold_ns
