"""Exits and entrances, where people leave and enter the room.

A person leaves by *crossing* an exit: the person is seen in the room, then in the exit, then
leaving it at walking pace through a side that leads out. Positions are those of hips or feet
(``floor``). A person who vanishes earlier has not left: a person who stands in a doorway, has just
come in, turns round, crouches, or touches an exit's edge may return unseen.

If the source states a position error, the person has left only if every position within that error
is behind the side, too.

The sides that lead out are the configured line (``out``) or, by default, every side opposite to
where the person came in, if the exit is wide enough there for a body.
"""

from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.settings import Region
from hri_predict.people.lost.floor import Way, floor_place, floor_way
from hri_predict.people.passage import Crossed, Passage, Side, Visit
from hri_predict.people.settings import Exit, lies_on
from hri_predict.people.track import Track

LATELY_S = 0.2
"""Interval up to the newest capture over which motion is measured; shorter than one footstep."""
PACE_M_S = 0.4
"""Minimum speed of a person who leaves; a slower person may be about to stop."""
OUT_M = 0.1
"""Half of a body's depth, without arms: a person nearer to the side is still in the exit."""
THROUGH_M = 0.3
"""Minimum progress towards the side that leads out: with less, only an edge may have been
passed."""
HALF_M = 0.25
"""Half of a body's width, with arms: a crossing must be where a whole body fits through the
exit."""
UNSEEN_S = 0.3
"""Maximum interval between two captures that show a crossing."""
BEHIND_M, BEHIND_LINE_M = 0.75, 3.0
"""Maximum distance behind a side at which a person counts as outside; larger for a configured
line."""
BACK_M = 0.05
"""A person who has moved inwards by more than this in ``LATELY_S`` is coming back ..."""
RETURNED_M = 0.15
"""... and so is a person who is nearer to the exit by this than at some time since crossing."""
RESUMED_S, RESUMED_M = 1.0, 0.1
"""A person found again on the way out has left after moving this far onwards within this time."""


class Doors:
    """The exits and entrances of a room.

    Args:
        exits: regions where people may leave.
        entrances: regions where people may appear; ``None``: in the exits.
    """

    def __init__(self, exits: Sequence[Region], entrances: Sequence[Region] | None) -> None:
        self._exits = tuple(exits)
        self._sides = tuple(map(_sides, exits))
        self._entrances = self._exits if entrances is None else tuple(entrances)

    def is_entrance(self, point: Floats) -> bool:
        """Return whether people may enter at ``point`` (3,), room frame."""
        return any(region.contains(point) for region in self._entrances)

    def follow(self, track: Track) -> None:
        """Record whether the newest capture of ``track`` leads into an exit, through it or back."""
        passage = track.passage
        place = floor_place(track) if self._exits else None
        if place is None:
            _watch(passage, _place_now(track))  # whose legs are hidden may come back, too
            return
        before, passage.place = passage.place, place
        passage.travelled = track.trail.place
        fresh = track.capture_ns - passage.seen_ns <= UNSEEN_S * 1e9
        passage.seen_ns = track.capture_ns
        door = self._door_at(np.append(place, track.centroid[2]))
        if door is not None:
            self._enter(track, door, place)
        elif passage.crossed is not None:
            _watch(passage, place)
        else:
            visit, passage.visit = passage.visit, None
            if visit is not None and before is not None and fresh:
                passage.crossed = self._crossed(track, visit, before, place)
            passage.in_room = passage.crossed is None

    def has_left(self, track: Track) -> bool:
        """Return whether a person who has vanished had crossed an exit and was not coming back."""
        crossed, place = track.passage.crossed, _place_now(track)
        if crossed is None or place is None:
            return False
        out, out_m = crossed.side.out, crossed.out_m(place)
        if out_m < max(OUT_M + track.error_m, crossed.farthest_m - RETURNED_M):
            return False
        since_s = (track.capture_ns - track.resumed_ns) * 1e-9
        if since_s >= RESUMED_S or track.resumed_ns == track.began_ns:
            way = floor_way(track, LATELY_S)
            velocity = track.trail.velocity() if way is None else way.moved / way.seconds
            return velocity is not None and float(velocity @ out) * LATELY_S >= -BACK_M
        # somebody else may have come in past who left, and got that track
        onward = floor_way(track, since_s)
        return onward is not None and float(onward.moved @ out) >= RESUMED_M

    def _door_at(self, point: Floats) -> int | None:
        return next((i for i, exit_ in enumerate(self._exits) if exit_.contains(point)), None)

    def _enter(self, track: Track, door: int, place: Floats) -> None:
        passage = track.passage
        visit = passage.visit
        if visit is None or visit.door != door:
            came = passage.in_room if visit is None else visit.from_room
            visit = passage.visit = Visit(door, place, came and passage.crossed is None)
        passage.crossed = None
        passage.in_room = visit.from_room
        if visit.from_room and not visit.fits:
            way = floor_way(track, LATELY_S)
            visit.fits = way is not None and self._fits(door, place, way)

    def _fits(self, door: int, place: Floats, way: Way) -> bool:
        """Return whether a body walking at ``place`` is inside the exit with its whole width."""
        if way.speed_m_s < PACE_M_S:
            return False
        aside = HALF_M * np.array([-way.moved[1], way.moved[0]]) / np.hypot(*way.moved)
        exit_ = self._exits[door]
        middle_z = 0.5 * (exit_.z_min + exit_.z_max)
        return all(exit_.contains(np.append(place + a, middle_z)) for a in (aside, -aside))

    def _crossed(self, track: Track, visit: Visit, before: Floats, place: Floats) -> Crossed | None:
        """Return the side through which a body has left the exit that it was in."""
        way = floor_way(track, LATELY_S)
        found = self._out(visit, before, place, track.error_m)
        if way is None or found is None or way.along(found.side.out) < PACE_M_S:
            return None
        return found

    def _out(self, visit: Visit, begin: Floats, end: Floats, error_m: float) -> Crossed | None:
        """Return the crossing if the path from ``begin`` to ``end`` leads right through an exit."""
        if not visit.from_room:
            return None
        for side in self._sides[visit.door]:
            at = side.crossing(begin, end, error_m)
            if at is None:
                continue
            if side.named or (visit.fits and float((at - visit.begin) @ side.out) >= THROUGH_M):
                return Crossed(side, at)
        return None


def _place_now(track: Track) -> Floats | None:
    """Return (2,) where the body stands: where its hips or feet were last seen, and its motion
    since.
    """
    passage = track.passage
    if passage.place is None:
        return None
    place: Floats = passage.place + (track.trail.place - passage.travelled)
    return place


def _watch(passage: Passage, place: Floats | None) -> None:
    """Withdraw a crossing if the body, at ``place`` (2,), has come back in front of the exit."""
    crossed = passage.crossed
    if crossed is None or place is None:
        return
    if crossed.holds(place):
        crossed.farthest_m = max(crossed.farthest_m, crossed.out_m(place))
    else:
        passage.crossed, passage.in_room = None, True


def _sides(exit_: Region) -> tuple[Side, ...]:
    """Return the sides of an exit, or the configured line that leads out."""
    corners = np.asarray(exit_.polygon, dtype=np.float64)
    after = np.roll(corners, -1, axis=0)
    doubled = float(np.sum(corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]))
    line = exit_.out if isinstance(exit_, Exit) else None
    sides = []
    for a, b in zip(corners, after, strict=True):
        edge = b - a
        length = float(np.hypot(*edge))
        if not length:
            continue
        out = np.array([edge[1], -edge[0]]) / length * np.sign(doubled)
        if line is None:
            sides.append(Side(a, b, out, BEHIND_M, named=False))
        elif lies_on(line, a, b):
            ends = sorted(np.asarray(line, dtype=np.float64), key=lambda p: float((p - a) @ edge))
            sides.append(Side(ends[0], ends[1], out, BEHIND_LINE_M, named=True))
    return tuple(sides)
