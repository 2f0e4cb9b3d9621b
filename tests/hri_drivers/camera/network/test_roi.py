"""The square of a picture that the network looks at."""

import math

import numpy as np
import pytest

from tests.hri_drivers.camera.pictures import cv2, textured

from hri_drivers.camera.network.roi import MARGIN, Roi, around, whole  # isort: skip

PICTURE = textured()
HALF_PIXEL = 0.5
"""A drawn dot is a whole pixel, and interpolation spreads it evenly."""


def centre_of_light(picture):
    grey = picture.sum(axis=2).astype(float)
    y, x = np.mgrid[: grey.shape[0], : grey.shape[1]]
    return np.array([(grey * x).sum(), (grey * y).sum()]) / grey.sum()


@pytest.mark.parametrize("angle", [0.0, 0.4, -1.3, math.pi / 2, 3.0])
@pytest.mark.parametrize("size", [300.0, 512.0])
def test_a_place_in_the_square_is_the_same_place_in_the_picture(angle, size):
    roi = Roi(310.0, 250.0, size, angle)
    spot = (330, 270)
    picture = np.zeros((480, 640, 3), np.uint8)
    cv2.circle(picture, spot, 6, (255, 255, 255), -1)
    inside = (centre_of_light(roi.crop(picture, 256)) + 0.5) / 256
    np.testing.assert_allclose(roi.in_picture(inside[None])[0], spot, atol=HALF_PIXEL)


def test_the_whole_picture_lies_in_its_square():
    corners = whole(PICTURE).in_picture(np.array([[0.5, 0.5], [0.0, 0.5], [1.0, 0.5]]))
    np.testing.assert_allclose(corners, [[319.5, 239.5], [-0.5, 239.5], [639.5, 239.5]])


@pytest.mark.parametrize(
    ("edge", "angle"),
    [
        ((320, 140), 0.0),
        ((420, 240), math.pi / 2),
        ((320, 340), math.pi),
        ((220, 240), -math.pi / 2),
    ],
)
def test_the_line_from_hips_to_head_is_upright_in_the_square(edge, angle):
    roi = around(np.array([320.0, 240.0]), np.array(edge, float), PICTURE)
    assert roi is not None
    assert roi.size == pytest.approx(200 * MARGIN)
    assert math.cos(roi.angle - angle) == pytest.approx(1.0)
    u, v = np.linalg.solve(roi.turn * roi.size, np.array(edge) - np.array([roi.x, roi.y]))
    assert u == pytest.approx(0.0, abs=1e-9)
    assert v < 0  # above the middle


@pytest.mark.parametrize(
    ("centre", "edge"),
    [
        ((320, 240), (320, 240)),  # no size
        ((320, 240), (320, -9e6)),  # larger than any person
        ((9e6, 240), (9e6, 140)),  # far outside
        ((math.nan, 240), (320, 140)),
        ((320, 240), (math.inf, 140)),
    ],
)
def test_a_square_that_cannot_hold_a_person_is_refused(centre, edge):
    assert around(np.array(centre, float), np.array(edge, float), PICTURE) is None
