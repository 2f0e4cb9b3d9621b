"""The data that the camera's parts exchange: one image, and one person in one image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats

UInt8 = NDArray[np.uint8]
Float32 = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """One image of one camera.

    Attributes:
        pixels: (H, W, 3), BGR.
        exposed_ns: time of the exposure by ``time.monotonic_ns``, as well as it is known.
        number: counts up by one for each image that the device delivered.
        depth: (H, W) metres of an RGB-D camera, or None.
        stamped: how the time of the exposure is known: by the device, by the file, or on arrival
            less the latency that is assumed. Times of different kinds differ by an unknown amount:
            the latency of the camera without stamps.
        stereo_error: 99 % bound of the error of stereo depth, metres, divided by the square of the
            depth, 1/m; 0 for other depth.
    """

    pixels: UInt8
    exposed_ns: int
    number: int
    depth: Float32 | None = None
    stamped: str = "by the device"
    stereo_error: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One person in one image.

    Attributes:
        id: the same for the same person from image to image.
        layout: name of the joint map that names the joints: ``mediapipe33`` or ``coco17``.
        pixels: (J, 2) x to the right, y down, in pixels of the full image; NaN where not found.
        visibility: (J,) probability that the joint is visible, 0..1.
        world: (J, 3) metres around the middle of the hips, in the camera's axes (x right, y down, z
            away from it); None for a network that finds pixels only.
    """

    id: int
    layout: str
    pixels: Floats
    visibility: Floats
    world: Floats | None
