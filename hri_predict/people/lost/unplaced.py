"""People who are in scenes without being tracked: it is not known where they are, or were.

A person may show no joint, be one too many, share the id of another, or appear only in scenes that
do not advance. While such a person is in scenes, the input has a fault. When the person is in them
no more, and was never tracked, it is unknown where they went: a person may be anywhere in the room,
until an acknowledgement. A phantom of a few captures, without any place, leaves nothing behind.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, unique

from hri_predict.people.track import Track
from hri_predict.protocol.reasons import Reason

MOST = 500
"""Maximum number of ids at once; with more, they are not people, and a person may be anywhere."""


@unique
class Why(Enum):
    """Why a person is not tracked, and the fault that this is.

    Attributes:
        reason: the fault.
        ends_if_tracked: whether it ends when the id is tracked: then that is this person.
        certain: whether one capture shows that a person is there.
    """

    NO_JOINT = (Reason.PERSON_NOT_LOCATED, True, False)
    ONE_TOO_MANY = (Reason.TOO_MANY_PEOPLE, True, True)
    SECOND_BODY = (Reason.INPUT_IMPOSSIBLE, False, True)
    REFUSED_SCENE = (Reason.INPUT_IMPOSSIBLE, True, False)
    """In scenes that did not advance, and in no other."""
    REFUSED_ELSEWHERE = (Reason.INPUT_IMPOSSIBLE, False, False)
    """The id is tracked, but such scenes show it far from there."""

    def __init__(self, reason: Reason, ends_if_tracked: bool, certain: bool) -> None:
        self.reason, self.ends_if_tracked, self.certain = reason, ends_if_tracked, certain


@dataclass(slots=True)
class _Presence:
    first_ns: int
    newest_ns: int


@dataclass(slots=True)
class _Run:
    """Successive captures with a person for one reason: ids may change meanwhile."""

    newest_ns: int
    captures: int = 1


class Unplaced:
    """People who are present without being tracked.

    Args:
        gap_ns: absence for longer than this is an absence.
        captures: number of captures that show a person's presence, where one does not.
        keeps_ids: an id is the same person at any time.
    """

    def __init__(self, gap_ns: int, captures: int, keeps_ids: bool) -> None:
        self._gap_ns = gap_ns
        self._captures = captures
        self._keeps_ids = keeps_ids
        self._present: dict[tuple[Why, int], _Presence] = {}
        self._runs: dict[Why, _Run] = {}
        self._gone: list[int] = []

    def note(self, why: Why, number: int, capture_ns: int) -> None:
        """The id ``number`` is in a scene, and not tracked."""
        run = self._runs.get(why)
        if run is None or capture_ns - run.newest_ns > self._gap_ns:
            run = self._runs[why] = _Run(capture_ns)
        elif capture_ns > run.newest_ns:
            run.newest_ns = capture_ns
            run.captures += 1
        presence = self._present.get((why, number))
        if presence is not None and self._is_over(presence, capture_ns) and not self._keeps_ids:
            self._end(why, number)  # the id may be another person's now
            presence = None
        if presence is None:
            presence = self._present[why, number] = _Presence(capture_ns, capture_ns)
        presence.newest_ns = max(presence.newest_ns, capture_ns)
        if len(self._present) > MOST:
            self._present.clear()
            self._gone.append(capture_ns)

    def update(self, tracks: Mapping[int, Track], capture_ns: int) -> list[int]:
        """End the presence of people who are tracked or absent now.

        A track that is older than the presence is that of another person, whose id changed.

        Returns:
            when each of those was last seen who was there, and now may be anywhere.
        """
        for (why, number), presence in list(self._present.items()):
            over = self._is_over(presence, capture_ns)
            if self._is_found(why, tracks.get(number), presence) and (self._keeps_ids or not over):
                del self._present[why, number]
            elif over:
                self._end(why, number)
        gone, self._gone = self._gone, []
        return gone

    @property
    def reasons(self) -> set[Reason]:
        """The faults of those who are present."""
        return {why.reason for why, _ in self._present}

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(self._present)

    def _is_over(self, presence: _Presence, capture_ns: int) -> bool:
        return capture_ns - presence.newest_ns > self._gap_ns

    def _is_found(self, why: Why, track: Track | None, presence: _Presence) -> bool:
        if track is None or not why.ends_if_tracked:
            return False
        # a source that restarts gives new ids, with the old tracks, to the same people
        return why is Why.REFUSED_SCENE or track.began_ns >= presence.first_ns

    def _end(self, why: Why, number: int) -> None:
        presence = self._present.pop((why, number))
        if why.certain or self._runs[why].captures >= self._captures:
            self._gone.append(presence.newest_ns)
