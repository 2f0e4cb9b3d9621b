"""Present and lost people: handles people who appear, change ids, vanish, and are seen again.

A body that appears may be a person who vanished. It continues that person's track only within a
short time (``found_within_s``), at a position consistent with that person's motion, and not where
people enter. Otherwise both exist. The same rule applies to an id that was absent. An id that moves
as its person cannot now belongs to another person. The exception is a source that keeps its ids: an
id that reappears is then always the same person. Two bodies cannot be in one place. So if an id
changes while its body stays in place, it is the same body, anywhere in the room. A track with the
motion of two people is cut in two, and the first person is lost; see ``Trail``.
"""

from collections import Counter
from collections.abc import Callable, Container, Sequence

import numpy as np

from hri_predict.base.arrays import Bools
from hri_predict.people.lost.doors import Doors
from hri_predict.people.lost.lost_people import (
    MOST_STRAYS,
    Lost,
    LostPeople,
    match_places,
    strays_in,
)
from hri_predict.people.ring_buffer import NEVER, PushResult, RingBuffer
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import FOUND_M, Body, MotionLimits, Track

PLACE_SLACK_M = 0.5
"""Maximum deviation of a single capture that counts as noise, unless it happens again soon."""
STRAY_NS = 2_000_000_000
"""Minimum interval between two such deviations by noise; two within this time show a person."""
SAME_PLACE_M = 0.25
"""Minimum distance of another person from the position of a body a moment ago."""
TAKEN_NS = 3_000_000_000
"""Minimum time in which a person can leave a place and hide while another takes the same place."""
TOGETHER_M = 0.4
"""Distance below which two bodies in one scene may be one person reported twice."""

Appearing = tuple[Body, Track | None]
"""An appearing body, and the track of an id that jumped there; ``None``: a new id."""


class Roster:
    """The tracked and the lost people.

    Args:
        settings: see ``PeopleSettings``.
        keeps_ids: whether an id that reappears is the same person.
        lost: the lost people.
        limits: motion limits of a body.
        gap_ns: longest absence of a tracked person.
        history: function that returns an empty ring buffer.

    Attributes:
        tracks: tracks by id.
        lost: the lost people.
        counters: number of bodies by outcome.
    """

    def __init__(
        self,
        *,
        settings: PeopleSettings,
        keeps_ids: bool,
        lost: LostPeople,
        limits: MotionLimits,
        gap_ns: int,
        history: Callable[[], RingBuffer],
    ) -> None:
        self.tracks: dict[int, Track] = {}
        self.lost = lost
        self.counters: Counter[str] = Counter()
        self._settings = settings
        self._keeps_ids = keeps_ids
        self._doors = Doors(settings.exits, settings.entrances)
        self._limits = limits
        self._gap_ns = gap_ns
        self._found_ns = max(round(settings.found_within_s * 1e9), gap_ns)
        self._history = history
        self._unseen_ns: dict[int, int] = {}  # ids of lost people, still in scenes without a joint
        self._looked_ns = NEVER  # the newest capture in which the source saw the room
        self._leavers: list[Track] = []  # left by an exit a moment ago
        self._ended_ns: dict[int, int] = {}  # ids whose person left, was renamed or was found

    def start(self, body: Body, capture_ns: int, now_ns: int) -> Track:
        """Return a new track with ``body`` as its first capture."""
        return Track.start(body, self._history(), capture_ns, now_ns)

    def push(
        self, *, track: Track, body: Body, believed: Bools, capture_ns: int, now_ns: int
    ) -> PushResult:
        """Append a body's accepted joints to its track."""
        result = track.take(body, believed, capture_ns, now_ns)
        if result is PushResult.ACCEPTED:
            self._doors.follow(track)
            if self.tracks.get(track.id) is track and not self._keeps_ids:
                self._part_ways(track, capture_ns)
        return result

    def continues(self, track: Track, body: Body, capture_ns: int) -> bool:
        """Return whether a body can be the person of its id's track, not another who got the id."""
        if self._keeps_ids:
            return True
        absent_ns = max(capture_ns - track.capture_ns, 0)
        if track.rival is not None:  # refused for long enough, any jump would be a possible motion
            absent_ns = min(absent_ns, self._gap_ns)
        astray_m, most_m = track.astray(body, absent_ns * 1e-9, same_id=True)
        return astray_m <= most_m

    def drop_rival(self, track: Track, rival: Track | None) -> None:
        """Mark as lost a person who stood where an id had jumped to before it came back.

        An occasional single capture nearby is noise. A tracked person may have been mistaken for
        the id. If it is unclear whether a person lost near there is this one, both are lost: the
        zone of the first has grown, and an Acknowledge must not end a person who was just seen.
        """
        if rival is None or self._keeps_ids:
            return
        body = rival.body
        apart_m = float(np.linalg.norm(track.step(body)[0]))
        if apart_m < SAME_PLACE_M:  # the same body, with wrong limbs
            return
        stray_ns, track.stray_ns = track.stray_ns, rival.capture_ns
        is_single = rival.captures == 1 and rival.capture_ns - stray_ns > STRAY_NS
        if is_single and apart_m < PLACE_SLACK_M:
            self.counters["strays"] += 1
            return
        others = [t for t in self.tracks.values() if t is not track]
        if any(other.apart(body) < SAME_PLACE_M for other in others):
            return
        near = [p for p in self.lost.people if p.apart(body) < PLACE_SLACK_M]
        found = self._matched([(body, rival)], near, rival.capture_ns, unseen=()).get(0)
        again = [near[found]] if found is not None else []
        again += strays_in([p for p in near if p not in again], track, rival)
        for lost in again:
            self.lost.remove(lost)
        if len(near) > len(again):
            track.strays = (*track.strays[1 - MOST_STRAYS :], rival)
        self.counters["vanished"] += 1
        self.lost.add(rival)

    def _part_ways(self, track: Track, capture_ns: int) -> None:
        """Mark the first person as lost if a track moved from one person to another."""
        slip = track.trail.slip()
        if slip is not None:
            self.counters["slipped"] += 1
            later = self._part(track, slip[1], track.capture_ns)
            later.present_ns, later.rival = track.present_ns, track.rival
            self.tracks[track.id] = later
            self._vanish(self._part(track, NEVER, slip[0]), capture_ns)

    def _part(self, track: Track, begin_ns: int, end_ns: int) -> Track:
        return track.part(begin_ns, end_ns, self._history(), self._doors.follow)

    def begin(
        self,
        starts: Sequence[Appearing],
        capture_ns: int,
        now_ns: int,
        unseen: Container[int] = (),
    ) -> list[int]:
        """Start to track bodies that appear: new ids, and ids that jumped and stayed there.

        Two ids that swapped bodies thus get each other's history.

        Args:
            starts: the appearing bodies.
            capture_ns, now_ns: capture time of the scene, and current time (node's clock).
            unseen: ids in the scene without a visible joint.

        Returns:
            the ids that could not be tracked because the maximum was reached.
        """
        if not starts:
            return []
        starts = sorted(starts, key=lambda start: start[1] is None)  # no new id takes their room
        left = [self.tracks.pop(body.id) for body, risen in starts if risen is not None]
        gone = [t for t in self.tracks.values() if t.present_ns != capture_ns]
        places: list[Track | Lost] = [*left, *gone, *self.lost.people, *self._leavers]
        pairs = self._matched(starts, places, capture_ns, unseen)
        refused, beside = [], []
        for index, (body, risen) in enumerate(starts):
            place = places[pairs[index]] if index in pairs else None
            if sum(t is not place for t in self.tracks.values()) >= self._settings.max_people:
                self.counters["excess_people"] += 1
                refused.append(body.id)
                continue
            if place is not None:
                if place.id != body.id:
                    self.note_end(place.id, capture_ns)
                was_lost = self._forget(place)
                if self._keeps_ids and risen is not None and was_lost and place.id == body.id:
                    # This person is back where the id had jumped from. The jump was a glitch of the
                    # source, and nobody stayed at the place in between.
                    self.counters["glitches_undone"] += 1
                    # A track from before the jump is that of a person whose place it led to.
                    jumped_ns = place.capture_ns
                    left = [t for t in left if t.id != body.id or t.began_ns <= jumped_ns]
                left = [t for t in left if t is not place]
            if self._keeps_ids and risen is None:
                self._find_all(body.id, [places[v] for v in pairs.values()])
            track = place.track if isinstance(place, Lost) else place
            if track is not None and track.rival is not None:
                beside.append((body.id, track.rival))
            self._admit(body=body, risen=risen, track=track, capture_ns=capture_ns, now_ns=now_ns)
        for track in left:
            self._vanish(track, capture_ns)
        for number, rival in beside:  # now that all bodies of this scene are tracked
            self.drop_rival(self.tracks[number], rival)
        return refused

    def still_lost(self, number: int, capture_ns: int) -> bool:
        """Return whether an id without a joint is a lost person, and so in the lost zone.

        If a source does not keep its ids, this holds only while the id stays in the scenes.
        """
        newest_ns = self._newest_of_lost(number)
        if newest_ns is None:
            return False
        if self._keeps_ids:
            return True
        in_scene_ns = max(newest_ns, self._unseen_ns.get(number, newest_ns))
        if capture_ns - in_scene_ns > self._found_ns:
            return False
        lost = {each.id for each in self.lost.people}
        self._unseen_ns = {n: ns for n, ns in self._unseen_ns.items() if n in lost}
        self._unseen_ns[number] = capture_ns
        return True

    def still_ended(self, number: int, capture_ns: int) -> bool:
        """Return whether an id without a joint is a person who left, was renamed or was found."""
        if not self._is_recent(self._ended_ns.get(number), capture_ns):
            return False
        self._ended_ns[number] = capture_ns
        return True

    def ended_lately(self, number: int, capture_ns: int) -> bool:
        """Return whether a late scene may show a person with this id who is lost, gone or
        renamed."""
        stamps = (self._newest_of_lost(number), self._ended_ns.get(number))
        return any(self._is_recent(stamp, capture_ns) for stamp in stamps)

    def _is_recent(self, stamp_ns: int | None, capture_ns: int) -> bool:
        return stamp_ns is not None and capture_ns - stamp_ns <= self._found_ns

    def note_end(self, number: int, capture_ns: int) -> None:
        """Record an id of a person who left, was renamed or was found."""
        kept = {n: ns for n, ns in self._ended_ns.items() if self._is_recent(ns, capture_ns)}
        self._ended_ns = kept | {number: capture_ns}

    def _newest_of_lost(self, number: int) -> int | None:
        return max((p.capture_ns for p in self.lost.people if p.id == number), default=None)

    def expire(self, capture_ns: int) -> None:
        """End the tracks of people absent for too long: they left through an exit, or vanished.

        Args:
            capture_ns: capture time of a scene in which the source saw the room.
        """
        self._looked_ns = capture_ns
        self._leavers = [t for t in self._leavers if self._is_recent(t.capture_ns, capture_ns)]
        for track in list(self.tracks.values()):
            if capture_ns - track.present_ns > self._gap_ns:
                del self.tracks[track.id]
                self._vanish(track, capture_ns)

    def part(self, body: Body, capture_ns: int) -> None:
        """End the track of an id that reappears after an absence: it may now be another person.

        Call this before the body is added to a track. That person may be found again. If there was
        no capture meanwhile, a body still in the same place is the same person for a few seconds.
        The time in which a source is frozen is such an absence, too.
        """
        track = self.tracks.get(body.id)
        if track is None or self._keeps_ids:
            return
        # Bit-identical captures show nobody: the person was last seen before them.
        thawed = track.repeats > 0 and not track.has_shown(body)
        absent_ns = capture_ns - (track.capture_ns if thawed else track.present_ns)
        if absent_ns <= self._gap_ns + self._limits.period_ns:  # after a gap that is still bridged
            return
        unseen = track.present_ns >= self._looked_ns and absent_ns <= TAKEN_NS
        if not (unseen and track.apart(body) <= SAME_PLACE_M):
            del self.tracks[body.id]
            self._vanish(track, capture_ns)

    def _matched(
        self,
        starts: Sequence[Appearing],
        places: Sequence[Track | Lost],
        capture_ns: int,
        unseen: Container[int],
    ) -> dict[int, int]:
        """Return index of start -> index of the place where that person was last seen."""
        fits = np.array(
            [[self._fit(body, risen, p, capture_ns) for p in places] for body, risen in starts]
        ).reshape(len(starts), len(places), 2)
        apart, radii = fits[..., 0], fits[..., 1].copy()
        for v, place in enumerate(places):
            if place.id in unseen:  # who is still reported without a joint is somewhere
                seconds = max(capture_ns - place.capture_ns, 0) * 1e-9
                near_m = SAME_PLACE_M + self._settings.lost_speed_m_s * seconds
                radii[:, v] = np.minimum(radii[:, v], near_m)
        pairs = match_places(apart, radii)
        for first in sorted(pairs, key=lambda s: float(apart[s, pairs[s]])):
            for other in [s for s in pairs if s != first and first in pairs]:
                between = starts[first][0].centroid - starts[other][0].centroid
                if float(np.linalg.norm(between)) < TOGETHER_M:
                    del pairs[other]
        return pairs

    def _find_all(self, number: int, others: Sequence[Track | Lost]) -> None:
        """Remove the lost entries of an id that is tracked again, except places of others."""
        for lost in [each for each in self.lost.people if each.id == number]:
            if not any(lost is other for other in others):
                self._forget(lost)

    def _fit(
        self, body: Body, risen: Track | None, place: Track | Lost, capture_ns: int
    ) -> tuple[float, float]:
        """Return the distance (m) of ``body`` from where the person seen at ``place`` may be,
        and the maximum distance; -1: it is not that person.
        """
        # An id that jumped has been where it is since its first capture there.
        since_ns = (capture_ns if risen is None else risen.began_ns) - place.capture_ns
        seconds = max(since_ns, 0) * 1e-9
        is_lost = isinstance(place, Lost)
        if self._keeps_ids and body.id == place.id:
            speed = place.speed_m_s if isinstance(place, Lost) else self.lost.speed_of(place)
            fastest = self._settings.max_body_speed_m_s if risen is None else speed
            return place.apart(body), PLACE_SLACK_M + fastest * seconds
        track = place.track if isinstance(place, Lost) else place
        # two bodies that were, or could have been, seen at the same time are two people
        if track is None or not 0 < since_ns <= self._found_ns:
            return 0.0, -1.0
        astray_m, most_m = track.astray(
            body,
            seconds,
            same_id=risen is not None and not is_lost and body.id == place.id,
            since=None if risen is None else risen.trail,
        )
        if self._doors.is_entrance(body.centroid):
            most_m = -1.0 if is_lost else min(most_m, SAME_PLACE_M)
        return astray_m, most_m

    def _forget(self, place: Track | Lost) -> bool:
        """Remove ``place``, as its body was found; return whether that body was already lost."""
        if isinstance(place, Lost):
            self.lost.remove(place)
            self.counters["found"] += 1
            return True
        if self.tracks.get(place.id) is place:
            del self.tracks[place.id]
        self._leavers = [t for t in self._leavers if t is not place]
        return False

    def _admit(
        self, *, body: Body, risen: Track | None, track: Track | None, capture_ns: int, now_ns: int
    ) -> None:
        """Start to track an appearing body, with the history of ``track`` if plausible."""
        believed = track.believable(body, capture_ns, self._limits) if track else None
        if track is not None and believed is not None:
            self.counters["inherited"] += 1
            track.resumed_ns = capture_ns
            seconds = max(capture_ns - track.capture_ns, 0) * 1e-9
            astray_m, _ = track.astray(body, seconds, same_id=False)
            track.trail.find(capture_ns, astray_m <= track.trail.slack_m(FOUND_M))
            self.push(
                track=track, body=body, believed=believed, capture_ns=capture_ns, now_ns=now_ns
            )
            self.tracks[body.id] = track
        elif risen is not None:
            self.counters["reaccepted"] += 1
            self.tracks[body.id] = risen
        else:
            self.counters["appeared"] += 1
            self.tracks[body.id] = self.start(body, capture_ns, now_ns)

    def _vanish(self, track: Track, capture_ns: int) -> None:
        doubted_ns = None if self._keeps_ids else track.trail.doubted_ns()
        if doubted_ns is not None:  # who was found may have been somebody else
            first = self._part(track, NEVER, doubted_ns)
            if not self._doors.has_left(first):
                self.lost.add(first)
        rival, track.rival = track.rival, None
        if self._doors.has_left(track):
            self.counters["left_by_exit"] += 1
            self.note_end(track.id, capture_ns)
            self._leavers.append(track)
            if rival is not None and self.lost.is_stride_of(track, rival):
                return
        else:
            self.counters["vanished"] += 1
            self.lost.add(track)
        if rival is not None:
            self.counters["vanished"] += 1
            self.lost.add(rival)
