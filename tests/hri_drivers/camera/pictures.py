"""Pictures, videos and networks for tests of the camera."""

from pathlib import Path

import numpy as np
import pytest

from hri_drivers.camera.network.found import Finding, Found
from hri_drivers.camera.seen import Image, UInt8
from hri_predict.base.arrays import Floats

cv2 = pytest.importorskip("cv2", reason="needs OpenCV: pip install 'hri-predict[camera]'")


def textured(width: int = 640, height: int = 480, seed: int = 0) -> UInt8:
    """A picture that shows something."""
    small = np.random.default_rng(seed).integers(30, 220, (12, 16, 3), np.uint8)
    return np.asarray(cv2.resize(small, (width, height)), np.uint8)


def image(number: int = 1, exposed_ns: int = 0, pixels: UInt8 | None = None) -> Image:
    """A picture, each of another texture unless its pixels are given."""
    return Image(textured(seed=number) if pixels is None else pixels, exposed_ns, number)


def write_video(path: Path, pictures: list[UInt8], rate_hz: float = 25.0) -> Path:
    """Write a video of Motion JPEG, which keeps each picture nearly as it is."""
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate_hz, (width, height))
    assert writer.isOpened()
    for each in pictures:
        writer.write(each)
    writer.release()
    return path


def body(x: float = 320.0, y: float = 240.0, size: float = 200.0, joints: int = 33) -> Floats:
    """(J, 2) pixels of a body: the same pattern at another place and size."""
    pattern = np.random.default_rng(7).uniform(-0.5, 0.5, (joints, 2))
    return pattern * size + [x, y]


def found(pixels: Floats, score: float = 0.9) -> Found:
    """A person whose joints are all visible."""
    joints = len(pixels)
    world = np.random.default_rng(8).uniform(-0.8, 0.8, (joints, 3))
    return Found(pixels, np.full(joints, 0.9), world, score)


class Script:
    """A ``Finder`` that finds what it is given, picture after picture."""

    layout = "mediapipe33"

    def __init__(self, findings: list[Finding]) -> None:
        self._findings = list(findings)
        self.looked = 0

    def find(self, pixels: UInt8) -> Finding:
        self.looked += 1
        return self._findings.pop(0) if self._findings else Finding(())
