"""An Intel RealSense camera with depth, through Intel's package ``pyrealsense2``.

Uses the API of librealsense 2.5x (``pipeline``, ``align``, ``get_intrinsics``); tested with a
stand-in for the package, not yet with a device.
"""

import time
from typing import Any

import numpy as np

from hri_drivers.camera.depth_camera import MAX_AGE_S, TIMEOUT_MS, DepthCamera, factory_camera
from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.place.placed import SIGMAS_99
from hri_predict.base.errors import SourceError

LATENCY_S = 0.06
"""Time from the exposure to the arrival of aligned images, for a device that reports no time on
this machine's clock, or only the arrival time (``system_time``)."""
SUBPIXEL = 0.08
"""Assumed error of the disparity, pixels RMS, on textured surfaces; not measured. The error of the
depth z is z^2 * SUBPIXEL / (focal length * baseline): 0.15 m RMS, 6 m away, for a D435 at
640 x 480."""
MAX_APART_S = 0.05
"""Maximum time between the exposures of colour image and depth; a person walks 8 cm in it."""


class RealSense(DepthCamera):
    """See ``DepthCamera``."""

    name, module = "RealSense", "pyrealsense2"
    _pipeline: Any = None
    _is_believed = False

    def _open(self) -> Camera:
        rs, (width, height), rate_hz = self._package, self._size, round(self._rate_hz)
        config, pipeline = rs.config(), rs.pipeline()
        config.enable_stream(rs.stream.color, width, height, rs.format.bgr8, rate_hz)
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate_hz)
        profile = pipeline.start(config)
        self._pipeline, self._align = pipeline, rs.align(rs.stream.color)
        sensor = profile.get_device().first_depth_sensor()
        self.metres_per_unit = sensor.get_depth_scale()
        self.stereo_error = self._stereo(profile, sensor)
        known = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
        # the inverse model of distortion, which is small, is 0
        has_ours = known.model == rs.distortion.brown_conrady
        return factory_camera(
            [[known.fx, 0, known.ppx], [0, known.fy, known.ppy], [0, 0, 1]],
            (known.width, known.height),
            known.coeffs if has_ours else [0.0] * 5,
        )

    def _stereo(self, profile: Any, sensor: Any) -> float:
        """Return the 99 % bound of the depth's error divided by its square, 1/m; 0 without stereo.

        Raises:
            SourceError: the device reports no focal length or baseline.
        """
        rs = self._package
        if not sensor.supports(rs.option.stereo_baseline):
            return 0.0
        depth = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
        baseline_m = abs(sensor.get_option(rs.option.stereo_baseline)) * 1e-3
        if not depth.fx * baseline_m > 0:  # NaN, too
            raise SourceError("it reports no focal length or baseline of its depth")
        return SIGMAS_99 * SUBPIXEL / float(depth.fx * baseline_m)

    def _take(self) -> tuple[Any, Any, int]:
        frames = self._align.process(self._pipeline.wait_for_frames(TIMEOUT_MS))
        colour, depth = frames.get_color_frame(), frames.get_depth_frame()
        if not colour or not depth:
            raise SourceError("RealSense: an image arrived without its depth")
        pixels, raw = np.asanyarray(colour.get_data()), np.asanyarray(depth.get_data())
        return pixels, raw, self._exposed(colour, depth)

    def _stop(self) -> None:
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            pipeline.stop()

    def _exposed(self, colour: Any, depth: Any) -> int:
        """Return the time of the earlier exposure, of colour image or depth, by the monotonic
        clock.

        Raises:
            SourceError: the two images are not of one moment.
        """
        now_ns, utc_ms = time.monotonic_ns(), time.time_ns() / 1e6
        domain = self._package.timestamp_domain
        of = colour.get_frame_timestamp_domain()
        if depth.get_frame_timestamp_domain() != of:
            raise SourceError("RealSense: an image and its depth are stamped by different clocks")
        stamps_ms = colour.get_timestamp(), depth.get_timestamp()
        if not max(stamps_ms) - min(stamps_ms) <= 1e3 * MAX_APART_S:  # NaN, too
            raise SourceError(
                f"RealSense: an image and its depth are more than {1e3 * MAX_APART_S:.0f} ms apart"
            )
        age_ms = utc_ms - min(stamps_ms)
        is_ours = of in (domain.system_time, domain.global_time) and age_ms >= 0
        self._is_believed = is_ours and (self._is_believed or age_ms <= 1e3 * MAX_AGE_S)
        if self._is_believed and of == domain.global_time:
            self.stamps, self.stamped = "the device's time stamps", "by the device"
            age_ms = max(
                utc_ms - each.get_timestamp() + self._sent_ms(each) for each in (colour, depth)
            )
            return now_ns - round(age_ms * 1e6)
        self.stamped = f"on arrival less {LATENCY_S:g} s"
        self.stamps = f"arrival less {LATENCY_S:g} s, since the device gives no time"
        arrival_ns = now_ns - (round(age_ms * 1e6) if self._is_believed else 0)
        return arrival_ns - round(LATENCY_S * 1e9)

    def _sent_ms(self, frame: Any) -> float:
        """Return the time from the middle of an image's exposure to its stamp.

        A device stamps the start of the transmission (librealsense, issue 2188). If it does not
        report the exposure time, a whole period before the stamp is assumed.
        """
        known = self._package.frame_metadata_value
        both = known.frame_timestamp, known.sensor_timestamp
        if all(frame.supports_frame_metadata(each) for each in both):
            stamped_us, middle_us = (frame.get_frame_metadata(each) for each in both)
            if 0 <= stamped_us - middle_us <= 1e6 * MAX_AGE_S:
                return float(stamped_us - middle_us) / 1e3
        return 1e3 / self._rate_hz
