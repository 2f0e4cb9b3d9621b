"""Rows of the self-check's arrays, one for each person."""

from collections.abc import Callable

import numpy as np

from hri_predict.base.arrays import Floats, Ints, Stamps
from hri_predict.base.geometry import norm
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.snapshot import PeopleSnapshot

RENAMED_M, RENAMED_NS = 0.25, 200_000_000
"""Maximum distance, and time, of a body with a new id from one that has lost its id, to be the
same."""


class Slots:
    """Assigns a slot to each person in view, and keeps it while the person is away for a moment.

    A tracker may give a body a new id from one capture to the next. The body keeps its slot:
    otherwise its zones, if wider than usual, would shrink at once.

    Args:
        count: number of slots.
        keep_ns: time for which a person may be away.
        release: called with the slot and the id of a person whose slot is given up.

    Attributes:
        ids: id of the person in each slot; ``None``: free.
    """

    def __init__(self, count: int, keep_ns: int, release: Callable[[int, int], None]) -> None:
        self.ids: list[int | None] = [None] * count
        self._keep_ns, self._release = keep_ns, release
        self._present_ns: Stamps = np.full(count, NEVER)  # newest tick with this person
        self._places: Floats = np.full((count, 3), np.inf)  # where the person was then

    def known(self, snapshot: PeopleSnapshot) -> Ints:
        """Return (P,) the slot of each person, -1 without one; assigns none."""
        slot_of = {number: slot for slot, number in enumerate(self.ids) if number is not None}
        return np.array([slot_of.get(number, -1) for number in snapshot.ids], np.intp)

    def assigned(self, snapshot: PeopleSnapshot) -> Ints:
        """Return (P,) the slot of each person, -1 where none is free."""
        here = set(snapshot.ids)
        for slot, number in enumerate(self.ids):
            if number is None or number in here:
                continue
            if snapshot.now_ns - int(self._present_ns[slot]) > self._keep_ns:
                self._give_up(slot)
        ever = np.isfinite(snapshot.joint_age_s)[..., None]
        places = np.where(ever, snapshot.last_positions, 0.0).sum(1) / np.maximum(ever.sum(1), 1)
        slots = np.full(len(snapshot.ids), -1, np.intp)
        for person, number in enumerate(snapshot.ids):
            slots[person] = slot = self._slot(number, here, places[person], snapshot.now_ns)
            if slot >= 0:
                self.ids[slot] = number
                self._present_ns[slot] = snapshot.now_ns
                self._places[slot] = places[person]
        return slots

    def _slot(self, number: int, here: set[int], place: Floats, now_ns: int) -> int:
        if number in self.ids:
            return self.ids.index(number)
        away = [s for s, other in enumerate(self.ids) if other is not None and other not in here]
        just = [s for s in away if now_ns - int(self._present_ns[s]) <= RENAMED_NS]
        near_m = norm(self._places[just] - place)
        if just and near_m.min() < RENAMED_M:
            return just[int(near_m.argmin())]
        if None in self.ids:
            return self.ids.index(None)
        if not away:
            return -1
        slot = min(away, key=lambda s: int(self._present_ns[s]))  # away for longest
        self._give_up(slot)
        return slot

    def _give_up(self, slot: int) -> None:
        number = self.ids[slot]
        if number is not None:
            self._release(slot, number)
        self.ids[slot] = None
        self._places[slot] = np.inf
