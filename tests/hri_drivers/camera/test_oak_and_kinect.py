"""OAK and Kinect by packages that behave as they are documented; no device was there.

With ``depthai`` installed, the OAK's pictures, queue and clock are the package's own.
"""

import itertools
import os
import sys
import time
from datetime import timedelta
from enum import Enum
from types import SimpleNamespace

import numpy as np
import pytest

from hri_drivers.camera import depth_camera
from hri_drivers.camera import oak as oaks
from hri_drivers.camera.images import DEPTH_CAMERAS, open_input
from hri_drivers.camera.kinect import LATENCY_S, LEARNING, Kinect
from hri_drivers.camera.oak import Oak
from hri_predict.base.errors import ConfigError, SourceError

SIZE = (640, 480)
PIXELS = np.random.default_rng(1).integers(0, 255, (480, 640, 3), np.uint8)
RAW = np.full((480, 640), 1500, np.uint16)
RAW[0, :2] = 0, 6000
LATE_S = 0.03
MATRIX = [[600.0, 0.0, 320.0], [0.0, 601.0, 241.0], [0.0, 0.0, 1.0]]


class FakeOak:
    """``depthai`` with one device, or none: what needs a device is a stand-in.

    Args:
        real: the package; None: its pictures and clock are stand-ins, too.
    """

    class QueueException(Exception):
        pass

    def __init__(self, real=None):
        self.real, self.is_there, self.is_closed, self.late_s = real, True, False, LATE_S
        self.depth_later_s = 0.0
        self.started = self.stopped = self.closed = 0
        own = self if real is None else real
        self.Clock = SimpleNamespace(now=lambda: timedelta(seconds=time.monotonic()))
        self.CameraExposureOffset = SimpleNamespace(MIDDLE="middle")
        self.MessageQueue = SimpleNamespace(QueueException=self.QueueException)
        presets = SimpleNamespace(FAST_ACCURACY="accuracy")
        self.node = SimpleNamespace(
            Camera="Camera", RGBD="RGBD", StereoDepth=SimpleNamespace(PresetMode=presets)
        )
        if real is not None:
            for name in ("Clock", "CameraExposureOffset", "MessageQueue", "node"):
                setattr(self, name, getattr(own, name))
            self.host = real.Pipeline(createImplicitDevice=False)

    def Device(self):
        if not self.is_there:
            raise RuntimeError("No available devices")
        return SimpleNamespace(close=lambda: self._count("closed"))

    def Pipeline(self, device):
        def build(*args, fps=None):
            return SimpleNamespace(
                setSubpixel=lambda on: None, rgbd=SimpleNamespace(createOutputQueue=self._queue)
            )

        return SimpleNamespace(
            create=lambda kind: SimpleNamespace(build=build),
            start=lambda: self._count("started"),
            stop=lambda: self._count("stopped"),
        )

    def _count(self, what):
        setattr(self, what, getattr(self, what) + 1)

    def _queue(self, **asked):
        if self.real is None:
            return SimpleNamespace(
                get=lambda timeout: self.both() if self.is_there else self._gone()
            )
        queue = self.host.create(self.real.node.RGBD).rgbd.createOutputQueue(**asked)

        def get(timeout):
            if self.is_there:
                queue.send(self.both())
            elif self.is_closed:
                queue.close()
            return queue.get(timeout)

        return SimpleNamespace(get=get)

    def _gone(self):
        if self.is_closed:
            raise self.QueueException

    def both(self):
        stamp = self.Clock.now() - timedelta(seconds=self.late_s)
        of_depth = stamp + timedelta(seconds=self.depth_later_s)
        if self.real is None:
            known = SimpleNamespace(
                isValid=lambda: True, getIntrinsicMatrix=lambda: MATRIX, getSize=lambda: SIZE
            )
            colour = SimpleNamespace(
                getTransformation=lambda: known,
                getTimestamp=lambda offset: stamp,
                getCvFrame=lambda: PIXELS,
            )
            depth = SimpleNamespace(getTimestamp=lambda offset: of_depth, getFrame=lambda: RAW)
            return SimpleNamespace(getRGBFrame=lambda: colour, getDepthFrame=lambda: depth)
        dai = self.real
        colour, depth, both = dai.ImgFrame(), dai.ImgFrame(), dai.RGBDData()
        colour.setCvFrame(PIXELS, dai.ImgFrame.Type.RGB888i)
        known = dai.ImgTransformation(*SIZE)
        known.setIntrinsicMatrix(MATRIX)
        colour.setTransformation(known)
        colour.cam.exposureTimeUs = 10_000
        colour.setTimestamp(stamp + timedelta(milliseconds=5))  # the exposure's end
        depth.setTimestamp(of_depth)
        depth.setFrame(RAW)
        depth.setType(dai.ImgFrame.Type.RAW16)
        depth.setSize(*SIZE)
        both.setRGBFrame(colour)
        both.setDepthFrame(depth)
        return both


@pytest.fixture(params=["stand-in", "package"])
def oak(request):
    if request.param == "stand-in":
        return FakeOak()
    return FakeOak(pytest.importorskip("depthai", minversion="3", reason="pip install depthai"))


class FakeKinect:
    """``pyk4a`` with one device, or none, whose clock began at 5 s."""

    class K4AException(Exception):
        pass

    class K4ATimeoutException(K4AException):
        pass

    ColorResolution = Enum("ColorResolution", "RES_720P RES_1080P RES_1440P RES_2160P")
    DepthMode = Enum("DepthMode", "NFOV_2X2BINNED")
    FPS = Enum("FPS", "FPS_5 FPS_15 FPS_30")
    CalibrationType = SimpleNamespace(COLOR="color")

    def __init__(self):
        self.is_there, self.has_depth, self.kept, self.late_s = True, True, 0, 0.0
        self.started = self.stopped = 0
        self.epoch_ns = time.monotonic_ns() - 5_000_000_000
        self.calibration = SimpleNamespace(
            get_camera_matrix=lambda of: np.array(MATRIX),
            get_distortion_coefficients=lambda of: np.arange(8) / 1000,
        )

    def Config(self, **asked):
        self.asked = asked

    def PyK4A(self, config):
        return self

    def start(self):
        if not self.is_there:
            raise self.K4AException
        self.started += 1

    def stop(self):
        self.stopped += 1

    def get_capture(self, timeout):
        if not self.is_there or (timeout == 0 and not self.kept):
            raise self.K4ATimeoutException
        self.kept = max(0, self.kept - 1)
        stamp_ns = (
            time.monotonic_ns() - self.epoch_ns - round(1e9 * self.late_s) - self.kept * 10**8
        )
        return SimpleNamespace(
            color=np.dstack([PIXELS, RAW.astype(np.uint8)]),
            transformed_depth=RAW if self.has_depth else None,
            color_timestamp_usec=stamp_ns // 1000,
        )


def opened(kind, package):
    return kind(rate_hz=None, size=SIZE, package=package)


def read_late(device, late_s):
    """Read a picture, and check that it counts as this late."""
    before_ns = time.monotonic_ns()
    image = device.read()
    after_ns = time.monotonic_ns()
    assert before_ns - 5e6 <= image.exposed_ns + late_s * 1e9 <= after_ns + 5e6
    return image


def test_an_oaks_pictures_have_depth_in_metres_and_its_own_lens(oak):
    device = opened(Oak, oak)
    image = read_late(device, LATE_S)
    np.testing.assert_array_equal(image.pixels, PIXELS)
    np.testing.assert_allclose(image.depth[0, :3], [np.nan, np.nan, 1.5])  # too far: no depth
    assert (image.number, device.read().number) == (1, 2)
    assert image.stamped == "by the device"
    np.testing.assert_allclose(device.camera.matrix, MATRIX)
    assert device.camera.size == SIZE
    device.close()
    device.close()
    assert (oak.stopped, oak.closed) == (1, 1)


@pytest.mark.parametrize(("depth_later_s", "late_s"), [(-0.01, 0.04), (0.01, 0.03)])
def test_the_earlier_of_an_oaks_colours_and_depth_counts(oak, depth_later_s, late_s):
    device = opened(Oak, oak)
    oak.depth_later_s = depth_later_s
    read_late(device, late_s)


def test_a_pause_between_two_clocks_makes_an_oaks_picture_older(monkeypatch):
    package = FakeOak()
    device = opened(Oak, package)
    tenths = itertools.count(100)  # each reading is 0.1 s after the one before
    clock = SimpleNamespace(monotonic_ns=lambda: next(tenths) * 100_000_000)
    for module in (oaks, depth_camera):
        monkeypatch.setattr(module, "time", clock)
    package.Clock.now = lambda: timedelta(seconds=next(tenths) / 10)
    assert device.read().exposed_ns <= 10_000_000_000 - LATE_S * 1e9


def test_an_oak_is_not_looked_for_in_the_network(monkeypatch):
    monkeypatch.delenv("DEPTHAI_PROTOCOL", raising=False)
    opened(Oak, FakeOak())
    assert os.environ["DEPTHAI_PROTOCOL"] == "usb"


def test_a_kinects_pictures_have_depth_in_metres_and_its_own_lens():
    package = FakeKinect()
    device = opened(Kinect, package)
    image = device.read()
    np.testing.assert_array_equal(image.pixels, PIXELS)
    np.testing.assert_allclose(image.depth[0, :3], [np.nan, 6.0, 1.5])
    assert device.camera.size == (1280, 720)
    assert image.stamped == "on arrival less 0.1 s"  # its latency is assumed
    assert device.camera.distortion.tolist() == (np.arange(8) / 1000).tolist()
    assert package.asked["camera_fps"] is package.FPS.FPS_30


@pytest.mark.parametrize(
    ("size", "found"), [((1280, 720), "RES_720P"), ((1280, 960), "RES_1080P"), ((4000, 10), None)]
)
def test_a_kinect_gives_its_smallest_picture_that_is_large_enough(size, found):
    package = FakeKinect()
    if found is None:
        with pytest.raises(ConfigError, match="largest image"):
            Kinect(rate_hz=None, size=size, package=package)
        return
    Kinect(rate_hz=10, size=size, package=package)
    assert package.asked["color_resolution"].name == found
    assert package.asked["camera_fps"] is package.FPS.FPS_15


def test_a_kinects_late_picture_is_older():
    package = FakeKinect()
    device = opened(Kinect, package)
    read_late(device, LATENCY_S)
    package.late_s = 0.3
    read_late(device, LATENCY_S + 0.3)


def test_a_kinects_first_pictures_do_not_count_as_fast():
    package = FakeKinect()
    package.kept = LEARNING // 2  # came while it started
    read_late(opened(Kinect, package), LATENCY_S)


def test_only_a_kinects_newest_picture_is_taken():
    package = FakeKinect()
    device = opened(Kinect, package)
    package.kept = 5
    read_late(device, LATENCY_S)
    assert package.kept == 0


def test_a_kinects_picture_without_depth_is_left_out():
    package = FakeKinect()
    device = opened(Kinect, package)
    package.has_depth = False
    with pytest.raises(SourceError, match="without its depth"):
        device.read()
    assert package.stopped == 0


@pytest.mark.parametrize(
    ("kind", "fake", "late_s"),
    [(Oak, FakeOak, 1.5), (Oak, FakeOak, -0.1), (Kinect, FakeKinect, 1.5)],
)
def test_a_picture_of_a_wrong_time_is_left_out_and_the_device_opened_again(kind, fake, late_s):
    package = fake()
    device = opened(kind, package)
    package.late_s = late_s
    with pytest.raises(SourceError, match="s old"):
        device.read()
    package.late_s = LATE_S
    assert device.read() is not None
    assert (package.started, package.stopped) == (2, 1)


@pytest.mark.parametrize("is_closed", [False, True])
def test_an_unplugged_oak_is_an_interruption_and_is_opened_again(oak, is_closed):
    oak.is_closed = is_closed
    check_unplugged(Oak, oak)


def test_an_unplugged_kinect_is_an_interruption_and_is_opened_again():
    check_unplugged(Kinect, FakeKinect())


def check_unplugged(kind, package):
    device = opened(kind, package)
    package.is_there = False
    for _ in range(2):
        with pytest.raises(SourceError, match=kind.name):
            device.read()
    package.is_there = True
    assert device.read() is not None
    assert (package.started, package.stopped) == (2, 1)


@pytest.mark.parametrize(("kind", "fake"), [(Oak, FakeOak), (Kinect, FakeKinect)])
def test_a_missing_device_is_one_line(kind, fake):
    package = fake()
    package.is_there = False
    with pytest.raises(ConfigError, match=f"{kind.name}: no device gives 640 x.*USB 3"):
        opened(kind, package)


@pytest.mark.parametrize("text", DEPTH_CAMERAS)
def test_a_missing_package_is_one_line(text, monkeypatch):
    pytest.importorskip("cv2", reason="pip install 'hri-predict[camera]'")
    for module in ("pyrealsense2", "depthai", "pyk4a"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError, match=r"pip install (pyrealsense2|depthai|pyk4a)$"):
        open_input(text, rate_hz=None, loop=False, latency_s=None, size=SIZE)
    with pytest.raises(ConfigError, match="--loop: has no effect on camera"):
        open_input(text, rate_hz=None, loop=True, latency_s=None, size=SIZE)


def test_an_older_package_of_an_oak_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "depthai", SimpleNamespace(node=SimpleNamespace()))
    with pytest.raises(ConfigError, match="older than 3"):
        Oak(rate_hz=None, size=SIZE)
