"""The result of a network on one image, before people have ids."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hri_drivers.camera.seen import UInt8
from hri_predict.base.arrays import Floats

JOINTS = {"mediapipe33": 33, "coco17": 17}
"""Layout -> number of its joints."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """One person; the arrays are those of ``hri_drivers.camera.seen.Seen``.

    Attributes:
        score: 0..1, how sure the network is that a person is there.
    """

    pixels: Floats
    visibility: Floats
    world: Floats | None
    score: float


@dataclass(frozen=True, slots=True)
class Finding:
    """All people of one image.

    Attributes:
        people: the most confident ones, at most as many as the network follows.
        is_whole: whether ``people`` contains every person that the network found.
    """

    people: tuple[Found, ...]
    is_whole: bool = True


class Finder(Protocol):
    """Finds people; it may use its result of the previous image.

    Attributes:
        layout: name of the joint map of the people, a key of ``JOINTS``.
    """

    layout: str

    def find(self, pixels: UInt8) -> Finding:
        """Return the people in an image (H, W, 3), BGR."""


def logistic(values: Floats) -> Floats:
    """1 / (1 + exp(-x)) without overflow, for a network's raw scores."""
    result: Floats = 1.0 / (1.0 + np.exp(-np.clip(values, -100.0, 100.0)))
    return result


def without_outside(pixels: Floats, visibility: Floats, picture: UInt8) -> Floats:
    """Return pixels with NaN where a joint is outside the image or not a number.

    Args:
        pixels: (J, 2).
        visibility: (J,), set to 0 where the result is NaN.
        picture: gives the size.
    """
    height, width = picture.shape[:2]
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0) & (pixels <= [width - 1, height - 1])).all(axis=1)
    inside &= np.isfinite(visibility)
    visibility[~inside] = 0.0
    return np.where(inside[:, np.newaxis], pixels, np.nan)


def distinct(people: list[Found], closer: float = 0.1) -> list[Found]:
    """Return people without duplicates, most confident first.

    Args:
        people: found in one image.
        closer: two detections are one person if the median distance of the joints that both show is
            less than this fraction of the larger body's extent.
    """
    kept: list[Found] = []
    for one in sorted(people, key=lambda found: -found.score):
        if all(apart(one.pixels, other.pixels) >= closer for other in kept):
            kept.append(one)
    return kept


def apart(a: Floats, b: Floats) -> float:
    """Return the median distance of two bodies' joints, in extents of the larger body.

    Args:
        a, b: (J, 2) pixels, NaN where not found.

    Returns:
        Infinity where they have fewer than three joints in common.
    """
    both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if both.sum() < 3:
        return float("inf")
    extent = max(_extent(a), _extent(b))
    distance = float(np.median(np.linalg.norm(a[both] - b[both], axis=1)))
    return distance / extent if extent > 0 else float("inf")


def _extent(pixels: Floats) -> float:
    known = pixels[np.isfinite(pixels).all(axis=1)]
    return float(np.linalg.norm(known.max(axis=0) - known.min(axis=0))) if len(known) else 0.0
