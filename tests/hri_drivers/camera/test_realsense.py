"""A RealSense by a package that behaves as Intel documents it; no device was there."""

import importlib.util
import time
from types import SimpleNamespace

import numpy as np
import pytest

from hri_drivers.camera.realsense import LATENCY_S, RealSense
from hri_predict.base.errors import ConfigError, SourceError

MS = 1_000_000
MARGIN_NS = 5 * MS
"""A clock of the machine that is slewed meanwhile."""
PERIOD_MS = 1000 / 30


class Frame:
    def __init__(self, data, stamp_ms, domain, sent_us):
        self._data, self._stamp_ms, self._domain = data, stamp_ms, domain
        self._metadata = (
            {} if sent_us is None else {"frame": sent_us + 7_000_000, "sensor": 7_000_000}
        )

    def get_data(self):
        return self._data

    def get_timestamp(self):
        return self._stamp_ms

    def get_frame_timestamp_domain(self):
        return self._domain

    def supports_frame_metadata(self, key):
        return key in self._metadata

    def get_frame_metadata(self, key):
        return self._metadata[key]


class Package:
    """``pyrealsense2`` with one device, or none."""

    stream = SimpleNamespace(color="color", depth="depth")
    format = SimpleNamespace(bgr8="bgr8", z16="z16")
    distortion = SimpleNamespace(brown_conrady="brown")
    frame_metadata_value = SimpleNamespace(frame_timestamp="frame", sensor_timestamp="sensor")
    timestamp_domain = SimpleNamespace(system_time=1, global_time=2, hardware_clock=0)

    option = SimpleNamespace(stereo_baseline="baseline")
    baseline_mm: float | None = 50.0  # None: not stereo

    def __init__(self, *, is_there=True, domain=2, depth_domain=None, ages_ms=(25, 25), sent_us=0):
        self.is_there, self.domain, self.ages_ms = is_there, domain, ages_ms
        self.sent_us = sent_us
        self.depth_domain = domain if depth_domain is None else depth_domain
        self.started = self.stopped = 0

    def config(self):
        return SimpleNamespace(enable_stream=lambda *asked: None)

    def align(self, to):
        return SimpleNamespace(process=lambda frames: frames)

    def pipeline(self):
        return SimpleNamespace(start=self._start, stop=self._stop, wait_for_frames=self._wait)

    def _start(self, config):
        if not self.is_there:
            raise RuntimeError("No device connected")
        self.started += 1
        known = SimpleNamespace(
            fx=615.0, fy=614.0, ppx=320.0, ppy=241.0, width=640, height=480,
            model="inverse", coeffs=[0.0] * 5,
        )  # fmt: skip
        of = {"color": known, "depth": SimpleNamespace(fx=385.0)}
        return SimpleNamespace(
            get_device=lambda: SimpleNamespace(
                first_depth_sensor=lambda: SimpleNamespace(
                    get_depth_scale=lambda: 0.001,
                    supports=lambda option: self.baseline_mm is not None,
                    get_option=lambda option: self.baseline_mm,
                )
            ),
            get_stream=lambda kind: SimpleNamespace(
                as_video_stream_profile=lambda: SimpleNamespace(get_intrinsics=lambda: of[kind])
            ),
        )

    def _stop(self):
        self.stopped += 1

    def _wait(self, timeout_ms):
        if not self.is_there:
            raise RuntimeError("Frame didn't arrive within 1000")
        colour_ms, depth_ms = (time.time_ns() / 1e6 - age_ms for age_ms in self.ages_ms)
        black, depth = np.zeros((1, 2, 3), np.uint8), np.array([[0, 1500]], np.uint16)
        return SimpleNamespace(
            get_color_frame=lambda: Frame(black, colour_ms, self.domain, self.sent_us),
            get_depth_frame=lambda: Frame(depth, depth_ms, self.depth_domain, self.sent_us),
        )


def opened(package):
    return RealSense(rate_hz=None, size=(640, 480), package=package)


def test_pictures_have_depth_in_metres_and_the_factorys_intrinsics():
    device = opened(Package())
    image = device.read()
    np.testing.assert_allclose(image.depth, [[np.nan, 1.5]])
    assert (image.number, device.read().number) == (1, 2)
    assert device.camera.size == (640, 480)
    assert device.camera.matrix[0].tolist() == [615.0, 0.0, 320.0]


@pytest.mark.parametrize(("baseline_mm", "rms_m"), [(50.0, 0.15), (-95.0, 0.079), (None, 0.0)])
def test_the_error_of_stereo_is_that_of_the_devices_focal_length_and_baseline(baseline_mm, rms_m):
    """RMS, 6 m away, with 0.08 pixels; an L515 has no baseline."""
    package = Package()
    package.baseline_mm = baseline_mm
    found = opened(package).read().stereo_error * 6.0**2 / 2.58
    assert found == pytest.approx(rms_m, abs=0.001)


@pytest.mark.parametrize("baseline_mm", [0.0, float("nan")])
def test_a_stereo_device_without_a_baseline_is_refused(baseline_mm):
    package = Package()
    package.baseline_mm = baseline_mm
    with pytest.raises(ConfigError, match="no focal length or baseline"):
        opened(package)


@pytest.mark.parametrize(
    ("domain", "late_ms", "stamped"),
    [
        (2, 25, "by the device"),
        (1, 25 + 1e3 * LATENCY_S, "on arrival"),  # this machine's time when the picture came
        (0, 1e3 * LATENCY_S, "on arrival"),
    ],
)
def test_only_a_time_of_this_machine_counts(domain, late_ms, stamped):
    image = read_late(opened(Package(domain=domain)), late_ms)
    assert image.stamped.removesuffix(f" less {LATENCY_S:g} s") == stamped


@pytest.mark.parametrize(
    ("sent_us", "late_ms"),
    [(12_000, 37), (None, 25 + PERIOD_MS), (-1, 25 + PERIOD_MS), (2**32, 25 + PERIOD_MS)],
)
def test_a_device_stamps_the_transmission_and_the_exposure_was_before(sent_us, late_ms):
    read_late(opened(Package(sent_us=sent_us)), late_ms)


@pytest.mark.parametrize("ages_ms", [(25, 60), (60, 25)])
def test_the_earlier_of_colour_and_depth_counts(ages_ms):
    read_late(opened(Package(ages_ms=ages_ms)), 60)


def test_depth_of_another_moment_or_clock_is_not_used():
    package = Package(ages_ms=(25, 80))
    device = opened(package)
    with pytest.raises(SourceError, match="more than 50 ms apart"):
        device.read()
    package.ages_ms, package.depth_domain = (25, 25), 0
    with pytest.raises(SourceError, match="different clocks"):
        device.read()
    package.depth_domain = package.domain
    assert device.read().number == 1


def test_pictures_that_were_kept_while_the_device_stalled_are_old():
    package = Package()
    device = opened(package)
    device.read()
    package.ages_ms = (3_000, 3_000)
    read_late(device, 3_000)


def read_late(device, late_ms):
    """Read a picture, and check that it counts as this late."""
    before_ns = time.monotonic_ns()
    image = device.read()
    after_ns = time.monotonic_ns()
    assert before_ns - MARGIN_NS <= image.exposed_ns + late_ms * MS <= after_ns + MARGIN_NS
    return image


def test_an_unplugged_device_is_an_interruption_and_is_opened_again():
    package = Package()
    device = opened(package)
    package.is_there = False
    for _ in range(2):
        with pytest.raises(SourceError, match="RealSense"):
            device.read()
    package.is_there = True
    assert device.read() is not None
    assert (package.started, package.stopped) == (2, 1)


def test_a_missing_device_or_package_is_one_line():
    with pytest.raises(ConfigError, match=r"No device connected.*USB 3"):
        opened(Package(is_there=False))
    if importlib.util.find_spec("pyrealsense2") is None:
        with pytest.raises(ConfigError, match="pip install pyrealsense2"):
            RealSense(rate_hz=None, size=(640, 480))
