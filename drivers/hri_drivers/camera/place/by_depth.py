"""Locates a person with a depth image, from the depth at each joint's pixel.

A pixel at the edge of a limb may show the wall behind it, so the nearest surface of a small patch
is used. An object in front of the person is then measured instead of the joint. The bone lengths
reveal this: a joint farther from its neighbours than a bone's maximum length counts as not
measured, and so does a joint of a hand, a foot or the head whose wrist, ankle or shoulder is not
measured.
"""

import math
from pathlib import Path

import numpy as np

from hri_drivers.camera.pixels import read_picture
from hri_drivers.camera.place.bones import Bones, bones_of
from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.place.placed import (
    FARTHEST_M,
    MIN_VISIBILITY,
    NEAREST_M,
    Placed,
    Unplaced,
)
from hri_drivers.camera.seen import Float32, Seen
from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import norm

PATCH = 0.006
"""Half the side of a patch, as a share of the focal length: 2 cm on a person 3 m away."""
SHORTEST_M = 0.15
"""Minimum distance that depth cameras measure."""
MIN_VALID = 0.3
"""A patch with a smaller share of measured pixels has no depth."""
NEAR_SHARE = 0.1
"""Minimum fraction of a patch covered by the nearest surface; fewer pixels are between surfaces."""
THICK_M = 0.12
"""Maximum range of depths of one surface within a patch."""
SKIN_M = 0.06
"""Distance from the skin, which is measured, to the joint; more at the trunk, less at wrists."""
MAX_STATURE_M = 2.1
LOOSE = 1.3
"""Allowance for a bone's length: proportions, and the errors of both ends."""
REACH_M = 1.3
"""Maximum distance from the middle of a body to one of its joints, along the ray."""
MIN_JOINTS = 4
ERROR_M = 0.08
"""99 % bound of the error at short range, where it comes from the thickness of the body."""
ERROR_SHARE = 0.02
"""Further error as a share of the distance: "less than 2 % at 2 m" (Intel RealSense D400 data
sheet, depth accuracy). That of stereo grows with the square of the distance, and is added."""


def place_by_depth(
    seen: Seen, depth: Float32, camera: Camera, stereo_error: float = 0.0
) -> Placed | Unplaced:
    """Place a person by the depth at the pixels of the joints.

    Args:
        seen: the person; landmarks in metres are not needed.
        depth: (H, W) metres along the optical axis, aligned with the colour image; 0 or NaN
            where not measured.
        camera: camera for images of this size.
        stereo_error: see ``Image``.

    Raises:
        ConfigError: depth and colour images differ in size.
    """
    if depth.shape != (camera.size[1], camera.size[0]):
        raise ConfigError(
            f"the depth image is {depth.shape[1]} x {depth.shape[0]} and the colour image "
            f"{camera.size[0]} x {camera.size[1]}: align the depth with the colour first"
        )
    rays = camera.rays(seen.pixels)
    visible = (seen.visibility >= MIN_VISIBILITY) & camera.inside(seen.pixels)
    radius = max(1, round(PATCH * float(camera.matrix[0, 0])))
    depths = np.array(
        [
            _surface(_patch(depth, pixel, radius)) if known else np.nan
            for pixel, known in zip(seen.pixels, visible, strict=True)
        ]
    )
    depths += SKIN_M
    points = np.column_stack([rays, np.ones(len(rays))]) * depths[:, None]
    known = np.isfinite(points).all(axis=1)
    if known.any():
        known &= np.abs(depths - np.median(depths[known])) <= REACH_M
        known = _carried(points, _whole(points, known, bones_of(seen.layout)), seen.layout)
    if np.count_nonzero(known) < MIN_JOINTS:
        return Unplaced("too few joints with depth")
    middle = np.median(points[known], axis=0)
    distance = float(np.linalg.norm(middle))
    if not NEAREST_M <= distance <= FARTHEST_M:
        return Unplaced(f"not between {NEAREST_M:g} and {FARTHEST_M:g} m away")
    # of a wrong focal length the joint farthest from the optical axis is off the most
    aside = camera.focal_error * float(np.hypot(points[known, 0], points[known, 1]).max())
    stereo = stereo_error * float(points[known, 2].max()) ** 2
    error_m = math.hypot(ERROR_M, ERROR_SHARE * distance, stereo) + aside
    return Placed(np.where(known[:, None], points, np.nan), known, error_m)


def read_depth(path: Path) -> Float32:
    """Return a depth image from a 16-bit PNG with one channel in millimetres; NaN where it is 0.

    Raises:
        ConfigError: the file is missing, or is not a depth image.
    """
    import cv2

    data = read_picture(path, cv2.IMREAD_UNCHANGED)
    if data is None:
        raise ConfigError(f"{path}: not an image")
    if data.dtype != np.uint16 or data.ndim != 2:
        raise ConfigError(
            f"{path}: not a depth image; expected a single-channel 16-bit PNG in millimetres"
        )
    metres = data.astype(np.float32) * np.float32(0.001)
    return np.where(metres > 0, metres, np.float32(np.nan))


def _patch(depth: Float32, pixel: Floats, radius: int) -> Floats:
    """Return the depths around a pixel of the image as a flat array."""
    x, y = (round(float(v)) for v in pixel)
    part = depth[max(y - radius, 0) : y + radius + 1, max(x - radius, 0) : x + radius + 1]
    return part.astype(np.float64).ravel()


def _surface(values: Floats) -> float:
    """Return the depth of the nearest surface in a patch; NaN if there is none."""
    valid = np.sort(values[(values >= SHORTEST_M) & (values <= FARTHEST_M)])
    if len(valid) < max(1, MIN_VALID * len(values)):
        return float("nan")
    ends = np.searchsorted(valid, valid + THICK_M, side="right")
    large = np.flatnonzero(ends - np.arange(len(valid)) >= NEAR_SHARE * len(valid))
    if not len(large):
        return float("nan")
    first = int(large[0])
    return float(np.median(valid[first : ends[first]]))


def _whole(points: Floats, known: Bools, bones: Bones) -> Bools:
    """Return the joints that remain once no bone is longer than possible.

    If a bone is too long, the end with the larger depth difference from the body is dropped.
    """
    known = known.copy()
    longest = bones.shares * MAX_STATURE_M * LOOSE
    while True:
        lengths = np.where(known[bones.ends].all(axis=1), bones.lengths(points), 0.0)
        excess = lengths - longest
        worst = int(excess.argmax())
        if excess[worst] <= 0:
            return known
        first, second = bones.ends[worst]
        depth = points[:, 2]
        middle = np.median(depth[known])
        known[first if abs(depth[first] - middle) > abs(depth[second] - middle) else second] = False


def _carried(points: Floats, known: Bools, layout: str) -> Bools:
    """Return the joints without those of hands, feet and head that are too far from the body.

    One whose wrist, ankle or shoulder is not known cannot be checked, and is left out.
    """
    bones, known = bones_of(layout), known.copy()
    carriers, ends = bones.carried.T
    lengths = norm(points[carriers] - points[ends])
    is_near = lengths <= bones.carried_shares * MAX_STATURE_M * LOOSE
    confirmed = np.zeros_like(known)
    confirmed[ends[known[carriers] & is_near]] = True
    confirmed[ends[known[carriers] & ~is_near]] = False  # the nose has two shoulders
    known[ends] &= confirmed[ends]
    return known
