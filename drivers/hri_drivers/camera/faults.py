"""Images that show nothing: dark, covered, over-exposed, frozen."""

import cv2
import numpy as np

from hri_drivers.camera.seen import Image, UInt8

FROZEN_S = 0.5
"""Maximum time for which a working camera can deliver identical images: each has its own
noise."""
DARK, BRIGHT = 16, 250
"""Grey values, 0..255: no detail is visible at or below the first, or at or above the second."""
MAX_DARK, MAX_BRIGHT = 0.9, 0.5
"""Largest fraction of the image that may be that dark, or that bright."""
MIN_CONTRAST = 5.0
"""Minimum standard deviation of the grey values; a lens covered by a hand or cloth shows less."""
_SMALL = (64, 48)


def hides(pixels: UInt8) -> str | None:
    """Return the fault of a single image (H, W, 3) as readable text; None: no fault."""
    small = cv2.resize(pixels, _SMALL, interpolation=cv2.INTER_AREA)
    grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY))
    if np.mean(grey >= BRIGHT) > MAX_BRIGHT:
        return "the image is over-exposed"
    if np.mean(grey <= DARK) > MAX_DARK:
        return "the image is dark, or the lens is covered"
    if grey.std() < MIN_CONTRAST:
        return "the image shows one even surface: the lens is covered or out of focus"
    return None


class FrozenWatch:
    """Detects a camera that repeats one image."""

    def __init__(self) -> None:
        self._last: UInt8 | None = None
        self._since_ns = 0

    def judge(self, image: Image) -> str | None:
        """Return the fault of the sequence of images; None: no fault."""
        if self._last is None or not np.array_equal(self._last, image.pixels):
            self._last, self._since_ns = image.pixels, image.exposed_ns
            return None
        still_s = (image.exposed_ns - self._since_ns) / 1e9
        if still_s < FROZEN_S:
            return None
        return "the image is frozen: it has not changed for longer than a working camera allows"
