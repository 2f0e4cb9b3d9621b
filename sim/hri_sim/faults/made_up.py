"""A tracker that lost a person and goes on sending one."""

from collections import deque
from dataclasses import replace

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.scene import Person, Scene

MOST_CAPTURES = 60


class MadeUpPeople:
    """Holds, carries on or repeats the people whom a source showed last.

    Args:
        how: ``hold``, ``coast`` or ``loop``.
        captures: length of the loop.
        velocity: (3,) m/s, by which everybody moves on.
        noise_m: standard deviation per axis of fresh noise.
        rng: of the noise.
    """

    def __init__(
        self, how: str, captures: int, velocity: Floats, noise_m: float, rng: np.random.Generator
    ) -> None:
        self._how, self._noise_m, self._rng = how, noise_m, rng
        self._velocity = np.asarray(velocity, np.float64)
        self._seen: deque[Scene] = deque(maxlen=captures if how == "loop" else 1)
        self._next = 0

    def see(self, scene: Scene) -> None:
        """Take in a true scene."""
        self._seen.append(scene)
        self._next = 0

    def made_up(self, scene: Scene) -> Scene:
        """Return ``scene`` with the people whom the tracker makes up."""
        if not self._seen:
            return scene
        shown = self._seen[self._next % len(self._seen)]
        self._next += 1
        seconds = (scene.stamp_ns - shown.stamp_ns) * 1e-9 if self._how == "coast" else 0.0
        moved = self._velocity * seconds
        return replace(scene, people=tuple(self._moved(p, moved) for p in shown.people))

    def _moved(self, person: Person, by: Floats) -> Person:
        noise = self._rng.normal(0.0, self._noise_m, person.positions.shape)
        return replace(person, positions=person.positions + by + noise)
