"""Occlusion: people behind boxes and behind each other, as a tracker reports them.

A joint is seen if a straight line to it from one of the cameras misses every box and every other
body. A tracker loses a person with too few visible joints; when it finds that person again, it may
give another id.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts.scene import Person

SEEN_SHARE = 0.3
"""A tracker follows a person with at least this share of the joints visible."""
FORGETS_S = 0.2
"""Absence after which a tracker treats a person as new."""
_HALF_BODY_M = 0.2
_FIRST_NEW_ID = 1000


class Occlusion:
    """Hides people from cameras, and keeps the id that the tracker gave to each person.

    Args:
        cameras: (C, 3) positions in the source's frame.
        boxes: (B, 5) x and y of two opposite corners on the floor, and the height.
        rename: probability that a person who is found again gets another id.
        rng: generator of the random choices.
    """

    def __init__(
        self,
        cameras: Sequence[Sequence[float]],
        boxes: Sequence[Sequence[float]],
        rename: float,
        rng: np.random.Generator,
    ) -> None:
        self._cameras = np.asarray(cameras, dtype=np.float64)
        corners = np.asarray(boxes, dtype=np.float64).reshape(-1, 5)
        floor = np.zeros((len(corners), 1))
        first = np.concatenate([corners[:, :2], floor], axis=1)
        second = np.concatenate([corners[:, 2:4], corners[:, 4:]], axis=1)
        self._low, self._high = np.minimum(first, second), np.maximum(first, second)
        self._rename, self._rng = rename, rng
        self._ids: dict[int, int] = {}
        self._last_ns: dict[int, int] = {}
        self._next_id = _FIRST_NEW_ID

    def seen(self, people: Sequence[Person], now_ns: int) -> tuple[Person, ...]:
        """Return the people that the tracker reports, with the joints that it sees."""
        bodies = [_box_of(person) for person in people]
        found = []
        for i, person in enumerate(people):
            others = [body for k, body in enumerate(bodies) if k != i and body is not None]
            observed = person.observed & self._visible(person.positions, others)
            if observed.mean() < SEEN_SHARE:
                continue
            positions = np.where(observed[:, None], person.positions, np.nan)
            number = self._id(person.id, now_ns)
            found.append(replace(person, id=number, positions=positions, observed=observed))
        return tuple(found)

    def _visible(self, joints: Floats, others: Sequence[tuple[Floats, Floats]]) -> Bools:
        low = np.concatenate([self._low, *[body[0][None] for body in others]])
        high = np.concatenate([self._high, *[body[1][None] for body in others]])
        visible = np.zeros(len(joints), np.bool_)
        points = np.nan_to_num(joints)
        for camera in self._cameras:
            visible |= ~_crosses(camera, points, low, high).any(1)
        return visible

    def _id(self, number: int, now_ns: int) -> int:
        last_ns = self._last_ns.get(number)
        self._last_ns[number] = now_ns
        is_new = last_ns is not None and now_ns - last_ns > FORGETS_S * 1e9
        if is_new and self._rng.random() < self._rename:
            self._ids[number] = self._next_id
            self._next_id += 1
        return self._ids.get(number, number)


def _box_of(person: Person) -> tuple[Floats, Floats] | None:
    """Return the upright box by which a body hides others; ``None`` if no joint is known."""
    known = person.positions[person.observed]
    if not len(known):
        return None
    middle = known.mean(axis=0)
    low = np.array([*(middle[:2] - _HALF_BODY_M), 0.0])
    return low, np.array([*(middle[:2] + _HALF_BODY_M), known[:, 2].max()])


def _crosses(camera: Floats, points: Floats, low: Floats, high: Floats) -> Bools:
    """Return (J, B) whether the line from the camera to a point passes through a box (slabs)."""
    way = points - camera
    way = np.where(np.abs(way) < 1e-9, 1e-9, way)[:, None]
    first, second = (low - camera) / way, (high - camera) / way
    enters = np.minimum(first, second).max(-1)
    leaves = np.maximum(first, second).min(-1)
    return (enters <= leaves) & (leaves > 0) & (enters < 1 - 1e-6)
