"""BlazePose (MediaPipe Pose): a detector finds people, then landmarks follow each person.

The landmarks give the person's square in the next image. The detector runs when a person was lost
or no person is followed, and every few images to find new people.

V. Bazarevsky et al., "BlazePose: On-device Real-time Body Pose Tracking", arXiv:2006.10204; I.
Grishchenko et al., "BlazePose GHUM Holistic", arXiv:2206.11678.
"""

import cv2
import numpy as np

from hri_drivers.camera.network import detector, landmarks
from hri_drivers.camera.network.found import Finding, Found, distinct
from hri_drivers.camera.network.roi import Roi, around, whole
from hri_drivers.camera.network.runtime import Net
from hri_drivers.camera.seen import UInt8
from hri_predict.base.errors import ConfigError

MAX_PEOPLE = 4
DETECT_EVERY = 3
"""Number of images between two runs of the detector while all people are followed."""
SAME_PLACE, SAME_SIZE = 0.15, 0.5
"""Two squares show one person if their hips are closer than the first fraction of the smaller
square's side, and that side is at least the second fraction of the larger one. Otherwise a second
person stands in front or behind."""

_Followed = tuple[Found, Roi]


class BlazePose:
    """A ``Finder``.

    Args:
        detector_net: network of ``pose_detection.tflite``.
        landmark_net: network of ``pose_landmark_*.tflite``.
        people: maximum number of people.

    Raises:
        ConfigError: the networks have other shapes.
    """

    layout = "mediapipe33"

    def __init__(self, detector_net: Net, landmark_net: Net, people: int = MAX_PEOPLE) -> None:
        for net, side in ((detector_net, detector.SIDE), (landmark_net, landmarks.SIDE)):
            if net.shape != (1, side, side, 3):
                raise ConfigError(
                    f"model: a network takes {net.shape}, expected (1, {side}, {side}, 3); give "
                    f"the package of --fetch-model"
                )
        self._detector, self._landmarks = detector_net, landmark_net
        self._people = people
        self._squares: list[Roi] = []
        self._since = DETECT_EVERY
        self._is_whole = True
        try:  # a mistake shows now
            nothing = np.zeros((detector.SIDE, detector.SIDE, 3), np.uint8)
            self._newcomers(nothing, [])
            self._look(nothing, whole(nothing))
        except (KeyError, ValueError) as error:
            raise ConfigError(
                f"model: the networks have other outputs than BlazePose's ({error}); give the "
                f"package of --fetch-model"
            ) from error

    def find(self, pixels: UInt8) -> Finding:
        """See ``Finder``."""
        followed = [f for roi in self._squares if (f := self._look(pixels, roi)) is not None]
        self._since += 1
        lost = len(followed) < len(self._squares)
        if lost or not followed or self._since >= DETECT_EVERY:
            followed += self._newcomers(pixels, [roi for _, roi in followed])
            self._since = 0
        squares = {id(found): roi for found, roi in followed}
        people = distinct([found for found, _ in followed])
        if len(people) > self._people:
            self._is_whole, people = False, people[: self._people]
        self._squares = [squares[id(found)] for found in people]
        return Finding(tuple(people), self._is_whole)

    def _look(self, pixels: UInt8, roi: Roi) -> _Followed | None:
        tensor = _tensor(roi.crop(pixels, landmarks.SIDE))
        outputs = landmarks.Outputs.of(self._landmarks.run(tensor))
        return landmarks.decode(outputs, roi, pixels)

    def _newcomers(self, pixels: UInt8, known: list[Roi]) -> list[_Followed]:
        """Return people who are not followed yet, at most one more than there is room for."""
        square = whole(pixels)
        tensor = 2.0 * _tensor(square.crop(pixels, detector.SIDE)) - 1.0
        boxes, scores = sorted(self._detector.run(tensor), key=lambda each: -each.size)
        self._is_whole = True
        found: list[_Followed] = []
        for each in detector.decode(boxes, scores):
            hips, edge = square.in_picture(each.points[[detector.HIPS, detector.CIRCLE]])
            roi = around(hips, edge, pixels)
            if roi is None or any(_same(roi, other) for other in known):
                continue
            if len(known) > self._people:
                self._is_whole = False  # even if two of them turn out to be one person
                break  # there are more than enough; the rest would only take time
            person = self._look(pixels, roi)
            if person is not None:
                found.append(person)
                known = [*known, roi]
        return found


def _same(a: Roi, b: Roi) -> bool:
    small, large = sorted((a.size, b.size))
    apart = np.hypot(a.x - b.x, a.y - b.y)
    return bool(apart < SAME_PLACE * small and small >= SAME_SIZE * large)


def _tensor(crop: UInt8) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Return a crop, BGR, as the networks expect it: (1, S, S, 3) RGB in 0..1."""
    rgb = np.asarray(cv2.cvtColor(crop, cv2.COLOR_BGR2RGB), np.float32)
    return rgb[np.newaxis] / np.float32(255)
