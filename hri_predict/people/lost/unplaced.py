"""People in scenes who are not tracked, so their positions are unknown.

A person may have no visible joint, exceed the maximum number, share the id of another person, or
appear only in scenes that do not advance. While such a person is in scenes, the input has a fault.
If the person disappears without having been tracked, it is unknown where they went: a person may be
anywhere in the room until an acknowledgement. A phantom of a few captures without a position has no
lasting effect.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, unique

from hri_predict.people.track import Track
from hri_predict.protocol.reasons import Reason

MOST = 500
"""Maximum number of ids at a time; more cannot be real people, and a person may then be
anywhere."""


@unique
class Why(Enum):
    """Reason why a person is not tracked, and the resulting fault.

    Attributes:
        reason: the fault.
        ends_if_tracked: whether the fault ends when the id is tracked, because the track is this
            person.
        certain: whether a single capture proves that a person is there.
    """

    NO_JOINT = (Reason.PERSON_NOT_LOCATED, True, False)
    ONE_TOO_MANY = (Reason.TOO_MANY_PEOPLE, True, True)
    SECOND_BODY = (Reason.INPUT_IMPOSSIBLE, False, True)
    REFUSED_SCENE = (Reason.INPUT_IMPOSSIBLE, True, False)
    """The person appears only in scenes that did not advance."""
    REFUSED_ELSEWHERE = (Reason.INPUT_IMPOSSIBLE, False, False)
    """The id is tracked, but scenes that did not advance show it far away."""

    def __init__(self, reason: Reason, ends_if_tracked: bool, certain: bool) -> None:
        self.reason, self.ends_if_tracked, self.certain = reason, ends_if_tracked, certain


@dataclass(slots=True)
class _Presence:
    first_ns: int
    newest_ns: int


@dataclass(slots=True)
class _Run:
    """Successive captures with a person for one reason; the id may change in the meantime."""

    newest_ns: int
    captures: int = 1


class Unplaced:
    """People who are present but not tracked.

    Args:
        gap_ns: shorter gaps in a person's presence are ignored.
        captures: number of captures that prove a person's presence if a single capture does not.
        keeps_ids: whether an id always belongs to the same person.
    """

    def __init__(self, gap_ns: int, captures: int, keeps_ids: bool) -> None:
        self._gap_ns = gap_ns
        self._captures = captures
        self._keeps_ids = keeps_ids
        self._present: dict[tuple[Why, int], _Presence] = {}
        self._runs: dict[Why, _Run] = {}
        self._gone: list[int] = []

    def note(self, why: Why, number: int, capture_ns: int) -> None:
        """Record that the id ``number`` is in a scene and not tracked."""
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

        A track older than the presence belongs to another person with a changed id.

        Returns:
            times at which people who were present, and now may be anywhere, were last seen.
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
        """The faults of the people present."""
        return {why.reason for why, _ in self._present}

    def __bool__(self) -> bool:
        """Whether any untracked person is present."""
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
