"""Joints of trackers that the canonical skeleton lacks, interpolated between its joints."""

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import CANONICAL


class BodyPoints:
    """One body; points are ``at`` a joint or ``between`` two joints.

    Args:
        joints: (21, 3) of the canonical skeleton.
    """

    def __init__(self, joints: Floats) -> None:
        self._at = {name: joints[i] for i, name in enumerate(CANONICAL.joints)}

    def at(self, joint: str) -> Floats:
        """Return the position (3,) of a canonical joint."""
        place: Floats = self._at[joint]
        return place

    def between(self, a: str, b: str, part: float) -> Floats:
        """Return the point (3,) at this fraction of the way from ``a`` to ``b``."""
        point: Floats = self._at[a] + part * (self._at[b] - self._at[a])
        return point

    def limbs(self, side: str) -> list[Floats]:
        """Return the collar bone, shoulder, elbow, wrist, hip, knee, ankle and foot of one side."""
        names = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
        collar = self.between("neck", f"{side}_shoulder", 0.2)
        return [collar, *(self.at(f"{side}_{name}") for name in names)]
