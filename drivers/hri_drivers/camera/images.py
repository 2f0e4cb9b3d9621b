"""Pictures of a webcam, a video file, or pictures in files, each with the time of its exposure.

No input opens a connection: addresses are refused, and FFmpeg may read files only.
"""

import math
import os
import re
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from hri_drivers.camera.place.by_depth import read_depth
from hri_drivers.camera.seen import Image, Stamped, UInt8
from hri_predict.base.errors import ConfigError, SourceError

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
MIN_SIDE, MAX_SIDE = 64, 8192
DEPTH_CAMERAS = {"realsense": "RealSense", "oak": "Oak", "kinect": "Kinect"}
"""Modules of this folder, and their classes."""
DEPTH = ".depth.png"
"""NAME.depth.png has the depth of NAME.png in the same folder: aligned, 16 bits, millimetres."""
DEFAULT_HZ = 30.0
LATENCY_S = 0.05
"""From the middle of the exposure to the picture's arrival, of a webcam at 30 Hz: half of its
exposure (up to 33 ms), read-out and transfer. A picture that is older than believed is the
dangerous error, so this is on the large side."""
MAX_DEVICE_AGE_S = 1.0
MAX_STEP_S = 10.0
"""From one picture of a video to the next; a larger step is an error in its times."""


class Input(Protocol):
    """Delivers pictures, for one thread.

    Attributes:
        waits: whether it keeps a picture until it is read; a camera does not.
        stamps: how the time of the exposure is known, for a person.
    """

    waits: bool
    stamps: str

    def read(self) -> Image | None:
        """Return the next picture as soon as it is there; None at the end.

        Raises:
            SourceError: no picture comes now; the next call tries again.
        """

    def close(self) -> None:
        """Close it. Safe to call twice."""


def open_input(
    text: str, *, rate_hz: float | None, loop: bool, latency_s: float | None, size: tuple[int, int]
) -> Input:
    """Open a camera by its number or device, a video, a picture, or a folder of pictures.

    Args:
        text: which.
        rate_hz: pictures per second; None: a video's own, and ``DEFAULT_HZ``.
        loop: begin again at the end of a video or folder.
        latency_s: from exposure to arrival, where a camera does not say; None: ``LATENCY_S``.
        size: width and height to ask a camera for, pixels.

    Raises:
        ConfigError: the input does not exist, cannot be read, or an option has no effect on it.
    """
    import cv2

    cv2.utils.logging.setLogLevel(
        cv2.utils.logging.LOG_LEVEL_SILENT
    )  # its warnings name no remedy; ours do
    path = Path(text)
    if text in DEPTH_CAMERAS and not path.exists():
        for flag, given in (("--loop", loop), ("--latency", latency_s is not None)):
            if given:
                raise ConfigError(f"{flag}: has no effect on a depth camera; leave it out")
        module = import_module(f"hri_drivers.camera.{text}")
        opened: Input = getattr(module, DEPTH_CAMERAS[text])(rate_hz=rate_hz, size=size)
        return opened
    if not text:
        raise ConfigError("input: empty; give a camera's number such as 0, or a file")
    if is_device(text) and loop:
        raise ConfigError(f"--loop: has no effect on camera {text}; leave it out")
    if not is_device(text) and latency_s is not None:
        raise ConfigError(f"--latency: has no effect on {text}: only on a camera; leave it out")
    if is_device(text):
        return Webcam(text, rate_hz=rate_hz, latency_s=latency_s, size=size)
    if "://" in text:
        raise ConfigError(
            f"input {text}: addresses are not opened; give a camera's number, or a file"
        )
    if path.is_dir() or path.suffix.lower() in PICTURES:
        return Pictures(path, rate_hz=rate_hz, loop=loop)
    if not path.is_file():
        raise ConfigError(
            f"input {text}: no such file; give a camera's number such as 0, a video, a picture or "
            f"a folder of pictures"
        )
    return Video(path, rate_hz=rate_hz, loop=loop)


def is_device(text: str) -> bool:
    """Return whether an input is a camera of this machine, by its number or path."""
    return bool(re.fullmatch("[0-9]{1,4}", text)) or text.startswith("/dev/")


def exposed(now_ns: int, device_ms: float, *, is_believed: bool = False) -> int | None:
    """Return the time of an exposure by the device's time stamp; None if it cannot be that.

    The driver of a Linux webcam (V4L2) stamps a picture by the monotonic clock, in milliseconds
    (``V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC``). Other systems give something else, or 0.

    Args:
        now_ns: time of the arrival, nanoseconds of the monotonic clock.
        device_ms: the device's time stamp.
        is_believed: whether the stamp before was a time of this clock. A picture may then be of
            any age: one that a driver kept while it stalled must not pass for a new one.
    """
    if not 0 < device_ms <= now_ns / 1e6:  # NaN, too
        return None
    stamp_ns = min(round(device_ms * 1e6), now_ns)
    is_recent = now_ns - stamp_ns <= 1e9 * MAX_DEVICE_AGE_S
    return stamp_ns if is_believed or is_recent else None


class Webcam:
    """A camera of this machine. One that is lost is opened again.

    Args:
        name: its number, or the path of its device.
        rate_hz: pictures per second to ask for; None: as it likes.
        latency_s: see ``open_input``.
        size: width and height to ask for.
        capture: opens a device, as ``cv2.VideoCapture``.

    Raises:
        ConfigError: it does not open.
    """

    waits = False

    def __init__(
        self,
        name: str,
        *,
        rate_hz: float | None,
        latency_s: float | None,
        size: tuple[int, int],
        capture: Callable[[int | str], Any] | None = None,
    ) -> None:
        import cv2

        self._name, self._rate_hz, self._size = name, rate_hz, size
        self._latency_ns = round(1e9 * (LATENCY_S if latency_s is None else latency_s))
        self._capture = capture or cv2.VideoCapture
        self._number = 0
        self._last_ms = 0.0
        self._is_believed = False
        self.stamps = ""
        try:
            self._device: Any = self._open()
        except SourceError as error:
            raise ConfigError(
                f"{error}; is it plugged in, and used by no other program? Give another number, "
                f"or a video file"
            ) from None

    def read(self) -> Image | None:
        """See ``Input``."""
        if self._device is None:
            self._device = self._open()
        pixels = _read(self._device)
        if pixels is None:
            self.close()
            raise SourceError(f"camera {self._name}: it delivers no picture; is it unplugged?")
        now_ns = time.monotonic_ns()
        self._number += 1
        pixels = checked(pixels, f"camera {self._name}")
        return Image(pixels, self._time(now_ns), self._number, stamped=self._stamped())

    def close(self) -> None:
        """See ``Input``."""
        if self._device is not None:
            self._device.release()
            self._device = None

    def _open(self) -> Any:
        import cv2

        device = self._capture(int(self._name) if self._name.isdecimal() else self._name)
        if not device.isOpened():
            device.release()
            raise SourceError(f"camera {self._name}: cannot be opened")
        device.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        device.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
        device.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        if self._rate_hz is not None:
            device.set(cv2.CAP_PROP_FPS, self._rate_hz)
        return device

    def _stamped(self) -> Stamped:
        return "by the device" if self._is_believed else "on arrival"

    def _time(self, now_ns: int) -> int:
        import cv2

        device_ms = float(self._device.get(cv2.CAP_PROP_POS_MSEC))
        stamped = None
        if device_ms > self._last_ms:
            stamped = exposed(now_ns, device_ms, is_believed=self._is_believed)
        self._last_ms, self._is_believed = device_ms, stamped is not None
        if stamped is not None:
            self.stamps = "the device's time stamps"
            return stamped
        self.stamps = f"arrival less {self._latency_ns / 1e9:g} s, since the device gives no time"
        return now_ns - self._latency_ns


class Video:
    """A video file, played at its own rate: a picture that is not read in time is gone.

    Args:
        path: of the file.
        rate_hz: pictures per second instead of the file's own.
        loop: begin again at the end.

    Raises:
        ConfigError: it is not a video.
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
        """Let the first picture be of this time, so that several videos begin together.

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
        """Return the next picture, and its time in seconds from the first one."""
        import cv2

        pixels = _read(self._file)
        if pixels is None and self._loop and self._number:
            self._file.release()
            self._file = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
            pixels = _read(self._file)
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
    """Pictures in files, in the order of their names: each is read.

    Args:
        path: a picture, or a folder with pictures.
        rate_hz: pictures per second.
        loop: begin again at the end.

    Raises:
        ConfigError: there are none.
    """

    waits = True
    stamps = "the time at which each picture is taken"

    def __init__(self, path: Path, *, rate_hz: float | None, loop: bool) -> None:
        found = sorted(path.iterdir()) if path.is_dir() else [path]
        self._paths = [
            p
            for p in found
            if p.suffix.lower() in PICTURES and p.is_file() and not p.name.endswith(DEPTH)
        ]
        if not self._paths:
            what = f"no pictures ({', '.join(PICTURES)}) in it" if path.is_dir() else "no such file"
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
        pixels, beside = read_picture(path), path.with_suffix(DEPTH)
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


def _read(device: Any) -> Any:
    """Return the next picture of a ``cv2.VideoCapture``; None if there is none."""
    import cv2

    try:
        came, pixels = device.read()
    except cv2.error:  # of a picture that it cannot convert
        return None
    return pixels if came else None


def read_picture(path: Path) -> UInt8:
    """Return the picture of a file, BGR.

    Raises:
        SourceError: it is not a picture that can be read.
    """
    import cv2

    try:
        pixels = cv2.imread(str(path), cv2.IMREAD_COLOR)
    except cv2.error:  # larger than OpenCV takes
        pixels = None
    if pixels is None:
        raise SourceError(f"picture {path}: cannot be read")
    return checked(pixels, f"picture {path}")


def checked(pixels: Any, where: str) -> UInt8:
    """Return pixels as (H, W, 3) of bytes.

    Raises:
        SourceError: they are of another kind, or too small or large.
    """
    array = np.asarray(pixels)
    if array.ndim == 2:
        array = np.repeat(array[:, :, np.newaxis], 3, axis=2)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype != np.uint8:
        raise SourceError(f"{where}: not a colour picture with 8 bits for each channel")
    height, width = array.shape[:2]
    if min(height, width) < MIN_SIDE or max(height, width) > MAX_SIDE:
        raise SourceError(
            f"{where}: {width} x {height} pixels; expected {MIN_SIDE} to {MAX_SIDE} on each side"
        )
    return array
