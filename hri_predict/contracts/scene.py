"""A source's view at one capture: all people in the room, or none."""

import math
from dataclasses import dataclass
from numbers import Real

from hri_predict.base.arrays import Bools, Floats
from hri_predict.protocol.reasons import Reason

MAX_ERROR_M = 20.0
"""A source that does not know a person's place to this much does not see the person."""


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """One skeleton of one person at one time, in the joint order of its source.

    Attributes:
        id: the source's number for this body, 0..65535; a key, never a position in a list.
        positions: (J_source, 3) metres in the room's frame; NaN where not observed.
        observed: (J_source,) which joints were observed.
        seen_as: the sensors of a merged source that see this person, and the id that each gives;
            empty for every other source.
        error_m: radius, metres, of a ball that holds the common error of the joints' places in 99
            of 100 captures: all joints may be off by the same vector, and that vector may be
            another one in the next capture. 0 to ``MAX_ERROR_M``; anything else is refused.
    """

    id: int
    positions: Floats
    observed: Bools
    seen_as: tuple[tuple[str, int], ...] = ()
    error_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why a source itself does not vouch for a scene.

    Attributes:
        reason: its reason on the wire.
        text: what is wrong, with names, for a person.
    """

    reason: Reason
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A source's view at one capture.

    Attributes:
        stamp_ns: the source's time stamp of the capture, nanoseconds of the *source's* clock.
            ``people`` aligns it with the node's clock; from there on it is a ``capture_ns``.
        sequence: the source's own counter, advancing by one per capture; gaps are losses.
        sees_room: whether the source saw the room. ``True`` with no people says "the room is
            empty"; ``False`` says "not known".
        people: every person seen.
        doubts: why the source itself does not vouch for it; with any, it proves nothing.
        joined: pairs of ids (gone, kept): the source showed one person as two, and found out.
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
