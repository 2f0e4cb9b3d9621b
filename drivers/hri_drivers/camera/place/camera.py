"""A camera's geometry: intrinsics, distortion and its pose in the room, and its file.

A camera's own axes are x to the right, y down, z away from it. Its pose in the room,
``room_from_source``, uses the axes of REP-103 (x away from it, y left, z up), as for every other
source.

The distortion is OpenCV's: k1, k2, p1, p2, k3, k4, k5, k6 (OpenCV documentation, "Camera
Calibration and 3D Reconstruction").
"""

import math
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import yaml
from pydantic import Field

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write, read_yaml
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.base.settings import Pose, Settings, validated

FIELD_OF_VIEW_DEG = 64.0
"""Field of view assumed for an unknown webcam, along the longer side of its images. Data sheets
give 50 to 80 degrees for most webcams and laptops; the focal length at 64 degrees is the geometric
mean of those at 50 and 80."""
GUESSED_FOCAL_ERROR = 0.36
"""The focal length for 50 degrees is 34 % larger than for 64, for 80 degrees 26 % smaller."""
STATED_FOCAL_ERROR = 0.06
"""For a horizontal angle from a data sheet, which may be wrong by 3 degrees at 70."""
WIDE = 16 / 9
"""Shape of the images to which data sheets refer. A webcam makes narrower images by cutting off
the sides of these: 70 degrees become 55 at 4:3, a focal length that is 33 % larger."""
MIN_VIEW_DEG, MAX_VIEW_DEG = 10.0, 120.0  # a wider lens needs the model of a fisheye
OPTICAL_FROM_REP103 = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""(3, 3) from x forward, y left, z up to the camera's own axes."""
_UNDISTORTED_WITHIN = 1e-6
_ROUNDS = 50


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Camera:
    """A pinhole camera with distortion.

    Attributes:
        matrix: (3, 3) intrinsics, pixels.
        size: image width and height, in pixels, for which ``matrix`` holds.
        distortion: (5,) k1, k2, p1, p2, k3; or (8,), with k4, k5, k6.
        focal_error: the focal length is known within this fraction, in 99 % of cameras.
        pose: pose in the room of the camera's REP-103 axes; None if not known.
    """

    matrix: Floats
    size: tuple[int, int]
    distortion: Floats = field(default_factory=lambda: np.zeros(5))
    focal_error: float = GUESSED_FOCAL_ERROR
    pose: Pose | None = None

    @property
    def field_of_view_deg(self) -> float:
        """Horizontal field of view, degrees, without the distortion."""
        return 2 * math.degrees(math.atan(self.size[0] / 2 / float(self.matrix[0, 0])))

    def rays(self, pixels: Floats) -> Floats:
        """Return (..., 2): x / z and y / z of the rays through ``pixels`` (..., 2).

        NaN for a pixel that is not in the image, or for which the distortion has no inverse.
        """
        pixels = np.where(self.inside(pixels)[..., None], pixels, np.nan)
        distorted = (pixels - self.matrix[:2, 2]) / self.matrix[[0, 1], [0, 1]]
        if not self.distortion.any():
            return distorted
        ideal = distorted
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(_ROUNDS):
                off = distorted - _distort(ideal, self.distortion)
                if not (np.abs(off) > _UNDISTORTED_WITHIN / 100).any():
                    break
                ideal = ideal + off
            wrong = np.abs(_distort(ideal, self.distortion) - distorted).max(axis=-1)
        return np.where((wrong < _UNDISTORTED_WITHIN)[..., None], ideal, np.nan)

    def project(self, points: Floats) -> Floats:
        """Return the pixels (..., 2) of ``points`` (..., 3), camera axes; NaN if not in front."""
        depth = np.where(points[..., 2:] > 1e-6, points[..., 2:], np.nan)
        flat = _distort(points[..., :2] / depth, self.distortion)
        pixels: Floats = flat * self.matrix[[0, 1], [0, 1]] + self.matrix[:2, 2]
        return pixels

    def inside(self, pixels: Floats) -> Bools:
        """Return (...,) which ``pixels`` (..., 2) are in the image; false for NaN."""
        return np.asarray(((pixels >= 0) & (pixels <= np.asarray(self.size) - 1)).all(axis=-1))

    def of_size(self, width: int, height: int) -> "Camera":
        """Return the camera for images of another size, which must have the same shape.

        Raises:
            ConfigError: images of another shape are cropped in an unknown way.
        """
        scale = width / self.size[0]
        if abs(height - scale * self.size[1]) > 1.0:
            raise ConfigError(
                f"the camera was calibrated with images of {self.size[0]} x {self.size[1]}, and "
                f"these are {width} x {height}: use images of {self.size[0]} x {self.size[1]} or "
                f"of the same shape, or calibrate again with images of this size"
            )
        matrix = self.matrix.copy()
        matrix[:2, 2] = (matrix[:2, 2] + 0.5) * scale - 0.5  # pixel centres are whole numbers
        matrix[[0, 1], [0, 1]] *= scale
        return replace(self, matrix=matrix, size=(width, height))

    def room_from_optical(self) -> Floats:
        """Return (4, 4) from the camera's own axes to the room.

        Raises:
            ConfigError: the camera has no pose.
        """
        if self.pose is None:
            raise ConfigError(
                "the camera has no pose in the room; find it with 'hri-predict camera-calibration "
                "pose'"
            )
        matrix: Floats = self.pose.matrix()
        matrix[:3, :3] = matrix[:3, :3] @ OPTICAL_FROM_REP103.T
        return matrix


def guessed_camera(width: int, height: int, field_of_view_deg: float | None = None) -> Camera:
    """Return a camera without distortion with this field of view; None: not known.

    It is the angle of the longer side: a portrait image is that of a camera turned on its side. A
    stated field of view may be that of a data sheet, so its error is larger if images narrower
    than 16:9 may lack the sides.

    Raises:
        ConfigError: the field of view is outside the range of this camera model.
    """
    degrees = FIELD_OF_VIEW_DEG if field_of_view_deg is None else field_of_view_deg
    if not MIN_VIEW_DEG <= degrees <= MAX_VIEW_DEG:
        raise ConfigError(
            f"field of view: must be {MIN_VIEW_DEG:g} to {MAX_VIEW_DEG:g} degrees; got {degrees:g}"
        )
    longer, shorter = max(width, height), min(width, height)
    focal = longer / 2 / math.tan(math.radians(degrees) / 2)
    middle = (width - 1) / 2, (height - 1) / 2
    cut = max(1.0, WIDE * shorter / longer)
    stated_error = (1 + STATED_FOCAL_ERROR) * cut - 1
    return Camera(
        matrix=np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]]),
        size=(width, height),
        focal_error=GUESSED_FOCAL_ERROR if field_of_view_deg is None else stated_error,
    )


class CameraFile(Settings):
    """A camera file, as ``hri-predict camera-calibration`` writes it."""

    width: int = Field(ge=16, le=16384, description="size of the images, pixels")
    height: int = Field(ge=16, le=16384, description="size of the images, pixels")
    focal: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        description="focal length, horizontal and vertical, pixels"
    )
    centre: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        description="where the optical axis meets the image, pixels"
    )
    distortion: Annotated[
        list[Annotated[float, Field(ge=-100, le=100)]], Field(min_length=5, max_length=5)
    ] = Field([0.0] * 5, description="k1, k2, p1, p2, k3 as OpenCV has them")
    focal_error: float = Field(
        GUESSED_FOCAL_ERROR,
        gt=0,
        le=1,
        description="99 % bound of the focal length's error, as a fraction",
    )
    room_from_source: Pose | None = Field(None, description="pose of the camera in the room")

    safety: ClassVar[Safety] = harmless("width", "height", "focal_error")

    def camera(self) -> Camera:
        """Return the camera that these settings describe.

        Raises:
            ValueError: no camera has such a focal length or centre.
        """
        narrow, wide = (
            self.width / 2 / math.tan(math.radians(v) / 2) for v in (MIN_VIEW_DEG, MAX_VIEW_DEG)
        )
        for value in self.focal:
            if not wide <= value <= narrow:
                raise ValueError(
                    f"focal: {value:g} is not {wide:.0f} to {narrow:.0f} pixels, a field of view "
                    f"of {MAX_VIEW_DEG:g} to {MIN_VIEW_DEG:g} degrees; calibrate again"
                )
        if not (0 <= self.centre[0] < self.width and 0 <= self.centre[1] < self.height):
            raise ValueError("centre: lies outside the image; calibrate again")
        (fx, fy), (cx, cy) = self.focal, self.centre
        return Camera(
            matrix=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
            size=(self.width, self.height),
            distortion=np.array(self.distortion),
            focal_error=self.focal_error,
            pose=self.room_from_source,
        )


def read_camera(path: Path) -> Camera:
    """Read a camera file.

    Raises:
        ConfigError: the file is missing or wrong; one line names the key.
    """
    data = read_yaml(path, "camera")
    try:
        return validated(CameraFile, data, f"camera {path}").camera()
    except ValueError as error:
        raise ConfigError(f"camera {path}: {error}") from None


def refuse_other_file(path: Path) -> None:
    """Fail if the file exists and is not a camera file, such as a node's configuration.

    Raises:
        ConfigError: it does.
    """
    if not os.path.lexists(path):
        return
    try:
        read_camera(path)
    except ConfigError:
        raise ConfigError(
            f"{path}: exists and is not a camera file; name another file with --out"
        ) from None


def write_camera(path: Path, camera: Camera) -> None:
    """Write a camera file.

    Raises:
        ConfigError: the file cannot be written.
    """
    data = {
        "width": camera.size[0],
        "height": camera.size[1],
        "focal": [round(float(camera.matrix[i, i]), 3) for i in (0, 1)],
        "centre": [round(float(v), 3) for v in camera.matrix[:2, 2]],
        "distortion": [round(float(v), 6) for v in camera.distortion],
        "focal_error": round(camera.focal_error, 5),
    }
    if camera.pose is not None:
        data["room_from_source"] = camera.pose.model_dump()
    text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None)
    with OsErrorAs(ConfigError, f"cannot write {path}"):
        atomic_write(path, text.encode())


def _distort(ideal: Floats, distortion: Floats) -> Floats:
    """Distort (..., 2) ideal x / z and y / z."""
    k1, k2, p1, p2, k3, *below = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    if below:
        k4, k5, k6 = below
        radial = radial / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
