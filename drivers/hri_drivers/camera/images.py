"""Images from a webcam, a video file or image files, each with its time of exposure.

No input opens a network connection: addresses are refused, and FFmpeg may read files only.
"""

import math
import os
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Protocol

from hri_drivers.camera.pixels import checked, next_of, read_picture
from hri_drivers.camera.place.by_depth import read_depth
from hri_drivers.camera.seen import Image, UInt8
from hri_drivers.camera.webcam import Webcam, is_device
from hri_predict.base.errors import ConfigError, SourceError

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
DEPTH_CAMERAS = {"realsense": "RealSense", "oak": "Oak", "kinect": "Kinect"}
"""Modules of this folder, and their classes."""
DEPTH = ".depth.png"
"""NAME.depth.png has the depth of NAME.png in the same folder: aligned, 16 bits, millimetres."""
DEFAULT_HZ = 30.0
MAX_STEP_S = 10.0
"""Maximum time between two images of a video; a larger step is an error in its times."""


class Input(Protocol):
    """Delivers images to one thread.

    Attributes:
        waits: whether the input keeps an image until it is read; a camera does not.
        stamps: how the time of the exposure is known, as readable text.
    """

    waits: bool
    stamps: str

    def read(self) -> Image | None:
        """Return the next image as soon as it is available; None at the end.

        Raises:
            SourceError: no image is available now; the next call tries again.
        """

    def close(self) -> None:
        """Close the input. Safe to call twice."""


def check_input(text: str, *, loop: bool, latency_s: float | None) -> None:
    """Refuse an input that cannot be opened, without opening it.

    Args:
        text: a camera's number or device, a video, an image, or a folder of images.
        loop: begin again at the end.
        latency_s: from exposure to arrival; None: not given.

    Raises:
        ConfigError: the input does not exist, or an option has no effect on it.
    """
    if not text:
        raise ConfigError("input: empty; give a camera's number such as 0, or a file")
    is_camera = is_device(text) or is_depth_camera(text)
    if is_camera and loop:
        raise ConfigError(f"--loop: has no effect on camera {text}; leave it out")
    if latency_s is not None and is_depth_camera(text):
        raise ConfigError("--latency: has no effect on a depth camera; leave it out")
    if latency_s is not None and not is_camera:
        raise ConfigError(
            f"--latency: has no effect on {text}: it is for cameras only; leave it out"
        )
    if is_camera:
        return
    if "://" in text:
        raise ConfigError(
            f"input {text}: addresses are not opened; give a camera's number, or a file"
        )
    path = Path(text)
    if not (path.is_file() or path.is_dir()):
        raise ConfigError(
            f"input {text}: no such file; give a camera's number such as 0, a video, an image or "
            f"a folder of images"
        )


def open_input(
    text: str, *, rate_hz: float | None, loop: bool, latency_s: float | None, size: tuple[int, int]
) -> Input:
    """Open a camera by its number or device, a video, an image, or a folder of images.

    Args:
        text: the input, in one of these forms.
        rate_hz: images per second; None: a video's own, and ``DEFAULT_HZ``.
        loop: begin again at the end of a video or folder.
        latency_s: from exposure to arrival, for a camera that does not report it; None:
            ``LATENCY_S``.
        size: width and height to ask a camera for, pixels.

    Raises:
        ConfigError: the input does not exist, cannot be read, or an option has no effect on it.
    """
    import cv2

    cv2.utils.logging.setLogLevel(
        cv2.utils.logging.LOG_LEVEL_SILENT
    )  # its warnings name no remedy; ours do
    check_input(text, loop=loop, latency_s=latency_s)
    if is_depth_camera(text):
        module = import_module(f"hri_drivers.camera.{text}")
        opened: Input = getattr(module, DEPTH_CAMERAS[text])(rate_hz=rate_hz, size=size)
        return opened
    if is_device(text):
        return Webcam(text, rate_hz=rate_hz, latency_s=latency_s, size=size)
    path = Path(text)
    if path.is_dir() or path.suffix.lower() in PICTURES:
        return Pictures(path, rate_hz=rate_hz, loop=loop)
    return Video(path, rate_hz=rate_hz, loop=loop)


def is_depth_camera(text: str) -> bool:
    """Return whether an input is one of ``DEPTH_CAMERAS``, and not a file of that name."""
    return text in DEPTH_CAMERAS and not Path(text).exists()


class Video:
    """A video file, played at its own rate: an image that is not read in time is skipped.

    Args:
        path: path of the file.
        rate_hz: images per second instead of the file's own.
        loop: begin again at the end.

    Raises:
        ConfigError: the file is not a video.
    """

    waits = False
    stamps = "the video's own times"

    def __init__(self, path: Path, *, rate_hz: float | None, loop: bool) -> None:
        import cv2

        os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = "protocol_whitelist;file"
        self._path, self._rate_hz, self._loop = path, rate_hz, loop
        self._file = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        own = float(self._file.get(cv2.CAP_PROP_FPS)) if self._file.isOpened() else 0.0
        self._period_s = 1.0 / (rate_hz or (own if 1.0 <= own <= 1000.0 else DEFAULT_HZ))
        self._number, self._at_s = 0, 0.0
        self._own_s: float | None = None
        self._start: float | None = None
        self._ahead = self._next()
        if self._ahead is None:
            raise ConfigError(f"input {path}: not a video that can be read; give another file")

    def begin(self, at_s: float) -> None:
        """Set the time of the first image, so that several videos start together.

        Args:
            at_s: by ``time.monotonic``.
        """
        self._start = at_s

    def read(self) -> Image | None:
        """See ``Input``."""
        if self._ahead is None:
            return None
        if self._start is None:
            self._start = time.monotonic()
        (pixels, at_s), self._ahead = self._ahead, None
        time.sleep(max(0.0, self._start + at_s - time.monotonic()))
        self._number += 1
        exposed_ns = round(1e9 * (self._start + at_s))
        image = Image(pixels, exposed_ns, self._number, stamped="by the file")
        self._ahead = self._next()
        return image

    def close(self) -> None:
        """See ``Input``."""
        self._file.release()

    def _next(self) -> tuple[UInt8, float] | None:
        """Return the next image, and its time in seconds from the first one."""
        import cv2

        pixels = next_of(self._file)
        if pixels is None and self._loop and self._number:
            self._file.release()
            self._file = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
            pixels = next_of(self._file)
            self._own_s = -math.inf  # its times begin again
        if pixels is None:
            return None
        own_s = float(self._file.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        if self._own_s is not None:
            step_s = own_s - self._own_s
            follows = self._rate_hz is None and 0 < step_s < MAX_STEP_S
            self._at_s += step_s if follows else self._period_s
        self._own_s = own_s
        return checked(pixels, f"input {self._path}"), self._at_s


class Pictures:
    """Image files in the order of their names; none is skipped.

    Args:
        path: an image, or a folder with images.
        rate_hz: images per second.
        loop: begin again at the end.

    Raises:
        ConfigError: there are no images.
    """

    waits = True
    stamps = "the time at which each image is taken"

    def __init__(self, path: Path, *, rate_hz: float | None, loop: bool) -> None:
        found = sorted(path.iterdir()) if path.is_dir() else [path]
        self._paths = [
            p
            for p in found
            if p.suffix.lower() in PICTURES and p.is_file() and not p.name.endswith(DEPTH)
        ]
        if not self._paths:
            what = f"no images ({', '.join(PICTURES)}) in it" if path.is_dir() else "no such file"
            raise ConfigError(f"input {path}: {what}; check the path")
        self._period_s = 1.0 / (rate_hz or DEFAULT_HZ)
        self._loop = loop
        self._order = self._walk()
        self._number = 0
        self._next = time.monotonic()

    def read(self) -> Image | None:
        """See ``Input``."""
        path = next(self._order, None)
        if path is None:
            return None
        pixels, beside = _colours(path), path.with_suffix(DEPTH)
        depth = read_depth(beside) if beside.exists() else None
        time.sleep(max(0.0, self._next - time.monotonic()))
        self._next = max(time.monotonic(), self._next) + self._period_s
        self._number += 1
        return Image(pixels, time.monotonic_ns(), self._number, depth, "by the file")

    def close(self) -> None:
        """See ``Input``."""

    def _walk(self) -> Iterator[Path]:
        yield from self._paths
        while self._loop:
            yield from self._paths


def _colours(path: Path) -> UInt8:
    import cv2

    pixels = read_picture(path, cv2.IMREAD_COLOR)
    if pixels is None:
        raise SourceError(f"image {path}: cannot be read")
    return checked(pixels, f"image {path}")
