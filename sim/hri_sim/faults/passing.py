"""Faults that sources and links share: what passes is lost, doubled, swapped or late."""

from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

import numpy as np
from pydantic import Field

from hri_sim.faults.settings import FaultSettings

T = TypeVar("T")


class Drop(FaultSettings):
    """Scenes are lost."""

    probability: float = Field(1.0, gt=0, le=1, description="chance that a scene is lost")


class Late(FaultSettings):
    """A fault that makes late what passes."""

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return by how much, for what passes ``elapsed_ns`` after the start."""
        raise NotImplementedError


class Delay(Late):
    """Scenes arrive late; their capture stamps are true."""

    delay_s: float = Field(0.2, gt=0, le=10, description="delay of every scene")

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return the delay."""
        return int(self.delay_s * 1e9)


class Jitter(Late):
    """Scenes arrive late by a random time, still in order."""

    max_s: float = Field(
        0.08, gt=0, le=10, description="scenes are late by a random time up to this"
    )

    def late_ns(self, elapsed_ns: int, rng: np.random.Generator) -> int:
        """Return a random time."""
        return int(rng.uniform(0.0, self.max_s) * 1e9)


class Duplicate(FaultSettings):
    """Every scene arrives twice."""


class Reorder(FaultSettings):
    """Every other scene arrives after its successor."""


class Way(Generic[T]):
    """One direction: what is held back or under way.

    Args:
        rng: generator of the random choices.

    Attributes:
        late: arrival time and unit, in the order of arrival.
        held: the unit that waits for its successor.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.late: deque[tuple[int, T]] = deque()
        self.held: T | None = None

    def altered(self, fault: FaultSettings, unit: T) -> list[T]:
        """Return what comes of a unit if it is lost, doubled or swapped; otherwise the unit."""
        if isinstance(fault, Drop):
            return [] if self.rng.random() < fault.probability else [unit]
        if isinstance(fault, Duplicate):
            return [unit, unit]
        if isinstance(fault, Reorder):
            held, self.held = self.held, unit if self.held is None else None
            return [] if held is None else [unit, held]
        return [unit]

    def let_go(self, active: Sequence[FaultSettings]) -> list[T]:
        """Return the unit that was held back, if the fault that did so has ended."""
        if self.held is None or any(isinstance(fault, Reorder) for fault in active):
            return []
        held, self.held = self.held, None
        return [held]

    def due(self, now_ns: int) -> list[T]:
        """Take out what has arrived by now."""
        units = []
        while self.late and self.late[0][0] <= now_ns:
            units.append(self.late.popleft()[1])
        return units
