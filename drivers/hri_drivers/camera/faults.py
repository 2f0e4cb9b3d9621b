"""Pictures that show nothing: dark, covered, over-exposed, frozen."""

import cv2
import numpy as np

from hri_drivers.camera.seen import Image, UInt8

FROZEN_S = 0.5
"""No camera delivers identical pictures for longer: each has noise of its own."""
DARK, BRIGHT = 16, 250
"""Grey values, 0..255: at or below, and at or above, nothing can be told apart."""
MAX_DARK, MAX_BRIGHT = 0.9, 0.5
"""Largest share of the picture that may be so dark, or so bright."""
MIN_CONTRAST = 5.0
"""Standard deviation of the grey values; a lens behind a hand or a cloth shows less."""
_SMALL = (64, 48)


def hides(pixels: UInt8) -> str | None:
    """Return what is wrong with a picture (H, W, 3) by itself, for a person; None: nothing."""
    small = cv2.resize(pixels, _SMALL, interpolation=cv2.INTER_AREA)
    grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY))
    if np.mean(grey >= BRIGHT) > MAX_BRIGHT:
        return "the picture is over-exposed"
    if np.mean(grey <= DARK) > MAX_DARK:
        return "the picture is dark, or the lens is covered"
    if grey.std() < MIN_CONTRAST:
        return "the picture shows one even surface: the lens is covered or out of focus"
    return None


class FrozenWatch:
    """Notices a camera that repeats one picture."""

    def __init__(self) -> None:
        self._last: UInt8 | None = None
        self._since_ns = 0

    def judge(self, image: Image) -> str | None:
        """Return what is wrong with the sequence of pictures; None: nothing."""
        if self._last is None or not np.array_equal(self._last, image.pixels):
            self._last, self._since_ns = image.pixels, image.exposed_ns
            return None
        still_s = (image.exposed_ns - self._since_ns) / 1e9
        if still_s < FROZEN_S:
            return None
        return "the picture is frozen: it has been identical for longer than a camera can repeat it"
