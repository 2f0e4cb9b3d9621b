"""Reads a picture's file, and survives any other one."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.errors import ConfigError

MAX_BYTES = 200_000_000


def read_picture(path: Path, flags: int) -> NDArray[np.generic] | None:
    """Return a picture as ``cv2.imdecode`` gives it by ``flags``; None if the file is not one.

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
    except (cv2.error, OSError):  # an empty file, or a size that no picture has
        return None
    return None if data is None else np.asarray(data)
