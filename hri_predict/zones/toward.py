"""Extent of a body in one direction, which is smaller than that of its zones.

A zone is a ball around a joint's forecast position and holds the joint in every direction. A part
of the robot only needs to know how far the joint may come *towards it*. For a forecast error e and
a unit vector n, this is e.n, with a quantile of 0.4 to 0.8 times the quantile of e's length. The
calibration states this share for each speed class and step by the angle between n and the
forecast's motion (``Calibration.toward``), fixed before the outcome is known.
``docs/decisions/zones-toward-the-robot.md`` proves the method of ``risk.separation.search``.
"""

from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.geometry import norm, transform

STILL_M = 0.05
"""Minimum forecast displacement that defines a direction of motion."""
STEEP = 0.6
"""Minimum vertical component of a direction that counts as up or down, not sideways."""
COSINES = (-0.75, -0.25, 0.25, 0.75, 0.93)
"""Cosines between the classes of the angle to the motion, from behind to ahead."""
BINS = 3 + len(COSINES)
"""Classes of direction: still joints, the classes of ``COSINES``, and steep directions."""


class Toward(NamedTuple):
    """Support of P bodies by direction. K+1 entries, J joints, S segments, as in the zones.

    Attributes:
        ends: (P, S, 2) the joints at both ends of each segment.
        extra: (P, S) metres that a segment extends beyond its joints' spheres.
        mid, radius: (P, K+1, J, 3) and (P, K+1, J) the joints' spheres.
        path: (P, K+1, J, 3) their forecast places.
        claim: (P, K+1, J) their calibrated radii.
        rest: (P, K+1, J) metres around ``path`` in addition to ``claim``; infinite without a
            forecast.
        within: (P, J) radius around the inferred position of an unseen joint, applied in all
            directions; 0 for other joints.
        way: (P, K+1, J, 3) unit vectors of the forecast motion; zeros for a still joint.
        shares: (P, K+1, BINS) shares of ``claim`` to use in directions of each class.
    """

    ends: Ints
    extra: Floats
    mid: Floats
    radius: Floats
    path: Floats
    claim: Floats
    rest: Floats
    within: Floats
    way: Floats
    shares: Floats

    def of(self, people: Ints) -> "Toward":
        """Return the support of some people, given by their indices."""
        return Toward._make(rows[people] for rows in self)

    def moved(self, matrix: Floats) -> "Toward":
        """Return the support after a rigid motion (4, 4) that keeps z upright."""
        return self._replace(
            mid=transform(matrix, self.mid),
            path=transform(matrix, self.path),
            way=self.way @ matrix[:3, :3].T,
        )


NOTHING = Toward(
    np.zeros((0, 0, 2), np.int64), np.zeros((0, 0)), np.zeros((0, 0, 0, 3)), np.zeros((0, 0, 0)),
    np.zeros((0, 0, 0, 3)), np.zeros((0, 0, 0)), np.zeros((0, 0, 0)), np.zeros((0, 0)),
    np.zeros((0, 0, 0, 3)), np.zeros((0, 0, 0)),
)  # fmt: skip
"""Balls alone."""


def direction_class(direction: Floats, way: Floats) -> Ints:
    """Return (...) the class of unit vectors (..., 3), for joints that move along ``way`` (...,
    3)."""
    cosine = np.einsum("...i,...i->...", direction, way)
    found = 1 + np.searchsorted(COSINES, cosine, side="right")
    found = np.where(np.einsum("...i,...i->...", way, way) > 0.25, found, 0)
    result: Ints = np.where(np.abs(direction[..., 2]) > STEEP, BINS - 1, found)
    return result


def ways(moved: Floats) -> Floats:
    """Return (..., 3) unit vectors of displacements (..., 3); zeros for those below ``STILL_M``."""
    size = norm(moved)[..., None]
    found: Floats = np.where(size >= STILL_M, moved / np.maximum(size, STILL_M), 0.0)
    return found


def followed(joint_age: Floats, claimed: Floats, outside: Bools, steps: int) -> Bools:
    """Return (P, J) whether a joint has a calibrated radius and follows its forecast."""
    has = np.isfinite(claimed[:, :steps]).all(1)
    found: Bools = np.asarray((joint_age < 1e-6) & has & ~outside[:, None])
    return found
