"""An Intel RealSense camera with depth, by Intel's package ``pyrealsense2``.

By the names of librealsense 2.5x (``pipeline``, ``align``, ``get_intrinsics``); tested with a
stand-in for the package, not yet with a device.
"""

import time
from typing import Any

import numpy as np

from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.seen import Float32, Image, Stamped
from hri_predict.base.errors import ConfigError, SourceError

TIMEOUT_MS = 1000
DEFAULT_HZ = 30.0
LATENCY_S = 0.06
"""From the exposure to the arrival of aligned pictures, where the device gives no time of ours."""
MAX_AGE_S = 1.0
MAX_APART_S = 0.05
"""From the exposure of the colour picture to that of its depth: a person walks 8 cm."""
FACTORY_FOCAL_ERROR = 0.01
"""Of the intrinsics by which the device was calibrated in the factory."""


class RealSense:
    """An ``Input`` whose pictures have depth.

    Args:
        rate_hz: pictures per second; None: 30.
        size: width and height of both pictures.
        package: ``pyrealsense2``; None: imported.

    Attributes:
        camera: the intrinsics of the colour picture, by the factory.

    Raises:
        ConfigError: the package is missing, or no device delivers such pictures.
    """

    waits = False

    def __init__(
        self, *, rate_hz: float | None, size: tuple[int, int], package: Any = None
    ) -> None:
        self._rs = _package() if package is None else package
        self._rate_hz, self._size = round(rate_hz or DEFAULT_HZ), size
        self._number = 0
        self._is_believed = False
        self._pipeline: Any = None
        self.stamps = ""
        try:
            self.camera = self._open()
        except SourceError as error:
            raise ConfigError(f"{error}; is it plugged into USB 3, and used by no other?") from None

    def read(self) -> Image | None:
        """See ``Input``."""
        if self._pipeline is None:
            self._open()
        try:
            frames = self._align.process(self._pipeline.wait_for_frames(TIMEOUT_MS))
            colour, depth = frames.get_color_frame(), frames.get_depth_frame()
        except RuntimeError as error:
            self.close()
            raise SourceError(f"RealSense: it delivers no picture ({error})") from None
        if not colour or not depth:
            raise SourceError("RealSense: a picture came without its depth")
        exposed_ns = self._exposed(colour, depth)
        self._number += 1
        raw = np.asanyarray(depth.get_data())
        metres: Float32 = raw.astype(np.float32) * np.float32(self._metres_per_unit)
        metres[raw == 0] = np.nan
        pixels = np.array(np.asanyarray(colour.get_data()), np.uint8)
        stamped: Stamped = "by the device" if self._is_believed else "on arrival"
        return Image(pixels, exposed_ns, self._number, metres, stamped)

    def close(self) -> None:
        """See ``Input``."""
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            pipeline.stop()

    def _open(self) -> Camera:
        rs, (width, height) = self._rs, self._size
        config, pipeline = rs.config(), rs.pipeline()
        config.enable_stream(rs.stream.color, width, height, rs.format.bgr8, self._rate_hz)
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, self._rate_hz)
        try:
            profile = pipeline.start(config)
        except RuntimeError as error:
            raise SourceError(
                f"RealSense: no device gives {width} x {height} at {self._rate_hz} Hz ({error})"
            ) from None
        self._pipeline, self._align = pipeline, rs.align(rs.stream.color)
        self._metres_per_unit = profile.get_device().first_depth_sensor().get_depth_scale()
        stream = profile.get_stream(rs.stream.color).as_video_stream_profile()
        return _camera(rs, stream.get_intrinsics())

    def _exposed(self, colour: Any, depth: Any) -> int:
        """Return the time of the earlier exposure of the two, by the monotonic clock.

        Raises:
            SourceError: the two pictures are not of one moment.
        """
        now_ns, utc_ms = time.monotonic_ns(), time.time_ns() / 1e6
        domain = self._rs.timestamp_domain
        of = colour.get_frame_timestamp_domain()
        if depth.get_frame_timestamp_domain() != of:
            raise SourceError("RealSense: a picture and its depth are stamped by different clocks")
        stamps_ms = colour.get_timestamp(), depth.get_timestamp()
        if not max(stamps_ms) - min(stamps_ms) <= 1e3 * MAX_APART_S:  # NaN, too
            raise SourceError(
                f"RealSense: a picture and its depth are more than {1e3 * MAX_APART_S:.0f} ms apart"
            )
        age_ms = utc_ms - min(stamps_ms)
        is_ours = of in (domain.system_time, domain.global_time) and age_ms >= 0
        self._is_believed = is_ours and (self._is_believed or age_ms <= 1e3 * MAX_AGE_S)
        if self._is_believed:
            self.stamps = "the device's time stamps"
            return now_ns - round(age_ms * 1e6)
        self.stamps = f"arrival less {LATENCY_S:g} s, since the device gives no time"
        return now_ns - round(LATENCY_S * 1e9)


def _camera(rs: Any, known: Any) -> Camera:
    """Return the camera of intrinsics; the inverse model of distortion, which is small, is 0."""
    has_ours = known.model == rs.distortion.brown_conrady
    return Camera(
        matrix=np.array([[known.fx, 0, known.ppx], [0, known.fy, known.ppy], [0, 0, 1]], float),
        size=(known.width, known.height),
        distortion=np.array(known.coeffs if has_ours else [0.0] * 5, np.float64),
        focal_error=FACTORY_FOCAL_ERROR,
    )


def _package() -> Any:
    try:
        import pyrealsense2
    except ImportError:
        raise ConfigError(
            "realsense: needs a package that is not installed; pip install pyrealsense2"
        ) from None
    return pyrealsense2
