"""Remaining time for which a robot may be muted: a budget that muting uses up.

It recovers while muting is not requested.

A limit for each request alone would limit nothing: a request that is released for a moment would
begin it again. So all the muted time counts. The budget recovers at ``max_s`` in ``rest_s``, and
only while the request is seen released. Once it is used up, muting may begin again when the whole
of it is back. So in any T seconds a robot is muted for at most
``max_s`` + T x ``max_s`` / (``max_s`` + ``rest_s``).
"""

import math

from hri_predict.robots.modes import MutingMode

_NS = 1_000_000_000


class MutedTime:
    """The budget of one robot.

    Args:
        settings: how much it is, and how fast it recovers.
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
        """Count the time since the tick before.

        Args:
            now_ns: this tick's time.
            muted: whether the robot was muted since the tick before.
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
        """Leave nothing: what was used is not known, or all of it was."""
        self._debt_ns, self._used_up = self._whole_ns, True

    @property
    def may_begin(self) -> bool:
        """Whether muting may begin, or continue."""
        return not self._used_up

    @property
    def left_s(self) -> float:
        """Seconds that it may still last."""
        return 0.0 if self._used_up else self._max_s - self._debt_ns / self._rate / _NS

    @property
    def used_s(self) -> int:
        """Whole seconds used, rounded up; all of them until a budget that was used up is back."""
        return math.ceil(self._max_s - self.left_s)

    def recall(self, used_s: float) -> None:
        """Take ``used_s`` from an earlier run.

        Raises:
            TypeError, ValueError: it is not a number of seconds.
        """
        if not 0 <= used_s < math.inf:
            raise ValueError(f"{used_s} s of muting")
        self._debt_ns = used_s * self._rate * _NS
        if used_s >= self._max_s:
            self.use_up()
