"""What the risk stage works on, and its result."""

from dataclasses import dataclass

from hri_predict.arrays import Floats
from hri_predict.geometry import Capsules
from hri_predict.protocol.messages import Advice
from hri_predict.protocol.reasons import Reason


@dataclass(frozen=True, slots=True, eq=False)
class Zones:
    """Where every body segment of every person may be. P people (lost ones too), S segments.

    Attributes:
        ids: (P,) person ids.
        segments: names of the S segments.
        times_s: (H+1,) seconds after the snapshot's ``now_ns``; the first is 0.
        capsules: (P, H+1, S); entry k holds the segment during the whole interval that *ends* at
            ``times_s[k]``; entry 0 is the body at its capture.
    """

    ids: tuple[int, ...]
    segments: tuple[str, ...]
    times_s: Floats
    capsules: Capsules


@dataclass(frozen=True, slots=True)
class Assessment:
    """What the risk stage found in one tick.

    Attributes:
        advices: one per robot, in the configuration's order.
        zones: the zones behind the advice.
        named_zones: the state of each of the user's named zones.
        reasons: why the zones are no better than they are; empty if nothing is wrong.
        near_misses: where a moving robot was nearly too close, one per robot at most.
    """

    advices: tuple[Advice, ...]
    zones: Zones
    named_zones: tuple["NamedZoneState", ...]
    reasons: tuple[Reason, ...] = ()
    near_misses: tuple["NearMiss", ...] = ()


@dataclass(frozen=True, slots=True)
class NearMiss:
    """A robot that moves, and somebody hardly farther from it than its motion needs.

    Attributes:
        robot: its index.
        person: the id.
        segment: name of the body's segment.
        link: index of the robot's capsule.
        separation_m: the distance now.
        limit_m: the distance that the robot's motion needs.
    """

    robot: int
    person: int
    segment: str
    link: int
    separation_m: float
    limit_m: float


@dataclass(frozen=True, slots=True)
class NamedZoneState:
    """A named zone at one tick.

    Attributes:
        name: as configured.
        occupied: whether anybody is inside now.
        entry_s: seconds until somebody may first be inside; 0 if occupied, ``None`` if not within
            the horizon.
    """

    name: str
    occupied: bool
    entry_s: float | None
