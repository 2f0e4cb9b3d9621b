"""People who are in scenes, but whom nobody tracks: it is not known where they are, or were.

A person may show no joint, be one too many, share the id of another, or appear only in scenes that
do not advance. While such a person is in scenes, the input has a fault. When the person is in them
no more, and was never tracked, nobody saw where they went: somebody may be anywhere in the room,
until an acknowledgement. A phantom of a few captures, without any place, leaves nothing behind.
"""

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum

from hri_predict.protocol.reasons import Reason


class Why(Enum):
    """Why a person is not tracked, and the fault that this is.

    Attributes:
        reason: the fault.
        ends_if_tracked: whether it ends when the id is tracked: then that is this person.
        certain: whether one capture shows that somebody is there.
    """

    NO_JOINT = (Reason.PERSON_NOT_LOCATED, True, False)
    ONE_TOO_MANY = (Reason.TOO_MANY_PEOPLE, True, True)
    SECOND_BODY = (Reason.INPUT_IMPOSSIBLE, False, True)
    OLD_SCENE = (Reason.INPUT_IMPOSSIBLE, True, False)
    """In scenes that did not advance, and in no other."""
    OLD_SCENE_ELSEWHERE = (Reason.INPUT_IMPOSSIBLE, False, False)
    """The id is tracked, but such scenes show it far from there."""

    def __init__(self, reason: Reason, ends_if_tracked: bool, certain: bool) -> None:
        self.reason, self.ends_if_tracked, self.certain = reason, ends_if_tracked, certain


@dataclass(slots=True)
class _Presence:
    newest_ns: int
    captures: int = 0


class Unplaced:
    """Who is present without being tracked.

    Args:
        gap_ns: absence for longer than this is an absence.
        captures: so many captures show that somebody is there, where one does not.
    """

    def __init__(self, gap_ns: int, captures: int) -> None:
        self._gap_ns = gap_ns
        self._captures = captures
        self._present: dict[tuple[Why, int], _Presence] = {}

    def note(self, why: Why, number: int, capture_ns: int) -> None:
        """The id ``number`` is in a scene, and not tracked."""
        presence = self._present.setdefault((why, number), _Presence(capture_ns))
        presence.newest_ns = max(presence.newest_ns, capture_ns)
        presence.captures += 1

    def update(self, tracked: Collection[int], capture_ns: int) -> list[int]:
        """Forget those who are tracked now, and let go of those who are absent.

        Returns:
            when each of those was last seen who was there, and now may be anywhere.
        """
        last_seen = []
        for (why, number), presence in list(self._present.items()):
            absent = capture_ns - presence.newest_ns > self._gap_ns
            found = why.ends_if_tracked and number in tracked
            if absent or found:
                del self._present[why, number]
            if absent and not found and (why.certain or presence.captures >= self._captures):
                last_seen.append(presence.newest_ns)
        return last_seen

    @property
    def reasons(self) -> set[Reason]:
        """The faults of those who are present."""
        return {why.reason for why, _ in self._present}

    def __bool__(self) -> bool:
        """Whether anybody is."""
        return bool(self._present)
