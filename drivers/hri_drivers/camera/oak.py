"""A Luxonis OAK camera with stereo depth, through Luxonis' package ``depthai``.

Uses the API of depthai 3 (``RGBD``, ``RGBDData``, ``ImgTransformation``). Tested with the package's
own images and clock and a stand-in for the device, not yet with a device.
"""

import os
import time
from datetime import timedelta
from typing import Any

import numpy as np

from hri_drivers.camera.depth_camera import TIMEOUT_MS, DepthCamera, factory_camera
from hri_drivers.camera.place.camera import Camera
from hri_predict.base.errors import ConfigError, SourceError

FIRST_S = 10.0
"""Maximum time from the start to the first image."""
MAX_MM = 4000
"""Maximum depth. Farther away the error is not "below 2 %" (Luxonis, depth accuracy with 7.5 cm
between the lenses), which ``by_depth`` relies on."""


class Oak(DepthCamera):
    """See ``DepthCamera``."""

    name, module = "OAK", "depthai"
    _pipeline: Any = None
    _device: Any = None

    def _imported(self) -> Any:
        package = super()._imported()
        if not hasattr(package.node, "RGBD"):
            raise ConfigError(
                "OAK: the installed depthai is older than 3.0; upgrade it with: pip install "
                "--upgrade 'depthai>=3'"
            )
        return package

    def _errors(self) -> tuple[type[Exception], ...]:
        return (RuntimeError, self._package.MessageQueue.QueueException)

    def _open(self) -> Camera:
        # it would look for cameras by broadcasts in every network
        os.environ.setdefault("DEPTHAI_PROTOCOL", "usb")
        node = self._package.node
        self._device = self._package.Device()
        self._pipeline = pipeline = self._package.Pipeline(self._device)
        colour = pipeline.create(node.Camera).build()
        # the default preset mixes depth with that of earlier images, where a person no longer is
        stereo = pipeline.create(node.StereoDepth).build(
            True, node.StereoDepth.PresetMode.FAST_ACCURACY, fps=self._rate_hz
        )
        stereo.setSubpixel(True)
        # takes images at most 10 ms apart, undistorted, with depth aligned and in millimetres
        aligned = pipeline.create(node.RGBD).build(colour, stereo, self._size, self._rate_hz)
        self._queue = aligned.rgbd.createOutputQueue(maxSize=1, blocking=False)
        pipeline.start()
        known = self._next(FIRST_S).getRGBFrame().getTransformation()
        if not known.isValid():
            raise SourceError("it has no calibration")
        return factory_camera(known.getIntrinsicMatrix(), tuple(known.getSize()), [0.0] * 5)

    def _next(self, timeout_s: float) -> Any:
        both = self._queue.get(timedelta(seconds=timeout_s))
        if both is None:
            raise RuntimeError(f"none within {timeout_s:g} s")
        return both

    def _take(self) -> tuple[Any, Any, int]:
        both = self._next(TIMEOUT_MS / 1e3)
        colour, depth = both.getRGBFrame(), both.getDepthFrame()
        middle = self._package.CameraExposureOffset.MIDDLE
        first = min(colour.getTimestamp(middle), depth.getTimestamp(middle))
        # the package maps the device's clock to its own, which is this machine's; ours is read
        # first, so that a pause between the two makes the image older, never newer
        now_ns = time.monotonic_ns()
        age_s = (self._package.Clock.now() - first).total_seconds()
        exposed_ns = self._recent(now_ns - round(1e9 * age_s))
        raw = depth.getFrame()
        return colour.getCvFrame(), np.where(raw > MAX_MM, 0, raw), exposed_ns

    def _stop(self) -> None:
        pipeline, device, self._pipeline, self._device = self._pipeline, self._device, None, None
        try:
            if pipeline is not None:
                pipeline.stop()
        finally:
            if device is not None:
                device.close()
