"""Pictures that show nothing."""

import numpy as np
import pytest

from tests.hri_drivers.camera.pictures import image, textured

from hri_drivers.camera.faults import FrozenWatch, hides  # isort: skip

MS = 1_000_000
NOISE = np.random.default_rng(1).integers(0, 8, (480, 640, 3)).astype(np.uint8)


@pytest.mark.parametrize(
    ("pixels", "word"),
    [
        (NOISE, "dark"),  # a covered lens still has noise
        (NOISE + np.uint8(90), "one even surface"),  # a hand that lets light through
        (np.full((480, 640, 3), 255, np.uint8), "over-exposed"),
        (np.where(np.arange(640)[:, None] < 400, 255, textured()).astype(np.uint8), "over-exposed"),
    ],
)
def test_a_picture_that_shows_nothing_is_named(pixels, word):
    assert word in (hides(pixels) or "")


@pytest.mark.parametrize("light", [0.3, 1.0])
def test_a_picture_of_something_is_good_in_dim_light_too(light):
    assert hides((textured() * light).astype(np.uint8)) is None


def test_identical_pictures_are_frozen_after_half_a_second():
    watch = FrozenWatch()
    verdicts = [watch.judge(image(k, 100 * k * MS, textured())) for k in range(8)]
    assert [v is None for v in verdicts] == [True] * 5 + [False] * 3
    changed = textured()
    changed[0, 0, 0] ^= 1  # the noise of one pixel
    assert watch.judge(image(9, 900 * MS, changed)) is None
