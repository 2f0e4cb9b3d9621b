"""Common parts of depth cameras, which are read through their makers' packages."""

import contextlib
import importlib
import time
from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.seen import Float32, Image
from hri_predict.base.errors import ConfigError, SourceError

TIMEOUT_MS = 1000
DEFAULT_HZ = 30.0
MAX_AGE_S = 1.0
FACTORY_FOCAL_ERROR = 0.01
"""99 % bound of the error of the factory's intrinsics, as a share of the focal length."""


class DepthCamera(ABC):
    """An ``Input`` whose images have depth, aligned with the colours.

    A lost device is reopened. A subclass provides ``_open``, ``_take`` and ``_stop``; an error that
    the maker's package raises in them is an interruption.

    Args:
        rate_hz: images per second; None: 30.
        size: width and height of the images.
        package: the maker's package; None: import it.

    Attributes:
        camera: the factory's intrinsics of the colour image.

    Raises:
        ConfigError: the package is missing, or no device delivers such images.
    """

    waits = False
    name: ClassVar[str]
    module: ClassVar[str]
    """Name under which the maker's package is imported and installed."""
    stamps = "the device's time stamps"
    stamped = "by the device"
    metres_per_unit = 0.001
    stereo_error = 0.0
    """See ``Image``."""
    _is_open = False

    def __init__(
        self, *, rate_hz: float | None, size: tuple[int, int], package: Any = None
    ) -> None:
        self._package = self._imported() if package is None else package
        self._rate_hz, self._size = rate_hz or DEFAULT_HZ, size
        self._number = 0
        try:
            self.camera = self._start()
        except SourceError as error:
            raise ConfigError(
                f"{error}; is it plugged into USB 3, and not in use by another program?"
            ) from None

    def read(self) -> Image | None:
        """See ``Input``."""
        if not self._is_open:
            self._start()
        try:
            pixels, raw, exposed_ns = self._take()
        except self._errors() as error:
            self.close()
            raise SourceError(f"{self.name}: it delivers no image ({_said(error)})") from None
        self._number += 1
        metres: Float32 = raw.astype(np.float32) * np.float32(self.metres_per_unit)
        metres[raw == 0] = np.nan
        return Image(
            np.array(pixels, np.uint8), exposed_ns, self._number, metres, self.stamped,
            self.stereo_error,
        )  # fmt: skip

    def close(self) -> None:
        """See ``Input``."""
        if self._is_open:
            self._is_open = False
            with contextlib.suppress(*self._errors()):
                self._stop()

    def _start(self) -> Camera:
        width, height = self._size
        errors: tuple[type[Exception], ...] = (SourceError, *self._errors())
        self._is_open = True
        try:
            return self._open()
        except errors as error:
            self.close()
            raise SourceError(
                f"{self.name}: no device gives {width} x {height} at {self._rate_hz:g} Hz "
                f"({_said(error)})"
            ) from None

    def _errors(self) -> tuple[type[Exception], ...]:
        """Return the classes of the package's errors."""
        return (RuntimeError,)

    @abstractmethod
    def _open(self) -> Camera:
        """Open the device, and return the intrinsics of its colour image."""

    @abstractmethod
    def _take(self) -> tuple[Any, Any, int]:
        """Return pixels (H, W, 3) BGR, depth (H, W), 0 where not known, and the exposure's time.

        Raises:
            SourceError: this image cannot be used.
        """

    @abstractmethod
    def _stop(self) -> None:
        """Close the device, even if it was only partly opened."""

    def _recent(self, exposed_ns: int) -> int:
        """Return the time of an exposure, by ``time.monotonic_ns``, if it is plausible.

        Raises:
            SourceError: a clock is wrong, or the image is too old; the device is opened again.
        """
        age_s = (time.monotonic_ns() - exposed_ns) / 1e9
        if not 0 <= age_s <= MAX_AGE_S:
            self.close()
            raise SourceError(f"{self.name}: dropped an image that is {age_s:.1f} s old")
        return exposed_ns

    def _imported(self) -> Any:
        try:
            return importlib.import_module(self.module)
        except ImportError as error:
            raise ConfigError(
                f"{self.name}: needs a package that cannot be loaded ({error}); "
                f"install it with: pip install {self.module}"
            ) from None


def factory_camera(matrix: Any, size: tuple[int, int], distortion: Any) -> Camera:
    """Return the camera with the intrinsics that the factory measured."""
    return Camera(
        matrix=np.array(matrix, np.float64),
        size=size,
        distortion=np.array(distortion, np.float64),
        focal_error=FACTORY_FOCAL_ERROR,
    )


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__
