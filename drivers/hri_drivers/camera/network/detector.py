"""BlazePose's detector: 2254 anchors, each with a box, four key points and a score.

The numbers are those of MediaPipe's graph ``modules/pose_detection/pose_detection_cpu.pbtxt``
(Apache-2.0): ``SsdAnchorsCalculatorOptions``, ``TensorsToDetectionsCalculatorOptions`` and
``NonMaxSuppressionCalculatorOptions``.
"""

from dataclasses import dataclass

import numpy as np

from hri_drivers.camera.network.found import logistic
from hri_drivers.camera.seen import Float32
from hri_predict.base.arrays import Floats

SIDE = 224
STRIDES = (8, 16, 32, 32, 32)
PER_CELL = 2
"""One anchor for aspect ratio 1.0, one for ``interpolated_scale_aspect_ratio``; all of fixed
size."""
MIN_SCORE, MIN_OVERLAP = 0.3, 0.3
"""The graph uses a minimum score of 0.5. Here a missed person is worse than an extra run of the
landmark network, which makes the decision: a photographer in profile has a score of 0.46 and a
presence of 0.97.
"""
MAX_CANDIDATES, MAX_PIXELS = 200, 1e4
"""Maximum number of anchors used, the most confident ones (about ten show each person); and maximum
distance in pixels of a valid point from its anchor."""
HIPS, CIRCLE = 0, 1
"""Key points: middle of the hips, and a point on the circle around the whole body."""


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One detected person, in 0..1 of the detector's square image.

    Attributes:
        box: (4,) left, top, right, bottom, of the face.
        points: (4, 2) key points.
        score: 0..1.
    """

    box: Floats
    points: Floats
    score: float


def anchors() -> Floats:
    """Return (2254, 2) centres of the anchors, in 0..1, in the order of the network's output."""
    rows = []
    for stride in sorted(set(STRIDES)):
        cells = SIDE // stride
        per_cell = PER_CELL * STRIDES.count(stride)
        centres = (np.arange(cells) + 0.5) / cells
        y, x = np.meshgrid(centres, centres, indexing="ij")
        grid = np.stack([x, y], axis=-1).reshape(-1, 2)
        rows.append(np.repeat(grid, per_cell, axis=0))
    return np.concatenate(rows)


ANCHORS = anchors()


def decode(boxes: Float32, scores: Float32) -> list[Detection]:
    """Return the people that the network's output shows, most confident first.

    Args:
        boxes: (1, 2254, 12) centre, size and four key points, in pixels from the anchor.
        scores: (1, 2254, 1) raw scores.
    """
    with np.errstate(invalid="ignore"):  # NaN of some kinds
        sure = logistic(scores.astype(np.float64).reshape(-1))
        raw = boxes.astype(np.float64).reshape(len(ANCHORS), 12)
    likely = np.flatnonzero((sure >= MIN_SCORE) & (np.abs(raw) <= MAX_PIXELS).all(axis=1))
    likely = likely[np.argsort(-sure[likely], kind="stable")][:MAX_CANDIDATES]
    raw, centres = raw[likely] / SIDE, ANCHORS[likely]
    middle, half = raw[:, :2] + centres, raw[:, 2:4] / 2
    corners = np.concatenate([middle - half, middle + half], axis=1)
    points = raw[:, 4:].reshape(-1, 4, 2) + centres[:, np.newaxis]
    return _blended(corners, points, sure[likely])


def _blended(boxes: Floats, points: Floats, scores: Floats) -> list[Detection]:
    """Return weighted means of detections that overlap the most confident one, then of the rest."""
    found = []
    rest = np.argsort(-scores, kind="stable")
    while rest.size:
        overlap = _overlap(boxes[rest[0]], boxes[rest])
        overlap[0] = 1.0  # of an empty box, too
        same, rest = rest[overlap > MIN_OVERLAP], rest[overlap <= MIN_OVERLAP]
        weights = scores[same] / scores[same].sum()
        found.append(
            Detection(
                weights @ boxes[same],
                np.tensordot(weights, points[same], 1),
                float(scores[same[0]]),
            )
        )
    return found


def _overlap(box: Floats, others: Floats) -> Floats:
    """Return the intersection over union of a box (4,) and others (N, 4)."""
    low = np.maximum(box[:2], others[:, :2])
    high = np.minimum(box[2:], others[:, 2:])
    common = np.prod(np.clip(high - low, 0.0, None), axis=1)
    areas = np.prod(np.clip(others[:, 2:] - others[:, :2], 0.0, None), axis=1)
    area = float(np.prod(np.clip(box[2:] - box[:2], 0.0, None)))
    union = areas + area - common
    return np.divide(common, union, out=np.zeros_like(common), where=union > 0)
