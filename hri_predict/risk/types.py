"""What the risk stage works on and gives."""

from dataclasses import dataclass

from hri_predict.protocol.messages import Advice
from hri_predict.reasons import Reason
from hri_predict.scene import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Capsules:
    """A batch of capsules: all points within ``radius`` of the segment from ``a`` to ``b``.

    Attributes:
        a, b: (..., 3) ends, metres, room frame; equal ends make a sphere.
        radius: (...,) metres.
    """

    a: Floats
    b: Floats
    radius: Floats


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
        zones: the zones they rest on.
        named_zones: per named zone of the user's: inside now, and seconds to predicted entry.
        reasons: why the zones are no better than they are; empty when nothing is the matter.
    """

    advices: tuple[Advice, ...]
    zones: Zones
    named_zones: tuple["NamedZoneState", ...]
    reasons: tuple[Reason, ...] = ()


@dataclass(frozen=True, slots=True)
class NamedZoneState:
    """A named zone at one tick.

    Attributes:
        name: as configured.
        occupied: whether anybody is inside now.
        entry_s: seconds until somebody may first be inside; 0 when occupied, ``None`` when not
            within the horizon.
    """

    name: str
    occupied: bool
    entry_s: float | None
