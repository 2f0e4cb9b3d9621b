"""Lost people: people who vanished, but not through an exit.

A missing skeleton does not prove that a place is empty. So a lost person stays lost, with a zone
that grows at the last measured speed (in the risk stage). Scenes without that person do not change
this. A person stops being lost only by

- being seen again: see ``Roster``;
- ``acknowledge``, some time after the person was last seen, if ``to_acknowledge`` counted that
  person;
- exclusion of every possible place, if the source sees free space, and a body was seen again where
  the person was last seen: see ``free_space``.

Time alone never ends a loss.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.people.lost.floor import floor_place
from hri_predict.people.lost.free_space import FreeSpace, Whereabouts
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.snapshot import LostPerson
from hri_predict.people.track import Body, Track

SPEED_SPAN_S, LIMB_SPAN_S = 0.4, 0.2
"""Time over which the last speed is measured: a third of a step, and four captures at 10 Hz."""
STRIDE_M = 0.75
"""Maximum displacement at which a single detached capture still shows the same person."""
GAIN, GAIN_M_S = 1.25, 0.4
"""Margin on the measured speed of a lost person: a runner gains 4 m/s2 for a moment."""


@dataclass(slots=True, eq=False, kw_only=True)
class Lost:
    """One lost person.

    Attributes:
        id: id of the body when last seen.
        positions: (J, 3) last seen position of each joint; NaN if never seen.
        joint_age_s: (J,) seconds from a joint's last observation to ``capture_ns``; inf if never
            seen.
        capture_ns: capture in which the person was last seen.
        speed_m_s: maximum speed of the body.
        limbs_m_s: (J,) speed of each joint in excess of the body's.
        error_m: possible common position error of all joints.
        track: track that a newly seen body may continue; ``None`` after a restart.
        whereabouts: possible places of the person; ``None``: the source does not see free space.
    """

    id: int
    positions: Floats
    joint_age_s: Floats
    capture_ns: int
    speed_m_s: float
    limbs_m_s: Floats
    error_m: float = 0.0
    track: Track | None = None
    whereabouts: Whereabouts | None = None

    @property
    def centroid(self) -> Floats:
        """(3,) mean of the last seen joints."""
        newest = self.joint_age_s <= self.joint_age_s.min()
        centroid: Floats = self.positions[newest].mean(axis=0)
        return centroid

    def apart(self, body: Body) -> float:
        """Return the distance (m) of ``body`` from the last seen position; see ``Track.apart``."""
        if self.track is not None:
            return self.track.apart(body)
        return float(np.linalg.norm((body.centroid - self.centroid)[:2]))


MOST_STRAYS = 8
"""Number of strays of a track that are remembered: an id may jump to several places in turn."""


def strays_in(near: Sequence[Lost], track: Track, rival: Track) -> list[Lost]:
    """Return those of ``near`` who are strays of ``track``, now seen again as ``rival``.

    A stray of several captures may be a person apart from the one who was lost there first. So it
    is replaced only while that person is lost, too.
    """
    seen = [(lost, lost.track) for lost in near if lost.track is not None]
    strays = [
        (lost, own)
        for lost, own in seen
        if any(own is stray for stray in track.strays)
        or (lost.id == rival.id and own.captures == 1)
    ]
    first_ns = min((p.capture_ns for p in near if all(p is not s for s, _ in strays)), default=None)
    return [
        lost
        for lost, own in strays
        if own.captures == 1 or (first_ns is not None and first_ns <= lost.capture_ns)
    ]


class LostPeople:
    """People who vanished, with unknown whereabouts.

    Args:
        settings: see ``PeopleSettings``.
        space: space seen free by the source; ``None``: the source does not see free space.

    Attributes:
        people: the lost people.
        forgotten: whether more people were lost than are kept, or it is unknown who was lost: a
            person may be anywhere until an acknowledgement.
        distrusted: whether it is unknown who was lost, because the state file cannot be trusted.
    """

    def __init__(self, settings: PeopleSettings, space: FreeSpace | None) -> None:
        self.people: list[Lost] = []
        self._settings = settings
        self._space = space
        self._most = settings.max_people
        self._settled_ns = round(settings.acknowledge_after_s * 1e9)
        self.forgotten = self.distrusted = False
        self._dropped_ns: int | None = None  # when the last dropped person was last seen
        self._asked: frozenset[Lost | None] = frozenset()  # whom an acknowledgement may end
        self._sets = 0

    def add(self, track: Track) -> None:
        """Add a lost person. Beyond ``max_people``, the oldest is dropped and may be anywhere."""
        ever = np.isfinite(track.positions).all(-1)
        age_s = np.where(ever, (track.capture_ns - np.where(ever, track.stamps, 0)) * 1e-9, np.inf)
        # over the longer span, a hand that went back and forth has not moved
        spans = (SPEED_SPAN_S, LIMB_SPAN_S)
        limbs_m_s = np.maximum(*(track.speeds(span_s)[1] for span_s in spans))
        self.keep(
            Lost(
                id=track.id,
                positions=track.positions.copy(),
                joint_age_s=age_s,
                capture_ns=track.capture_ns,
                speed_m_s=self.onward_speed_of(track),
                limbs_m_s=limbs_m_s,
                error_m=track.error_m,
                track=track,
            )
        )

    def speed_of(self, track: Track) -> float:
        """Return the maximum speed of a body that is no longer seen, m/s.

        This is the last measured speed plus a margin, and at least the standard's speed. If no
        speed was measured, it is the maximum speed of a body.
        """
        measured, _ = track.speeds(SPEED_SPAN_S)
        if measured is None:
            return self._settings.max_body_speed_m_s
        return max(self._settings.lost_speed_m_s, GAIN * measured + GAIN_M_S)

    def onward_speed_of(self, track: Track) -> float:
        """Return the maximum speed of a lost body: ``speed_of``, or more if it was accelerating."""
        most = self._settings.max_body_speed_m_s
        return max(self.speed_of(track), min(speed_reached(track), most))

    def found_speed_of(self, track: Track) -> float:
        """Return the maximum speed of a body that is found elsewhere, m/s.

        As ``speed_of``, but the standard's speed if no speed was measured: a person seen only
        briefly is not found again at the other end of the room.
        """
        measured, _ = track.speeds(SPEED_SPAN_S)
        return self._settings.lost_speed_m_s if measured is None else self.speed_of(track)

    def is_stride_of(self, leaver: Track, rival: Track) -> bool:
        """Return whether a rival is only one detached capture of a person who was leaving."""
        seconds = max(rival.capture_ns - leaver.capture_ns, 0) * 1e-9
        reach_m = STRIDE_M + self.found_speed_of(leaver) * seconds
        apart_m = float(np.linalg.norm((rival.centroid - leaver.centroid)[:2]))
        return rival.captures == 1 and apart_m <= reach_m

    def remove(self, lost: Lost) -> None:
        """Remove a person who is seen again."""
        self.people.remove(lost)

    def see(
        self,
        capture_ns: int,
        seen: Sequence[Floats],
        is_whole: bool,
        standing: Sequence[Floats] = (),
    ) -> int:
        """Add a scene from a source that sees free space.

        Args:
            capture_ns: capture time of the scene.
            seen: (3,) positions of the bodies in the scene.
            is_whole: whether the source saw the room and every body was located.
            standing: (2,) floor positions of the bodies seen down to their feet.

        Returns:
            the number of lost people who are now proven to be gone.
        """
        if self._space is None or not self.people:
            return 0
        free = self._space.free(seen) if is_whole else None
        before = len(self.people)
        for lost in self.people:
            if lost.whereabouts is not None:
                lost.whereabouts.update(capture_ns, free, standing)
        self.people = [
            lost for lost in self.people if lost.whereabouts is None or lost.whereabouts.anywhere
        ]
        return before - len(self.people)

    def snapshot(self) -> tuple[LostPerson, ...]:
        """Return all lost people, for the risk stage."""
        return tuple(
            LostPerson(
                id=lost.id,
                positions=lost.positions,
                last_seen_ns=lost.capture_ns,
                joint_age_s=lost.joint_age_s,
                speed_m_s=lost.speed_m_s,
                limbs_m_s=lost.limbs_m_s,
                error_m=lost.error_m,
                places=None if lost.whereabouts is None else lost.whereabouts.places(),
                places_ns=None if lost.whereabouts is None else lost.whereabouts.capture_ns,
                floor_m=self._settings.floor_m,
                platform_m=self._settings.platform_m,
            )
            for lost in self.people
        )

    def to_acknowledge(self, now_ns: int) -> int:
        """Return the number of the set of lost people that an acknowledgement can clear now; 0 if
        none.

        People seen too recently are not included, because the operator may not mean them. A set
        that gains a person gets the next number, because the operator may not know of that person.
        """
        settled_ns = now_ns - self._settled_ns
        asked: set[Lost | None] = {p for p in self.people if p.capture_ns < settled_ns}
        if self.forgotten and (self._dropped_ns is None or self._dropped_ns < settled_ns):
            asked.add(None)
        self._sets += not asked <= self._asked
        self._asked = frozenset(asked)
        return self._sets if asked else 0

    def acknowledge(self) -> int:
        """Remove the people last counted by ``to_acknowledge``; return their number.

        Call this when an operator confirms that these people are gone.
        """
        before, asked = len(self.people), self._asked
        self.people = [p for p in self.people if p not in asked]
        forgets = None in asked and self.forgotten
        if forgets:
            self.forgotten = self.distrusted = False
            self._dropped_ns = None
        self._asked = frozenset()
        return before - len(self.people) + forgets

    def keep(self, lost: Lost) -> None:
        """Add a lost person; see ``add``."""
        if self._space is not None and lost.track is not None and lost.error_m == 0:
            on_floor = floor_place(lost.track)
            place = lost.centroid if on_floor is None else on_floor
            lost.whereabouts = self._space.start(place, lost.capture_ns, lost.speed_m_s)
        self.people.append(lost)
        if len(self.people) > self._most:
            oldest = min(self.people, key=lambda p: p.capture_ns)
            self.people.remove(oldest)
            self.lose_places([oldest.capture_ns])

    def lose_places(self, last_seen_ns: Sequence[int]) -> None:
        """Record people last seen at these times, at unknown places."""
        for capture_ns in last_seen_ns:
            self.forgotten = True
            self._dropped_ns = max(self._dropped_ns or capture_ns, capture_ns)
            self._asked -= {None}


def match_places(distance: Floats, radii: Floats) -> dict[int, int]:
    """Pair each start with the nearest place with a zone that contains it, using each place once.

    Args:
        distance: (S, V) metres between S appearing bodies and V places where bodies vanished.
        radii: (S, V) metres; negative where the pair is impossible.

    Returns:
        index of start -> index of place.
    """
    distance = np.where(distance > radii, np.inf, distance)
    pairs: dict[int, int] = {}
    while distance.size and np.isfinite(distance).any():
        start, place = np.unravel_index(int(distance.argmin()), distance.shape)
        pairs[int(start)] = int(place)
        distance[start, :] = np.inf
        distance[:, place] = np.inf
    return pairs


APART_S, START_APART_S = 0.1, 0.06
"""Minimum time between two captures for a speed: 2 mm of noise of the joints' mean are 0.03 m/s in
0.1 s. For a body that was at rest, a shorter time is enough."""
WITHIN_S = 0.6
"""Maximum age of captures used for the newest speed. At 5 Hz three captures take 0.4 s."""
SPEEDING_M_S2 = 2.2
"""Usual maximum acceleration of a walker's trunk, within a step or when starting."""
AT_REST_M_S = 0.2
"""Speed below which a person is at rest. If the next speed is higher, motion started at an unknown
time within the newest interval, and the true acceleration may be twice its mean."""
GOES_ON_S = 1.0
"""Time for which a runner may keep the measured acceleration: 6.4 m/s2, the highest measured for
sprinters at the start, lead to 8 m/s in 1.25 s. A zone that grows at the speed reached then stays
ahead of a body that accelerates evenly for twice as long."""


def speeding(track: Track) -> tuple[float, float] | None:
    """Return the newest speed of a body, m/s, and its acceleration, m/s2.

    Both are measured from three captures, with the joints seen in all three. ``None``: no such
    captures.
    """
    starting = _measured(track, START_APART_S)
    if starting is not None and starting[1] < AT_REST_M_S:
        newer, older, seconds = starting
        return newer, 2.0 * (newer - older) / seconds
    going = _measured(track, APART_S)
    if going is None:
        return None
    newer, older, seconds = going
    gain_m_s2 = (newer - older) / seconds
    return newer + max(gain_m_s2, 0.0) * seconds / 2, gain_m_s2


def _measured(track: Track, apart_s: float) -> tuple[float, float, float] | None:
    """Return the newest speed, the previous speed, and the seconds between their midpoints."""
    stamps, positions, observed = track.history.samples()
    apart_ns, anchors = round(apart_s * 1e9), [len(stamps) - 1]
    recent = track.capture_ns - round(WITHIN_S * 1e9)
    for index in range(len(stamps) - 2, -1, -1):
        if stamps[index] < recent or len(anchors) == 3:
            break
        if stamps[anchors[-1]] - stamps[index] >= apart_ns:
            anchors.append(index)
    common = observed[anchors].all(0)
    if len(anchors) < 3 or not common.any():
        return None
    places = positions[anchors][:, common].mean(1)
    seconds = -np.diff(stamps[anchors]) * 1e-9
    newer, older = np.linalg.norm(np.diff(places, axis=0), axis=1) / seconds
    return float(newer), float(older), float(seconds.mean())


def speed_reached(track: Track) -> float:
    """Return the speed (m/s) that an accelerating body may reach; 0 for any other body."""
    found = speeding(track)
    if found is None or found[1] < SPEEDING_M_S2:
        return 0.0
    speed, gain_m_s2 = found
    return speed + gain_m_s2 * GOES_ON_S
