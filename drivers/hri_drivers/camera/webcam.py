"""A camera of this machine, and the time at which each of its images was exposed."""

import re
import time
from collections.abc import Callable
from typing import Any

from hri_drivers.camera.pixels import checked, next_of
from hri_drivers.camera.seen import Image
from hri_predict.base.errors import ConfigError, SourceError

LATENCY_S = 0.05
"""Time from the middle of the exposure to the image's arrival, for a webcam at 30 Hz: half its
exposure (up to 33 ms), read-out and transfer. Underestimating an image's age is the dangerous
error, so this value is rather large."""
HALF_EXPOSURE_S = 0.017
"""Time from the middle of the exposure to a device's time stamp: a Linux driver stamps an
image when its first bytes arrive (uvcvideo, without ``hwtimestamps``), after the exposure."""
MAX_DEVICE_AGE_S = 1.0


def is_device(text: str) -> bool:
    """Return whether an input is a camera of this machine, by its number or path."""
    return bool(re.fullmatch("[0-9]{1,4}", text)) or text.startswith("/dev/")


def stamp_of(now_ns: int, device_ms: float, *, is_believed: bool = False) -> int | None:
    """Return the device's time stamp in nanoseconds; None if the stamp is not from this machine's
    clock.

    The driver of a Linux webcam (V4L2) stamps an image with the monotonic clock, in milliseconds
    (``V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC``). Other systems report another value or 0.

    Args:
        now_ns: time of the arrival, nanoseconds of the monotonic clock.
        device_ms: the device's time stamp.
        is_believed: whether the previous stamp was from this clock. If so, any age is accepted: an
            image that a stalled driver kept must not pass as new.
    """
    if not 0 < device_ms <= now_ns / 1e6:  # NaN, too
        return None
    stamp_ns = min(round(device_ms * 1e6), now_ns)
    is_recent = now_ns - stamp_ns <= 1e9 * MAX_DEVICE_AGE_S
    return stamp_ns if is_believed or is_recent else None


class Webcam:
    """A camera of this machine. A lost camera is opened again.

    Args:
        name: number of the camera, or path of its device.
        rate_hz: images per second to request; None: the camera's choice.
        latency_s: see ``open_input``.
        size: width and height to request.
        capture: opens a device, like ``cv2.VideoCapture``.

    Raises:
        ConfigError: the camera cannot be opened.
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
        self.stamps = self._stamped = ""
        try:
            self._device: Any = self._open()
        except SourceError as error:
            raise ConfigError(
                f"{error}; is it plugged in, and not in use by another program? Give another "
                f"number, "
                f"or a video file"
            ) from None

    def read(self) -> Image | None:
        """See ``Input``."""
        if self._device is None:
            self._device = self._open()
        pixels = next_of(self._device)
        if pixels is None:
            self.close()
            raise SourceError(f"camera {self._name}: it delivers no image; is it unplugged?")
        now_ns = time.monotonic_ns()
        self._number += 1
        pixels = checked(pixels, f"camera {self._name}")
        return Image(pixels, self._time(now_ns), self._number, stamped=self._stamped)

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

    def _time(self, now_ns: int) -> int:
        import cv2

        device_ms = float(self._device.get(cv2.CAP_PROP_POS_MSEC))
        stamped = None
        if device_ms > self._last_ms:
            stamped = stamp_of(now_ns, device_ms, is_believed=self._is_believed)
        self._last_ms, self._is_believed = device_ms, stamped is not None
        if stamped is not None:
            self.stamps, self._stamped = "the device's time stamps", "by the device"
            return stamped - round(1e9 * HALF_EXPOSURE_S)
        self._stamped = f"on arrival less {self._latency_ns / 1e9:g} s"
        self.stamps = f"{self._stamped.removeprefix('on ')}, since the device gives no time"
        return now_ns - self._latency_ns
