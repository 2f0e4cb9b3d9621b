"""Assigns the bodies of several sensors to people, and gives each person an id.

In doubt, two bodies are two people, so that no person is missed:

- A body that appears becomes part of a person only if it is within ``same_m`` of all bodies of that
  person, and no other body of either sensor is a candidate. So each body has at most one candidate
  per sensor, and no global assignment is needed.
- It stays part of that person within ``apart_m``. Beyond this distance it is a separate person in
  that same capture, as is a body that fits another person clearly better.
- Two people who prove to be one are joined after ``JOIN_S`` without contradiction; the scene names
  the id that is gone (``Scene.joined``).

A sensor's id that reappears at its former person's place is assigned to that person. Whether it
still is the same person is decided by ``Roster``, as with a single sensor.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.people.merging.likeness import Likeness, Seen
from hri_predict.people.track import Body

MAX_ID = 65535
REMEMBERED = 4096
"""Maximum number of sensor ids kept; the least recently seen are dropped first."""
JOIN_S, JOIN_TIMES = 0.5, 10
NEARER_M = 0.05
"""Difference by which a body must fit another person better to leave its own."""


@dataclass(slots=True, eq=False)
class OnePerson:
    """One person, as seen by several sensors.

    Attributes:
        id: the merged id.
        seen: the current bodies of this person, by sensor.
        began_ns: time at which the id was first assigned.
        lead: the sensor with priority for joints; ``None``: not yet chosen.
        place: (3,) centre of the joints last merged; ``None`` before the first merge.
    """

    id: int
    began_ns: int
    seen: dict[int, Seen] = field(default_factory=dict)
    lead: int | None = None
    place: Floats | None = None


class Identities:
    """The people of a merged source. One thread only.

    Args:
        same_m, apart_m: see ``MergedSettings``.

    Attributes:
        counters: number of bodies by outcome.
    """

    def __init__(self, same_m: float, apart_m: float) -> None:
        self.counters: Counter[str] = Counter()
        self._same_m, self._apart_m = same_m, apart_m
        self._ids: dict[Seen, int] = {}
        self._people: dict[int, OnePerson] = {}
        self._agreeing: dict[tuple[int, int], tuple[int, int]] = {}  # since when, how often
        self._last_id = 0
        self._present: list[OnePerson] = []

    def step(
        self, bodies: Mapping[Seen, Body], time_ns: int
    ) -> tuple[list[OnePerson], tuple[tuple[int, int], ...]]:
        """Return the people at one time, and the pairs of ids (gone, kept) that are one person.

        Args:
            bodies: bodies of all sensors at that time; earlier bodies get lower ids.
            time_ns: rises from call to call.
        """
        likeness = Likeness(bodies, self._same_m, self._apart_m)
        people, free = self._remembered(bodies)
        for person in people.values():
            free += self._contradicting(person, people.values(), likeness)
        for seen in sorted(free, key=lambda s: s.sensor):
            fitting = self._fitting(seen, people.values(), likeness)
            person = fitting or self._person(self._new_id(), time_ns)
            people[person.id] = person
            self._add(person, seen)
        joined = self._joined(people, likeness, time_ns)
        self._forget()
        self._present = [person for person in people.values() if person.seen]
        return self._present, joined

    def _remembered(self, bodies: Mapping[Seen, Body]) -> tuple[dict[int, OnePerson], list[Seen]]:
        """Return the people with bodies known by their sensor ids, and the unknown bodies."""
        for person in self._present:
            person.seen.clear()
        people: dict[int, OnePerson] = {}
        free: list[Seen] = []
        for seen in bodies:
            number = self._ids.pop(seen, None)
            known = None if number is None else self._people.get(number)
            if known is None or seen.sensor in known.seen:
                free.append(seen)
            else:
                people[known.id] = known
                self._add(known, seen)
        return people, free

    def _contradicting(
        self, person: OnePerson, people: Iterable[OnePerson], likeness: Likeness
    ) -> list[Seen]:
        """Remove from a person the bodies that do not fit, and return them."""
        if len(person.seen) < 2:
            return []
        kept = min(person.seen.values(), key=lambda s: self._astray_m(person, likeness.bodies[s]))
        others = [s for p in people if p is not person for s in p.seen.values()]
        gone = []
        for seen in list(person.seen.values()):
            if seen is kept:
                continue
            own_m = likeness.apart_m(seen, kept)
            fits = likeness.still_same(seen, kept) and not any(
                _is_nearer(likeness.apart_m(seen, other), own_m)
                for other in others
                if other.sensor != seen.sensor
            )
            if not fits:
                self.counters["people_split"] += 1
                del person.seen[seen.sensor], self._ids[seen]
                gone.append(seen)
        return gone

    def _astray_m(self, person: OnePerson, body: Body) -> tuple[bool, float]:
        """Return a sort key: distance from the person's last place; without joints, last."""
        if not body.observed.any():
            return True, 0.0
        if person.place is None:
            return False, 0.0
        return False, float(np.linalg.norm(body.centroid - person.place))

    def _fitting(
        self, seen: Seen, people: Iterable[OnePerson], likeness: Likeness
    ) -> OnePerson | None:
        """Return the person that a body can belong to; ``None`` if in doubt: it is a new person."""
        fitting = [p for p in people if self._is_one(p, [seen], likeness)]
        return min(fitting, key=lambda p: _nearest_m(seen, p, likeness), default=None)

    def _is_one(
        self,
        person: OnePerson,
        more: Sequence[Seen],
        likeness: Likeness,
    ) -> bool:
        """Return whether bodies of other sensors belong to this person, with no other candidate."""
        own = list(person.seen.values())
        for seen in more:
            if seen.sensor in person.seen:
                return False
            if not any(likeness.is_same(seen, each) for each in own):
                return False
            if not all(likeness.still_same(seen, each) for each in own):
                return False
        both = [*own, *more]
        sensors = {s.sensor for s in both}
        return not any(
            other.sensor in sensors and other not in both
            for each in both
            for other in likeness.that_may_be(each)
        )

    def _joined(
        self, people: dict[int, OnePerson], likeness: Likeness, time_ns: int
    ) -> tuple[tuple[int, int], ...]:
        """Join people who have fitted as one for long enough."""
        agreeing: dict[tuple[int, int], tuple[int, int]] = {}
        joined: list[tuple[int, int]] = []
        for one, other in combinations(sorted(people.values(), key=lambda p: p.began_ns), 2):
            if not (one.seen and other.seen):
                continue
            if not self._is_one(one, list(other.seen.values()), likeness):
                continue
            pair = (other.id, one.id)
            since_ns, times = self._agreeing.get(pair, (time_ns, 0))
            agreeing[pair] = since_ns, times + 1
            if times + 1 >= JOIN_TIMES and time_ns - since_ns >= JOIN_S * 1e9:
                self.counters["people_joined"] += 1
                joined.append(pair)
                for seen in list(other.seen.values()):
                    self._add(one, seen)
                other.seen.clear()
        self._agreeing = agreeing
        return tuple(joined)

    def _add(self, person: OnePerson, seen: Seen) -> None:
        person.seen[seen.sensor] = seen
        self._ids.pop(seen, None)  # the newest comes last
        self._ids[seen] = person.id

    def _person(self, number: int, time_ns: int) -> OnePerson:
        person = self._people[number] = OnePerson(number, time_ns)
        return person

    def _new_id(self) -> int:
        used = self._people
        while True:
            self._last_id = self._last_id % MAX_ID + 1
            if self._last_id not in used:
                return self._last_id

    def _forget(self) -> None:
        """Drop the oldest ids, and people without ids."""
        while len(self._ids) > REMEMBERED:
            self._ids.pop(next(iter(self._ids)))
        if len(self._people) > REMEMBERED:
            left = set(self._ids.values())
            self._people = {n: p for n, p in self._people.items() if n in left}


def _is_nearer(other_m: float | None, own_m: float | None) -> bool:
    return other_m is not None and own_m is not None and other_m < own_m - NEARER_M


def _nearest_m(seen: Seen, person: OnePerson, likeness: Likeness) -> float:
    found = (likeness.apart_m(seen, each) for each in person.seen.values())
    return min((apart_m for apart_m in found if apart_m is not None), default=np.inf)
