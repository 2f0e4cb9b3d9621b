"""The arm of the simulated controller: it swings to and fro at the speed set by the slider."""

import math

REST = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)
SWING = (0.6, 0.2, 0.2, 0.0, 0.0, 0.4)
"""Amplitude of each joint, rad."""
PHASE_RATE = 1.0
"""Angular frequency of the swing, rad/s, with the slider at 1."""
RAMP_PER_S = 2.0
"""Rate at which the speed follows the slider, fraction per second."""
JUMP = 0.1
"""A step of the slider from 0 by more than this causes a protective stop."""

NORMAL, PROTECTIVE_STOP = 1, 3  # safety_mode
PLAYING, PAUSED = 2, 4  # runtime_state


class Arm:
    """An arm of six joints whose program never ends.

    It obeys the slider, and its program pauses if the watchdog register stops changing or the level
    permits no motion.

    Args:
        watchdog_s: time without a new value in the watchdog register after which the program
            pauses; 0: never.

    Attributes:
        slider: fraction of the speed slider.
        safety_mode, runtime_state: as numbered by RTDE.
    """

    def __init__(self, watchdog_s: float) -> None:
        self.slider = 1.0  # as an operator leaves it
        self.safety_mode = NORMAL
        self.runtime_state = PLAYING
        self._watchdog_s = watchdog_s
        self._watchdog = 0
        self._changed_s = -math.inf
        self._level = 0
        self._phase = self._rate = 0.0

    def move_slider(self, fraction: float) -> None:
        """Move the slider; as in some controllers, a jump from 0 stops the arm for good."""
        if self.slider == 0.0 and fraction > JUMP:
            self.safety_mode = PROTECTIVE_STOP
        self.slider = fraction

    def hear(self, watchdog: int, level: int, now_s: float) -> None:
        """Accept the watchdog and the level that a client has written."""
        if watchdog != self._watchdog:
            self._watchdog, self._changed_s = watchdog, now_s
        self._level = level

    def step(self, now_s: float, dt: float) -> None:
        """Advance by ``dt`` seconds."""
        silent = now_s - self._changed_s > self._watchdog_s
        guarded = bool(self._watchdog_s) and (silent or self._level not in (1, 2, 3))
        self.runtime_state = PAUSED if guarded else PLAYING
        stands = guarded or self.safety_mode != NORMAL
        wanted = 0.0 if stands else self.slider
        step = RAMP_PER_S * dt
        self._rate += max(-step, min(step, wanted - self._rate))
        self._phase += PHASE_RATE * self._rate * dt

    @property
    def positions(self) -> list[float]:
        """Six angles, rad."""
        turned = math.sin(self._phase)
        return [rest + swing * turned for rest, swing in zip(REST, SWING, strict=True)]

    @property
    def velocities(self) -> list[float]:
        """Six angular velocities, rad/s."""
        turning = math.cos(self._phase) * PHASE_RATE * self._rate
        return [swing * turning for swing in SWING]
