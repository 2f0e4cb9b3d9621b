"""An Azure Kinect, or an Orbbec Femto Bolt or Mega with Orbbec's libk4a, through ``pyk4a``.

Tested with a stand-in for ``pyk4a`` 1.5, not yet with a device; the calibration was tested against
the SDK's.
"""

import contextlib
import time
from typing import Any

from hri_drivers.camera.depth_camera import TIMEOUT_MS, DepthCamera, factory_camera
from hri_drivers.camera.place.camera import Camera
from hri_predict.base.errors import SourceError

SIZES = {
    (1280, 720): "RES_720P", (1920, 1080): "RES_1080P",
    (2560, 1440): "RES_1440P", (3840, 2160): "RES_2160P",
}  # fmt: skip
RATES = (5, 15, 30)
LATENCY_S = 0.1
"""Time from the middle of the exposure to the arrival of the fastest images. Microsoft measured
68 ms at 1280 x 720, "rough numbers" (Azure-Kinect-Sensor-SDK, issues 816 and 1446)."""
LEARNING = 15
"""Number of first images used only to measure how fast images arrive."""
MAX_DRIFT = 200e-6
"""Maximum drift of the device's clock against this machine's; see ``offset_line``."""


class Kinect(DepthCamera):
    """See ``DepthCamera``. It uses the device's smallest image size of at least ``size``."""

    name, module = "Kinect", "pyk4a"
    stamps = f"the device's clock, as the fastest images show it less {LATENCY_S:g} s"
    stamped = f"on arrival less {LATENCY_S:g} s"
    _device: Any = None
    _offset_ns: int | None = None
    _at_ns = 0

    def _errors(self) -> tuple[type[Exception], ...]:
        return (self._package.K4AException,)

    def _open(self) -> Camera:
        k4a = self._package
        fitting = [s for s in SIZES if s[0] >= self._size[0] and s[1] >= self._size[1]]
        if not fitting:
            raise SourceError("the largest image is 3840 x 2160")
        rate = min((r for r in RATES if r >= self._rate_hz), default=RATES[-1])
        # the depth mode that reaches farthest: 5.5 m
        config = k4a.Config(
            color_resolution=k4a.ColorResolution[SIZES[fitting[0]]],
            depth_mode=k4a.DepthMode.NFOV_2X2BINNED,
            camera_fps=k4a.FPS[f"FPS_{rate}"],
            synchronized_images_only=True,
        )
        device = k4a.PyK4A(config)
        device.start()
        self._device, self._offset_ns = device, None
        for _ in range(LEARNING):
            self._exposed(self._newest())
        known, colour = device.calibration, k4a.CalibrationType.COLOR
        return factory_camera(
            known.get_camera_matrix(colour), fitting[0], known.get_distortion_coefficients(colour)
        )

    def _newest(self) -> Any:
        capture = self._device.get_capture(TIMEOUT_MS)
        with contextlib.suppress(self._package.K4ATimeoutException):
            while True:  # the SDK keeps up to half a second of older ones
                capture = self._device.get_capture(0)
        return capture

    def _take(self) -> tuple[Any, Any, int]:
        capture = self._newest()
        exposed_ns = self._exposed(capture)
        pixels, raw = capture.color, capture.transformed_depth
        if pixels is None or raw is None:
            raise SourceError("Kinect: an image arrived without its depth")
        return pixels[:, :, :3], raw, self._recent(exposed_ns)

    def _exposed(self, capture: Any) -> int:
        """Return the time of the middle of the exposure, by ``time.monotonic_ns``.

        The device's clock drifts slowly, and has its own epoch, which is estimated from the
        images that arrive fastest. The meaning of the SDK's system time depends on the vendor.
        """
        now_ns, stamp_ns = time.monotonic_ns(), 1000 * capture.color_timestamp_usec
        offset_ns = now_ns - stamp_ns
        if self._offset_ns is not None:
            drift_ns = round(MAX_DRIFT * (now_ns - self._at_ns))
            offset_ns = min(offset_ns, self._offset_ns + drift_ns)
        self._offset_ns, self._at_ns = offset_ns, now_ns
        return stamp_ns + offset_ns - round(LATENCY_S * 1e9)

    def _stop(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            device.stop()
