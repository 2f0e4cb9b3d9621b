"""Pictures of a camera, a video and files, with the times of their exposure."""

from types import SimpleNamespace

import numpy as np
import pytest

from hri_drivers.camera.seen import Image
from hri_predict.base.errors import ConfigError, SourceError
from tests.hri_drivers.camera.pictures import cv2, textured, write_video

from hri_drivers.camera import webcam as webcams  # isort: skip
from hri_drivers.camera.images import open_input  # isort: skip
from hri_drivers.camera.pixels import checked  # isort: skip
from hri_drivers.camera.webcam import HALF_EXPOSURE_S, Webcam, stamp_of  # isort: skip

MS = 1_000_000
HALF_NS = round(1e9 * HALF_EXPOSURE_S)
SIZE = (640, 480)
FAINT = 12.0
"""Mean difference of grey values that Motion JPEG makes of such a picture; others differ by 60."""


def opened(text, *, rate_hz=None, loop=False, latency_s=None):
    return open_input(str(text), rate_hz=rate_hz, loop=loop, latency_s=latency_s, size=SIZE)


def all_of(pictures, most=100):
    found: list[Image] = []
    while len(found) < most and (image := pictures.read()) is not None:
        found.append(image)
    pictures.close()
    return found


class Device:
    """A ``cv2.VideoCapture`` that is told what it delivers."""

    def __init__(self, present=True, stamp_ms=lambda: 0.0):
        self.present, self.stamp_ms = present, stamp_ms
        self.released = 0

    def __call__(self, name):
        self.name = name
        return self

    def isOpened(self):
        return self.present

    def read(self):
        return self.present, textured() if self.present else None

    def get(self, _):
        return self.stamp_ms()

    def set(self, *_):
        return True

    def release(self):
        self.released += 1


def webcam(device, latency_s=None):
    return Webcam("0", rate_hz=None, latency_s=latency_s, size=SIZE, capture=device)


@pytest.mark.parametrize(
    ("device_ms", "expected"),
    [
        (9_980.0, 9_980 * MS),
        (10_000.0, 10_000 * MS),
        (10_001.0, None),  # of the future
        (8_000.0, None),  # older than any camera's queue
        (0.0, None),  # the backend knows none
        (float("nan"), None),
    ],
)
def test_a_device_stamp_counts_only_if_it_can_be_one_of_our_clock(device_ms, expected):
    assert stamp_of(10_000 * MS, device_ms) == expected


@pytest.mark.parametrize(("device_ms", "expected"), [(6_000.0, 6_000 * MS), (10_001.0, None)])
def test_of_a_clock_that_is_known_to_be_ours_an_old_stamp_counts_too(device_ms, expected):
    assert stamp_of(10_000 * MS, device_ms, is_believed=True) == expected


@pytest.fixture
def at_10_s(monkeypatch):
    """The monotonic clock stands at 10 s."""
    clock = SimpleNamespace(monotonic_ns=lambda: 10_000 * MS)
    monkeypatch.setattr(webcams, "time", clock)


def test_a_camera_with_time_stamps_is_believed(at_10_s):
    camera = webcam(Device(stamp_ms=lambda: 9_800.0))
    assert camera.read().exposed_ns == 9_800 * MS - HALF_NS  # stamped after its exposure
    assert camera.stamps == "the device's time stamps"


def test_a_picture_that_the_driver_kept_while_it_stalled_is_old(monkeypatch):
    clock = SimpleNamespace(monotonic_ns=lambda: 10_000 * MS)
    monkeypatch.setattr(webcams, "time", clock)
    stamps = iter([9_980.0, 10_013.0, 14_980.0])
    camera = webcam(Device(stamp_ms=lambda: next(stamps)))
    camera.read()
    clock.monotonic_ns = lambda: 15_000 * MS
    assert camera.read().exposed_ns == 10_013 * MS - HALF_NS  # exposed before the stall of 5 s
    assert camera.read().exposed_ns == 14_980 * MS - HALF_NS


@pytest.mark.parametrize(("latency_s", "late_ms"), [(None, 1000 * webcams.LATENCY_S), (0.2, 200)])
def test_a_camera_without_time_stamps_counts_as_late(at_10_s, latency_s, late_ms):
    camera = webcam(Device(), latency_s)
    image = camera.read()
    assert image.exposed_ns == 10_000 * MS - round(late_ms * MS)
    assert image.stamped == f"on arrival less {late_ms / 1000:g} s"
    assert camera.stamps.startswith(f"arrival less {late_ms / 1000:g} s, since")


def test_a_stamp_that_stands_still_is_not_believed(at_10_s):
    camera = webcam(Device(stamp_ms=lambda: 9_990.0))
    camera.read()
    camera.read()
    assert camera.stamps.startswith("arrival less")


def test_an_unplugged_camera_is_opened_again():
    device = Device()
    camera = webcam(device)
    assert camera.read().number == 1
    device.present = False
    for _ in range(2):
        with pytest.raises(SourceError, match="camera 0"):
            camera.read()
    assert device.released
    device.present = True
    assert camera.read().number == 2


def test_a_camera_that_is_not_there_is_refused_in_one_line():
    with pytest.raises(ConfigError, match="camera 0: cannot be opened; is it plugged in"):
        webcam(Device(present=False))


def test_a_video_plays_at_its_own_rate(tmp_path):
    pictures = [textured(160, 120, seed=k) for k in range(4)]
    path = write_video(tmp_path / "walk.avi", pictures, rate_hz=50)
    found = all_of(opened(path))
    assert [image.number for image in found] == [1, 2, 3, 4]
    steps = np.diff([image.exposed_ns for image in found])
    np.testing.assert_allclose(steps, 20 * MS, atol=MS)  # the file's times have milliseconds
    for image, true in zip(found, pictures, strict=True):
        assert np.abs(image.pixels.astype(float) - true).mean() < FAINT


def test_the_rate_of_a_video_can_be_set(tmp_path):
    path = write_video(tmp_path / "walk.avi", [textured(160, 120)] * 3, rate_hz=5)
    steps = np.diff([image.exposed_ns for image in all_of(opened(path, rate_hz=100))])
    np.testing.assert_allclose(steps, 10 * MS, atol=1000)  # rounding of seconds


def test_a_video_can_begin_again(tmp_path):
    pictures = [textured(160, 120, seed=k) for k in range(2)]
    path = write_video(tmp_path / "walk.avi", pictures, rate_hz=100)
    found = all_of(opened(path, loop=True), most=5)
    np.testing.assert_allclose(np.diff([i.exposed_ns for i in found]), 10 * MS, atol=MS)
    np.testing.assert_array_equal(found[0].pixels, found[4].pixels)


def test_pictures_come_in_the_order_of_their_names(tmp_path):
    for k in (2, 1):
        cv2.imwrite(str(tmp_path / f"{k}.png"), textured(seed=k))
    (tmp_path / "notes.txt").write_text("not a picture")
    found = all_of(opened(tmp_path, rate_hz=1000))
    assert [image.number for image in found] == [1, 2]
    np.testing.assert_array_equal(found[0].pixels, textured(seed=1))


def test_a_damaged_picture_is_an_interruption_not_the_end(tmp_path):
    (tmp_path / "1.png").write_bytes(b"no picture")
    cv2.imwrite(str(tmp_path / "2.png"), textured())
    pictures = opened(tmp_path, rate_hz=1000)
    with pytest.raises(SourceError, match=r"1\.png: cannot be read"):
        pictures.read()
    assert pictures.read() is not None
    assert pictures.read() is None


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("missing.mp4", {}, "no such file"),
        ("", {}, "input: empty"),
        ("9" * 30, {}, "no such file"),
        ("http://127.0.0.1/a.mp4", {}, "addresses are not opened"),
        ("rtsp://127.0.0.1/a", {}, "addresses are not opened"),
        ("text.mp4", {}, "not a video"),
        ("empty", {}, "no images"),
        ("missing.png", {}, "no such file"),
        ("0", {"loop": True}, "--loop: has no effect"),
        ("text.mp4", {"latency_s": 0.1}, "--latency: has no effect"),
    ],
)
def test_what_cannot_be_opened_is_refused_in_one_line(
    text, options, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.mp4").write_text("not a video")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match=message) as caught:
        opened(text, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((480, 640, 4), np.uint8),
        np.zeros((480, 640, 3), np.uint16),
        np.zeros((16, 640, 3), np.uint8),
        np.zeros((1, 9000, 3), np.uint8),
        np.zeros((3,), np.uint8),
    ],
)
def test_pictures_of_another_kind_are_refused(pixels):
    with pytest.raises(SourceError):
        checked(pixels, "camera 0")


def test_a_grey_picture_gets_three_channels():
    assert checked(textured()[:, :, 0], "camera 0").shape == (480, 640, 3)


def test_depth_beside_a_picture_is_its_own(tmp_path):
    cv2.imwrite(str(tmp_path / "1.png"), textured())
    cv2.imwrite(str(tmp_path / "1.depth.png"), np.full((480, 640), 2500, np.uint16))
    cv2.imwrite(str(tmp_path / "2.png"), textured(seed=1))
    pictures = opened(tmp_path, rate_hz=1000)
    first, second = pictures.read(), pictures.read()
    assert first is not None
    assert second is not None
    assert first.depth is not None
    assert first.depth.shape == (480, 640)
    assert float(first.depth[0, 0]) == 2.5
    assert second.depth is None
    assert pictures.read() is None
