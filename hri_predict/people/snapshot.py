"""The people in the room at one tick: the input of the predictor and the risk stage."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.contracts.scene import Doubt
from hri_predict.people.clock.clock_alignment import ClockEstimate
from hri_predict.protocol.reasons import Reason


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LostPerson:
    """A person who vanished, but not through an exit.

    Attributes:
        id: the id under which the body was last seen.
        positions: (J, 3) last observed positions of canonical joints, room frame; NaN if never
            observed.
        joint_age_s: (J,) seconds from that observation to ``last_seen_ns``; inf if never.
        last_seen_ns: time when last seen, node's clock.
        speed_m_s: assumed maximum speed of the body: measured, but at least the standard's.
        limbs_m_s: (J,) speed of each joint in excess of the body's.
        places: (D, 3) x, y and radius of discs on the floor that contain the person, given the
            space seen free until ``places_ns``; ``None``: the source does not see free space.
        places_ns: time of ``places``, node's clock.
        floor_m, platform_m: range of heights at which those people may stand.
        inferred_m: (J,) see ``Inferred.within_m``; ``None``: no joint is inferred.
        error_m: see ``PeopleSnapshot.errors_m``, at the time when last seen.
    """

    id: int
    positions: Floats
    joint_age_s: Floats
    last_seen_ns: int
    speed_m_s: float
    limbs_m_s: Floats
    places: Floats | None = None
    places_ns: int | None = None
    floor_m: float = 0.0
    platform_m: float = 0.0
    inferred_m: Floats | None = None
    error_m: float = 0.0


def distinct(lost: Sequence[LostPerson], ids: Iterable[int]) -> tuple[LostPerson, ...]:
    """Return lost people with ids that no other person has, so that each has a separate zone.

    A source that does not keep its ids may have given a lost person's id to another person, one of
    the tracked ``ids``. The lost person then gets a negative one, as after a restart.
    """
    taken, found = set(ids), []
    for person in lost:
        number = person.id
        if number in taken:
            number = -1 - abs(number)
            while number in taken:
                number -= 1
        taken.add(number)
        found.append(person if number == person.id else replace(person, id=number))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class RecentCaptures:
    """Each person's newest captures as received, oldest first: C columns, padded at the front.

    A resampled history bridges or omits gaps, so it is not suitable for measuring speeds.

    Attributes:
        age_s: (P, C) seconds before that person's newest capture; inf where padded.
        positions: (P, C, J, 3) metres, finite.
        observed: (P, C, J); false where padded.
    """

    age_s: Floats
    positions: Floats
    observed: Bools

    @classmethod
    def of_history(cls, history: Floats, observed: Bools, rate_hz: float) -> "RecentCaptures":
        """Return a history (P, T, J, 3) as captures, for use when nothing else is available."""
        ages = np.arange(history.shape[1] - 1, -1, -1) / rate_hz
        return cls(np.broadcast_to(ages, history.shape[:2]), history, observed)


@dataclass(frozen=True, slots=True, eq=False)
class Inferred:
    """The unseen joints that the node infers.

    Attributes:
        joints: (P, J) whether inferred in the newest capture.
        within_m: (P, J) metres: maximum distance of the true joint from its inferred position in 99
            of 100 cases; 0 for measured joints, and where nothing was inferred.
        measured: (P, T, J) where the history was measured.
        shown: (P, J) whether joints were measured in any of ``PeopleSnapshot.recent``.
    """

    joints: Bools
    within_m: Floats
    measured: Bools
    shown: Bools


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PeopleSnapshot:
    """All people in the room at one tick. P people, T steps of history, J joints.

    Attributes:
        now_ns: the tick's time (node's clock).
        ids: (P,) ids of the tracked people.
        history: (P, T, J, 3) metres, room frame, finite everywhere; the last step is each person's
            newest capture.
        observed: (P, T, J) where the history was observed.
        capture_ns: (P,) time of each person's newest capture, node's clock.
        last_positions: (P, J, 3) last observed position of each joint within the buffer; NaN if
            never.
        joint_age_s: (P, J) seconds from that observation to ``capture_ns``; inf if never.
        lost: people who vanished and may still be here.
        reasons: reasons why the scene as a whole cannot be trusted (stale, frozen, blind, ...);
            empty if it can.
        newest_capture_ns: capture of the newest good scene (node clock); ``None`` before the first.
        captures: number of distinct good captures so far, used for "release after N captures".
        counters: scenes and bodies dropped, repeated, out of order, ... since the start.
        clock: estimate of the source's clock; ``None`` if not available.
        recent: newest captures of the tracked people; ``None``: only the history is available.
        to_acknowledge: number of the set of lost people that an acknowledgement can clear now; a
            set that grows gets the next number. 0: there is none.
        doubts: reasons why the source itself does not vouch for the newest scene, with names.
        inferred: the inferred joints, which count as observed in the fields above. ``None``: no
            joint is inferred. Use ``measured``, ``fresh`` or ``shown`` where only measured joints
            must be used.
        errors_m: (P,) metres: possible common position error of all joints of a person, the largest
            of the kept captures; ``None``: 0.
    """

    now_ns: int
    ids: tuple[int, ...]
    history: Floats
    observed: Bools
    capture_ns: NDArray[np.int64]
    last_positions: Floats
    joint_age_s: Floats
    lost: tuple[LostPerson, ...]
    reasons: tuple[Reason, ...]
    newest_capture_ns: int | None
    captures: int
    counters: Mapping[str, int]
    clock: ClockEstimate | None = None
    recent: RecentCaptures | None = None
    to_acknowledge: int = 0
    inferred: Inferred | None = None
    doubts: tuple[Doubt, ...] = ()
    errors_m: Floats | None = None

    @property
    def shown(self) -> Bools:
        """(P, J) the recently measured joints: all except those inferred throughout."""
        if self.inferred is None:
            return np.ones(self.last_positions.shape[:2], np.bool_)
        return self.inferred.shown

    @property
    def fresh(self) -> Bools:
        """(P, J) the joints that were measured in the newest capture."""
        fresh: Bools = self.joint_age_s < 1e-6
        return fresh if self.inferred is None else fresh & ~self.inferred.joints

    @property
    def measured(self) -> Bools:
        """(P, T, J) where the history was measured, inferred joints left out."""
        return self.observed if self.inferred is None else self.inferred.measured

    @property
    def all_errors_m(self) -> Floats:
        """(P + L,) the errors of all people, lost people last."""
        here = np.zeros(len(self.ids)) if self.errors_m is None else self.errors_m
        return np.append(here, [person.error_m for person in self.lost])

    @property
    def age_s(self) -> float | None:
        """Seconds since the newest good capture."""
        if self.newest_capture_ns is None:
            return None
        return (self.now_ns - self.newest_capture_ns) * 1e-9
