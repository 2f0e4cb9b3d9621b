"""The turned square of an image that a network looks at.

MediaPipe's graphs ``pose_detection_to_roi`` and ``pose_landmarks_to_roi`` (Apache-2.0) define it:
its centre is the middle of the hips, a second point gives the circle around the whole body, and the
line between the two points is vertical in the square.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from hri_drivers.camera.seen import UInt8
from hri_predict.base.arrays import Floats

MARGIN = 1.25
"""``RectTransformationCalculator``: scale_x and scale_y."""
MIN_PIXELS, MAX_PICTURES = 8.0, 8.0
"""Minimum side of a square that can show a person, and maximum side in image widths."""


@dataclass(frozen=True, slots=True)
class Roi:
    """A turned square.

    Attributes:
        x, y: its centre, in pixels of the image; pixel centres are whole numbers.
        size: its side, in pixels.
        angle: radians from the image's x axis to its own, clockwise as seen.
    """

    x: float
    y: float
    size: float
    angle: float

    def in_picture(self, points: Floats) -> Floats:
        """Return (N, 2) pixels of points (N, 2) that are given in 0..1 of the square."""
        return (points - 0.5) * self.size @ self.turn.T + [self.x, self.y]

    @property
    def turn(self) -> Floats:
        """(2, 2) rotation from the square's axes to the image's."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[c, -s], [s, c]])

    def crop(self, picture: UInt8, side: int) -> UInt8:
        """Return the square as (side, side, 3); black where it exceeds the image."""
        scaled = self.turn * (self.size / side)
        first = self.in_picture(np.full((1, 2), 0.5 / side))[0]  # centre of the first pixel
        matrix = np.column_stack([scaled, first])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cut = cv2.warpAffine(picture, matrix, (side, side), flags=flags)
        return np.asarray(cut, np.uint8)


def whole(picture: UInt8) -> Roi:
    """Return the upright square around a whole image."""
    height, width = picture.shape[:2]
    return Roi((width - 1) / 2, (height - 1) / 2, max(width, height), 0.0)


def around(centre: Floats, edge: Floats, picture: UInt8) -> Roi | None:
    """Return the square around a body; None if it cannot hold one.

    Args:
        centre: (2,) middle of the hips, pixels.
        edge: (2,) point on the circle around the body, above the head, pixels.
        picture: limits the size and the place.
    """
    height, width = picture.shape[:2]
    x, y = float(centre[0]), float(centre[1])
    dx, dy = float(edge[0]) - x, float(edge[1]) - y
    size = 2.0 * math.hypot(dx, dy) * MARGIN
    if not MIN_PIXELS <= size <= MAX_PICTURES * max(width, height):  # NaN, too
        return None
    if not (-size / 2 <= x <= width + size / 2 and -size / 2 <= y <= height + size / 2):
        return None
    return Roi(x, y, size, _wrapped(math.pi / 2 - math.atan2(-dy, dx)))


def _wrapped(angle: float) -> float:
    return angle - 2 * math.pi * math.floor((angle + math.pi) / (2 * math.pi))
