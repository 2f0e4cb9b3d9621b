"""Time budget for muting a robot.

It recovers while muting is not requested.

A limit per request would have no effect, because releasing the request for a moment would restart
the time. So the budget covers all muted time. It recovers ``max_s`` in ``rest_s``, but only while
the request is seen released. After it was used up, muting may start again only when the budget has
recovered completely. So in any T seconds a robot is muted for at most ``max_s`` + T x ``max_s`` /
(``max_s`` + ``rest_s``).
"""

import math

from hri_predict.robots.modes import MutingMode

_NS = 1_000_000_000


class MutedTime:
    """The muting budget of one robot.

    Args:
        settings: size of the budget, and its recovery rate.
    """

    def __init__(self, settings: MutingMode) -> None:
        self._max_s = settings.max_s
        self._rate = settings.recovery_s / settings.max_s
        self._whole_ns = settings.recovery_s * _NS
        self._debt_ns = 0.0  # time without a request until all of it is back
        self._used_up = False
        self._before_ns: int | None = None
        self._was_released = False

    def count(self, now_ns: int, *, muted: bool, released: bool) -> None:
        """Account for the time since the previous tick.

        Args:
            now_ns: this tick's time.
            muted: whether the robot was muted since the previous tick.
            released: whether the request is seen released at this tick.
        """
        since_ns = max(now_ns - (self._before_ns if self._before_ns is not None else now_ns), 0)
        if muted:
            self._debt_ns += since_ns * self._rate
        elif released and self._was_released:
            self._debt_ns = max(self._debt_ns - since_ns, 0.0)
        self._before_ns, self._was_released = now_ns, released
        if self._debt_ns > self._whole_ns - 1.0:  # 1 ns: rounding of the product
            self.use_up()
        self._used_up = self._used_up and self._debt_ns > 1.0

    def use_up(self) -> None:
        """Empty the budget, because it was used up or its use is unknown."""
        self._debt_ns, self._used_up = self._whole_ns, True

    @property
    def may_begin(self) -> bool:
        """Whether muting may start or continue."""
        return not self._used_up

    @property
    def left_s(self) -> float:
        """Remaining muting time, in seconds."""
        return 0.0 if self._used_up else self._max_s - self._debt_ns / self._rate / _NS

    @property
    def used_s(self) -> int:
        """Seconds used, rounded up; the full budget until a used-up budget has recovered."""
        return math.ceil(self._max_s - self.left_s)

    def recall(self, used_s: float) -> None:
        """Restore ``used_s`` from an earlier run.

        Raises:
            TypeError, ValueError: it is not a number of seconds.
        """
        if not 0 <= used_s < math.inf:
            raise ValueError(f"{used_s} s of muting")
        self._debt_ns = used_s * self._rate * _NS
        if used_s >= self._max_s:
            self.use_up()
