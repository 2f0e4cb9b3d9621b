"""A tracker that has lost a person and continues to send one."""

from collections import deque
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Floats
from hri_predict.base.settings import Vector3
from hri_predict.contracts.scene import Person, Scene
from hri_sim.faults.settings import FaultSettings

MOST_CAPTURES = 60


class MadeUp(FaultSettings):
    """The tracker has lost all people and continues to send them, with fresh noise.

    ``how`` is ``hold``: repeat the last skeleton; ``coast``: move it on at ``velocity``; or
    ``loop``: repeat the last ``captures`` captures.
    """

    soak = ("how=hold", "how=coast", "how=loop,captures=12")
    deceives = True

    how: Literal["hold", "coast", "loop"] = Field(
        "hold", description="content that is sent instead"
    )
    captures: int = Field(12, ge=2, le=MOST_CAPTURES, description="length of the loop")
    velocity: Vector3 = Field([0.0, 1.4, 0.0], description="velocity of all people who coast, m/s")
    noise_m: float = Field(0.004, ge=0, le=0.1, description="fresh noise, in each axis")


class MadeUpPeople:
    """Holds, moves on or repeats the people that a source reported last.

    Args:
        fault: its settings.
        rng: generator of the noise.
    """

    def __init__(self, fault: MadeUp, rng: np.random.Generator) -> None:
        self._fault, self._rng = fault, rng
        self._seen: deque[Scene] = deque(maxlen=fault.captures if fault.how == "loop" else 1)
        self._next = 0

    def see(self, scene: Scene) -> None:
        """Record a true scene."""
        self._seen.append(scene)
        self._next = 0

    def made_up(self, scene: Scene) -> Scene:
        """Return ``scene`` with the people made up by the tracker."""
        if not self._seen:
            return scene
        shown = self._seen[self._next % len(self._seen)]
        self._next += 1
        seconds = (scene.stamp_ns - shown.stamp_ns) * 1e-9 if self._fault.how == "coast" else 0.0
        moved = np.asarray(self._fault.velocity) * seconds
        return replace(scene, people=tuple(self._moved(p, moved) for p in shown.people))

    def _moved(self, person: Person, by: Floats) -> Person:
        noise = self._rng.normal(0.0, self._fault.noise_m, person.positions.shape)
        return replace(person, positions=person.positions + by + noise)
