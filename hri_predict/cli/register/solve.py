"""The pose of a sensor, from points that it saw at known positions in the room.

Least squares over rotations: W. Kabsch, "A solution for the best rotation to relate two sets of
vectors", Acta Crystallographica A32, 1976; the sign that keeps it a rotation and the scale are from
S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE
PAMI 13(4), 1991, equations 40 to 43.
"""

import math
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import norm, transform

LEAST_POINTS = 3
LEAST_APART_M = 0.5
"""Minimum distance of the points: at it, each 9 mm of error turns the sensor by a degree."""
LEAST_OFF_LINE_M = 0.1
"""Minimum RMS distance of the points from their best-fitting line."""
SAME_PLACE_M = 0.05
"""Apparent movement of a resting hand: tracker noise and body sway."""
SCALE_WITHIN = 0.03
"""Relative difference between lengths of source and room above which a warning is given."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Registration:
    """The pose of a source's frame in the room.

    Attributes:
        matrix: (4, 4) room from source: a rotation and a shift, no scale.
        residuals_m: (n,) distance of each point from its observed position, placed by the pose.
        scale: ratio of lengths in the room to lengths of the source, from the same points; ideally
            1.
    """

    matrix: Floats
    residuals_m: Floats
    scale: float

    @property
    def xyz(self) -> list[float]:
        """Metres, to a tenth of a millimetre."""
        return [round(float(v), 4) + 0.0 for v in self.matrix[:3, 3]]

    @property
    def quaternion_xyzw(self) -> list[float]:
        """The rotation, w >= 0, to a ten-thousandth of a degree."""
        return [round(float(v), 6) + 0.0 for v in quaternion(self.matrix[:3, :3])]


def solve(seen: Floats, known: Floats) -> Registration:
    """Return the pose that maps the points ``seen`` (n, 3) by the source to ``known`` (n, 3).

    Raises:
        ConfigError: too few points, too close to each other, or on one line; or the joint did not
            move between them.
    """
    _check_spread(known, "the points")
    if len(seen) >= LEAST_POINTS and _apart(seen) < SAME_PLACE_M:
        raise ConfigError(
            "the hand was seen in the same place each time: touch each point when prompted"
        )
    _check_spread(seen, "the observed positions of the joint")
    seen_middle, known_middle = seen.mean(axis=0), known.mean(axis=0)
    a, b = seen - seen_middle, known - known_middle
    u, singular, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, math.copysign(1.0, np.linalg.det(u) * np.linalg.det(vt))])
    matrix = np.eye(4)
    matrix[:3, :3] = (u * signs) @ vt
    matrix[:3, 3] = known_middle - matrix[:3, :3] @ seen_middle
    return Registration(
        matrix=matrix,
        residuals_m=norm(transform(matrix, seen) - known),
        scale=float((singular * signs).sum() / (a * a).sum()),
    )


def _apart(points: Floats) -> float:
    """Return the largest distance between two points."""
    return float(norm(points[:, None] - points[None]).max())


def _check_spread(points: Floats, what: str) -> None:
    if len(points) < LEAST_POINTS:
        raise ConfigError(f"{len(points)} points; give at least {LEAST_POINTS}, not on one line")
    apart = _apart(points)
    if apart < LEAST_APART_M:
        raise ConfigError(
            f"{what} are at most {apart:.2f} m apart; choose points at least {LEAST_APART_M:g} m, "
            f"better metres, apart"
        )
    off_line = float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1])
    if off_line / math.sqrt(len(points)) < LEAST_OFF_LINE_M:
        raise ConfigError(f"{what} lie on one line; choose a point well off the line")


def quaternion(rotation: Floats) -> Floats:
    """(4,) x, y, z, w of a rotation (3, 3), w >= 0.

    I. Y. Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix", Journal of
    Guidance, Control and Dynamics 23(6), 2000: the eigenvector of a symmetric matrix, exact for
    every angle.
    """
    m = np.asarray(rotation, np.float64)
    k = np.zeros((4, 4))
    k[:3, :3] = m + m.T - np.trace(m) * np.eye(3)
    k[:3, 3] = k[3, :3] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    k[3, 3] = np.trace(m)
    found: Floats = np.linalg.eigh(k)[1][:, -1]
    negative = found[3] < 0 or (found[3] == 0 and found[np.flatnonzero(found)[0]] < 0)
    return -found if negative else found
