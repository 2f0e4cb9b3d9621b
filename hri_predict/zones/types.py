"""The zones of a tick."""

from dataclasses import dataclass

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules


@dataclass(frozen=True, slots=True, eq=False)
class Zones:
    """Regions in which each body segment of each person may be. P people (lost people too), S
    segments.

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
