"""Detects from the background whether a camera was moved since the start.

Points of the background are found in the first image and again now (ORB: E. Rublee et al., "ORB:
an efficient alternative to SIFT or SURF", ICCV 2011), and a shift, turn and scale that most of them
agree on is fitted (RANSAC). Points on people are ignored. If both images have many points that do
not agree, the camera looks elsewhere, or something large hides the background. If there are few
points, the background has no texture and nothing can be decided.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.seen import Image, UInt8
from hri_predict.base.arrays import Floats

TURNED = math.radians(0.9)
"""Maximum turn: about the line of sight, or aside, as the mean displacement of the image's corners
divided by the focal length. It includes what a camera shows that was shifted instead."""
CHECK_NS = 500_000_000
IN_A_ROW = 3
"""Checks that must agree before the verdict changes."""
MIN_POINTS, MIN_SHARE = 15, 0.3
"""Minimum number of points that must agree, and minimum fraction of the points found again."""
MANY_POINTS = 100
"""With this many points in both images, some must agree if the background is the same."""
_WIDTH, _POINTS, _MISFIT = 480, 600, 3.0
_AROUND = 0.25  # of a person's size: hair, clothes and shadows beyond the joints
_Points = tuple[Floats, UInt8]
"""(N, 2) positions in image widths, and (N, 32) descriptors of what is around them."""
WHY = (
    "the background has changed since the start: the camera was moved, and people's positions "
    "are wrong, or something large blocks the view; restore the camera or the view, or calibrate "
    "the camera's pose again and restart"
)


class MovedWatch:
    """Compares the background with that of the first image, twice a second.

    Args:
        camera: the camera of the images, whose size may differ.

    Attributes:
        checks: number of comparisons.
        undecided: number of comparisons with too few points, in which a move goes undetected.
    """

    def __init__(self, camera: Camera) -> None:
        self._focal = float(camera.matrix[0, 0]) / camera.size[0]  # in image widths
        self._orb = cv2.ORB.create(_POINTS)
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
        self._first: _Points | None = None
        self._due_ns: int | None = None
        self._moved, self._others = False, 0
        self.checks = self.undecided = 0

    def judge(self, image: Image, people: Sequence[Floats]) -> str | None:
        """Return the fault as readable text; None: no fault, or undecided.

        Args:
            image: the current image.
            people: (J, 2) pixels of each person in it; NaN where not found.
        """
        if self._due_ns is None or image.exposed_ns >= self._due_ns:
            self._due_ns = image.exposed_ns + CHECK_NS
            moved = self._looks_moved(image.pixels, people)
            self.checks += 1
            if moved is None:
                self.undecided += 1
            else:
                self._others = self._others + 1 if moved != self._moved else 0
                if self._others == IN_A_ROW:
                    self._moved, self._others = moved, 0
        return WHY if self._moved else None

    def summary(self) -> dict[str, int]:
        """Return the counts for the user."""
        return {"checks": self.checks, "undecided": self.undecided}

    def _looks_moved(self, pixels: UInt8, people: Sequence[Floats]) -> bool | None:
        """Whether the background has moved since the first image; None if undecided."""
        now = self._background(pixels, people)
        if len(now[0]) < MIN_POINTS:
            return None
        if self._first is None:
            self._first = now
            return False
        way = self._way(self._first, now, pixels.shape[0] / pixels.shape[1])
        if way is None:
            return True if min(len(self._first[0]), len(now[0])) >= MANY_POINTS else None
        return way > TURNED

    def _way(self, first: _Points, now: _Points, ratio: float) -> float | None:
        """Return the turn of the camera, in radians; None if too few points agree.

        Args:
            first, now: the points at first and now.
            ratio: the image's height divided by its width.
        """
        pairs = self._matcher.match(first[1], now[1])
        if len(pairs) < MIN_POINTS:
            return None
        a = np.array([first[0][pair.queryIdx] for pair in pairs], np.float32)
        b = np.array([now[0][pair.trainIdx] for pair in pairs], np.float32)
        fitted, agree = cv2.estimateAffinePartial2D(a, b, ransacReprojThreshold=_MISFIT)
        if fitted is None or int(agree.sum()) < max(MIN_POINTS, MIN_SHARE * len(pairs)):
            return None
        corners = _WIDTH * np.array([[0, 0], [1, 0], [0, ratio], [1, ratio]])
        ways = corners @ fitted[:, :2].T + fitted[:, 2] - corners
        aside = float(np.linalg.norm(ways, axis=1).mean()) / (_WIDTH * self._focal)
        return max(aside, abs(math.atan2(fitted[1, 0], fitted[0, 0])))

    def _background(self, pixels: UInt8, people: Sequence[Floats]) -> _Points:
        """Return the points of the background."""
        scale = _WIDTH / pixels.shape[1]
        size = _WIDTH, round(scale * pixels.shape[0])
        small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
        counts = np.full(size[::-1], 255, np.uint8)
        for joints in people:
            inside = scale * joints[np.isfinite(joints).all(axis=1)]
            if len(inside):
                low, high = inside.min(axis=0), inside.max(axis=0)
                margin = _AROUND * float((high - low).max())
                x0, y0 = np.clip(low - margin, 0, size).astype(int)
                x1, y1 = np.clip(high + margin, 0, size).astype(int)
                counts[y0:y1, x0:x1] = 0
        grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
        points, found = self._orb.detectAndCompute(grey, counts)
        places = np.array([point.pt for point in points], np.float64).reshape(-1, 2)
        none = np.zeros((0, 32), np.uint8)
        return places, none if found is None else np.asarray(found, np.uint8)
