"""Places the people of an image for the node's scene stream: in metres, in the camera's axes.

It uses the image's depth if available, otherwise the network's landmarks in metres.
"""

from collections import Counter

import numpy as np

from hri_drivers.camera.place.alone import check_height, place_alone
from hri_drivers.camera.place.by_depth import place_by_depth
from hri_drivers.camera.place.camera import Camera, guessed_camera
from hri_drivers.camera.place.placed import Unplaced
from hri_drivers.camera.seen import Image, Seen
from hri_drivers.sources.sent import SentPerson


class Placer:
    """Places the people of one camera.

    Args:
        camera: the calibrated camera; None: guessed from the field of view.
        field_of_view_deg: field of view, along the longer side of the images, of an uncalibrated
            camera; None: as for most webcams.
        height_m: stature of everyone who is seen; None: an adult's.

    Attributes:
        unplaced: number of people in scenes whose position was not known, by reason.

    Raises:
        ConfigError: a field of view or a height is out of range.
    """

    def __init__(
        self,
        camera: Camera | None = None,
        field_of_view_deg: float | None = None,
        height_m: float | None = None,
    ) -> None:
        check_height(height_m)
        guessed_camera(64, 64, field_of_view_deg)  # a mistake shows now
        self._given, self._view, self._height_m = camera, field_of_view_deg, height_m
        self._camera: Camera | None = None
        self.unplaced: Counter[str] = Counter()

    def calibrate(self, camera: Camera) -> None:
        """Use the intrinsics that a device reports."""
        self._given, self._camera = camera, None

    def place(self, seen: Seen, image: Image) -> SentPerson:
        """Return a person in metres, without observed joints if the position is not known.

        Raises:
            ConfigError: the camera was calibrated with images of another shape, the depth has
                another size than the image, or there is neither depth nor landmarks in metres.
        """
        camera = self._of(image)
        if image.depth is None:
            placed = place_alone(seen, camera, self._height_m)
        else:
            placed = place_by_depth(seen, image.depth, camera, image.stereo_error)
        if isinstance(placed, Unplaced):
            self.unplaced[placed.why] += 1
            nowhere = np.full((len(seen.pixels), 3), np.nan)
            return SentPerson(seen.id, nowhere, np.zeros(len(nowhere), np.bool_))
        return SentPerson(seen.id, placed.positions, placed.observed, placed.error_m)

    def _of(self, image: Image) -> Camera:
        height, width = image.pixels.shape[:2]
        if self._camera is None or self._camera.size != (width, height):
            guess = guessed_camera(width, height, self._view)
            self._camera = guess if self._given is None else self._given.of_size(width, height)
        return self._camera
