"""The arm behind the servers: it swings, and its controller writes the state every cycle."""

import asyncio
import time
from collections.abc import Callable
from typing import Literal

from hri_sim.rtde.arm import Arm

CYCLE_S = 0.01
COUNTS = 65_536
JOINTS = 6
Fault = Literal["none", "frozen", "not a number", "late", "wrong type", "mode"]
LATE_S = 0.15


class Robot:
    """The state as last written.

    Args:
        fault: kind of fault.
        after_s: time from the first client's connection to the fault, unless ``toggle`` was called.

    Attributes:
        beat: time of the newest cycle, ms of the machine's monotonic clock, modulo 65536; it stops
            when the controller has stopped.
        positions, velocities: rad, rad/s.
    """

    def __init__(self, fault: Fault, after_s: float) -> None:
        self.beat = 0
        self._arm = Arm(watchdog_s=0.0)
        self._arm.move_slider(0.5)  # below 1 m/s, the max_speed_m_s of the shipped configurations
        self.positions, self.velocities = self._arm.positions, self._arm.velocities
        self._fault, self._after_s = fault, after_s
        self._came_s: float | None = None
        self._toggled: bool | None = None

    def seen(self) -> None:
        """Record that a client has read."""
        if self._came_s is None:
            self._came_s = time.monotonic()

    def has(self, fault: Fault) -> bool:
        """Return whether this fault is active."""
        if self._came_s is None or fault != self._fault:
            return False
        if self._toggled is not None:
            return self._toggled
        return time.monotonic() - self._came_s >= self._after_s

    def toggle(self) -> None:
        """Start the fault now, or end it."""
        self._toggled = not self.has(self._fault)

    @property
    def mode(self) -> int:
        """1: automatic mode; 2: manual."""
        return 2 if self.has("mode") else 1

    async def run(self, written: Callable[[], object] = lambda: None) -> None:
        """Write the state every cycle, until cancelled."""
        before_s = due_s = time.monotonic()
        while True:
            due_s = max(due_s + CYCLE_S, time.monotonic())
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            now_s = time.monotonic()
            self._arm.step(now_s, min(now_s - before_s, 0.1))
            before_s = now_s
            if self.has("frozen"):
                continue
            self.beat = time.monotonic_ns() // 1_000_000 % COUNTS
            self.positions, self.velocities = self._arm.positions, self._arm.velocities
            made = written()
            if asyncio.iscoroutine(made):
                await made
