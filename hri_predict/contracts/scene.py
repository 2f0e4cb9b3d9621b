"""A source's data of one capture: all people in the room, or none."""

import math
from dataclasses import dataclass
from numbers import Real

from hri_predict.base.arrays import Bools, Floats
from hri_predict.protocol.reasons import Reason

MAX_ERROR_M = 20.0
"""Maximum position error; with a larger error a person is not observed."""


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """One skeleton of one person at one time, in the joint order of its source.

    Attributes:
        id: the source's number for this body, 0..65535; a key, not a list index.
        positions: (J_source, 3) metres in the room's frame; NaN where not observed.
        observed: (J_source,) whether each joint was observed.
        seen_as: the sensors of a merged source that observe this person, with the id from each;
            empty for other sources.
        error_m: radius, metres, of a ball that contains the common error of all joint positions in
            99 of 100 captures: all joints may be displaced by the same vector, which may differ in
            the next capture. 0 to ``MAX_ERROR_M``; other values are refused.
    """

    id: int
    positions: Floats
    observed: Bools
    seen_as: tuple[tuple[str, int], ...] = ()
    error_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason why a source itself does not trust a scene.

    Attributes:
        reason: the reason code in messages.
        text: a readable description, with names.
    """

    reason: Reason
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A source's data of one capture.

    Attributes:
        stamp_ns: the source's time stamp of the capture, nanoseconds of the *source's* clock.
            ``people`` converts it to the node's clock, as ``capture_ns``.
        sequence: the source's own counter, advancing by one per capture; gaps are losses.
        sees_room: whether the source observed the room. ``True`` without people means that the room
            is empty; ``False`` means unknown.
        people: all observed people.
        doubts: reasons why the source itself does not trust the scene, which then proves nothing.
        joined: pairs of ids (gone, kept): the source had reported one person as two, and corrected
            it.
    """

    stamp_ns: int
    sequence: int
    sees_room: bool
    people: tuple[Person, ...]
    doubts: tuple[Doubt, ...] = ()
    joined: tuple[tuple[int, int], ...] = ()


def sound_error_m(stated: object) -> float:
    """Return a stated error as metres; NaN if it is not a number from 0 to ``MAX_ERROR_M``."""
    try:
        error_m = float(stated) if isinstance(stated, Real) else math.nan
    except OverflowError:
        return math.nan
    return error_m if 0.0 <= error_m <= MAX_ERROR_M else math.nan
