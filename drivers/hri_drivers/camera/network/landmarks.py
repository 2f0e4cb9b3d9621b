"""BlazePose's landmark network: its outputs as joints of the image.

After MediaPipe's graphs ``modules/pose_landmark/tensors_to_pose_landmarks_and_segmentation.pbtxt``
and ``pose_landmarks_and_segmentation_inverse_projection.pbtxt`` (Apache-2.0). Landmarks 0 to 32 are
the joints of the map ``mediapipe33``; 33 and 34 place the next square (``roi.around``).
"""

from dataclasses import dataclass

import numpy as np

from hri_drivers.camera.network.found import Found, logistic, without_outside
from hri_drivers.camera.network.roi import Roi, around
from hri_drivers.camera.seen import Float32, UInt8
from hri_predict.base.arrays import Floats

SIDE = 256
POINTS, JOINTS = 39, 33
HIPS, CIRCLE = 33, 34
MIN_PRESENCE = 0.5
KERNEL, MIN_CONFIDENCE = 7, 0.5
"""``RefineLandmarksFromHeatmapCalculatorOptions``: kernel_size, min_confidence_to_refine."""


@dataclass(frozen=True, slots=True, eq=False)
class Outputs:
    """The outputs of the network that are used.

    Attributes:
        points: (39, 5) x, y, z in pixels of the square, raw visibility, raw presence.
        presence: 0..1, that the square shows a person.
        heatmap: (64, 64, 39) raw.
        world: (39, 3) metres around the hips, in the square's axes.
    """

    points: Floats
    presence: float
    heatmap: Floats
    world: Floats

    @classmethod
    def of(cls, tensors: list[Float32]) -> "Outputs":
        """Sort out a network's outputs by their sizes.

        Raises:
            KeyError: one of them is missing.
        """
        by_size = {tensor.size: np.asarray(tensor, np.float64) for tensor in tensors}
        return cls(
            points=by_size[POINTS * 5].reshape(POINTS, 5),
            presence=float(by_size[1].reshape(())),
            heatmap=by_size[64 * 64 * POINTS].reshape(64, 64, POINTS),
            world=by_size[POINTS * 3].reshape(POINTS, 3),
        )


def decode(outputs: Outputs, roi: Roi, picture: UInt8) -> tuple[Found, Roi] | None:
    """Return the person in a square, and the square for the next image.

    Args:
        outputs: outputs of the network.
        roi: the square that was the network's input.
        picture: (H, W, 3) that contains the square.

    Returns:
        None if no person is there, or the landmarks cannot be those of a body.
    """
    if not outputs.presence >= MIN_PRESENCE:  # NaN, too
        return None
    if not (np.isfinite(outputs.points).all() and np.isfinite(outputs.world).all()):
        return None
    places = roi.in_picture(refined(outputs.points[:, :2] / SIDE, outputs.heatmap))
    onward = around(places[HIPS], places[CIRCLE], picture)
    if onward is None:
        return None
    sure = logistic(outputs.points[:JOINTS, 3:])
    visibility = sure.min(axis=1)  # visible, and inside the square
    world = outputs.world[:JOINTS].copy()
    world[:, :2] = world[:, :2] @ roi.turn.T
    pixels = without_outside(places[:JOINTS], visibility, picture)
    return Found(pixels, visibility, world, min(1.0, outputs.presence)), onward


def refined(points: Floats, heatmap: Floats) -> Floats:
    """Return points moved to the centroid of the heat map around each.

    Args:
        points: (39, 2) in 0..1 of the square.
        heatmap: (64, 64, 39) raw.
    """
    height, width, _ = heatmap.shape
    result = points.copy()
    reach = (KERNEL - 1) // 2
    for k, (x, y) in enumerate(points):
        column, row = int(x * width), int(y * height)
        if not (0 <= column < width and 0 <= row < height):
            continue
        left, top = max(0, column - reach), max(0, row - reach)
        near = logistic(heatmap[top : row + reach + 1, left : column + reach + 1, k])
        if near.max() < MIN_CONFIDENCE:
            continue
        total = near.sum()
        result[k, 0] = near.sum(axis=0) @ np.arange(left, left + near.shape[1]) / total / width
        result[k, 1] = near.sum(axis=1) @ np.arange(top, top + near.shape[0]) / total / height
    return result
