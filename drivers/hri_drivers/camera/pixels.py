"""Reads pixels from a file or a ``cv2.VideoCapture``, and refuses all other content."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hri_drivers.camera.seen import UInt8
from hri_predict.base.errors import ConfigError, SourceError

MAX_BYTES = 200_000_000
MIN_SIDE, MAX_SIDE = 64, 8192


def read_picture(path: Path, flags: int) -> NDArray[np.generic] | None:
    """Return an image decoded by ``cv2.imdecode`` with ``flags``; None if the file is not an image.

    Raises:
        ConfigError: the file does not exist.
    """
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # our errors name a remedy
    if not path.is_file():
        raise ConfigError(f"{path}: no such file; check the path")
    try:
        if path.stat().st_size > MAX_BYTES:
            return None
        data = cv2.imdecode(np.fromfile(path, np.uint8), flags)
    except (cv2.error, OSError):  # an empty file, or a size that no image has
        return None
    return None if data is None else np.asarray(data)


def next_of(device: Any) -> Any:
    """Return the next image of a ``cv2.VideoCapture``; None if there is none."""
    import cv2

    try:
        came, pixels = device.read()
    except cv2.error:  # of an image that it cannot convert
        return None
    return pixels if came else None


def checked(pixels: Any, where: str) -> UInt8:
    """Return pixels as bytes (H, W, 3).

    Raises:
        SourceError: the pixels are of another kind, or the image is too small or too large.
    """
    array = np.asarray(pixels)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype != np.uint8:
        raise SourceError(f"{where}: not a colour image with 8 bits for each channel")
    height, width = array.shape[:2]
    if min(height, width) < MIN_SIDE or max(height, width) > MAX_SIDE:
        raise SourceError(
            f"{where}: {width} x {height} pixels; expected {MIN_SIDE} to {MAX_SIDE} on each side"
        )
    return array
