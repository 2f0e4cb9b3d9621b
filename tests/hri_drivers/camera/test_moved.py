"""Cameras that are moved, and what only looks like it."""

import numpy as np
import pytest

from tests.hri_drivers.camera.pictures import cv2, image

from hri_drivers.camera.moved import CHECK_NS, IN_A_ROW, MovedWatch  # isort: skip

SIZE = (640, 480)
PERSON = np.array([[250.0, 100.0], [350.0, 100.0], [300.0, 400.0], [np.nan, np.nan]])


def room(seed=3):
    """(H, W, 3) a picture with corners and edges, larger than the camera sees."""
    rng = np.random.default_rng(seed)
    picture = np.full((800, 1000, 3), 120, np.uint8)
    for _ in range(150):
        x, y = rng.integers(0, 1000), rng.integers(0, 800)
        w, h = rng.integers(10, 120, 2)
        colour = [int(c) for c in rng.integers(0, 255, 3)]
        cv2.rectangle(picture, (int(x), int(y)), (int(x + w), int(y + h)), colour, -1)
    return picture


def seen(background, shift=(0.0, 0.0), turn=0.0, light=1.0, person=None, noise=3.0, seed=0):
    """What the camera sees: with noise, another light, and a person somewhere."""
    matrix = cv2.getRotationMatrix2D((500, 400), turn, 1.0)
    matrix[:, 2] -= np.array([180, 160]) + shift
    pixels = cv2.warpAffine(background, matrix, SIZE).astype(np.float64) * light
    pixels += np.random.default_rng(seed).normal(0, noise, pixels.shape)
    if person is not None:
        texture = np.random.default_rng(9).integers(0, 255, (20, 7, 3), np.uint8)
        x, y = person
        patch = cv2.resize(texture, (100, 300), interpolation=cv2.INTER_NEAREST)
        pixels[y : y + 300, x : x + 100] = patch
    return np.clip(pixels, 0, 255).astype(np.uint8)


def verdicts(watch, pictures, people=(), begin=0):
    return [
        watch.judge(image(k, k * CHECK_NS, pixels), people) is not None
        for k, pixels in enumerate(pictures, start=begin)
    ]


@pytest.mark.parametrize(
    "moved", [{"shift": (15.0, 0.0)}, {"shift": (0.0, 60.0)}, {"turn": 3.0}], ids=str
)
def test_a_camera_that_was_moved_is_noticed_until_it_is_put_back(moved):
    background, watch = room(), MovedWatch()
    assert not any(verdicts(watch, [seen(background, seed=k) for k in range(4)]))
    after = verdicts(watch, [seen(background, **moved, seed=k) for k in range(5)], begin=4)
    assert after == [False] * (IN_A_ROW - 1) + [True] * (6 - IN_A_ROW)
    back = verdicts(watch, [seen(background, seed=k) for k in range(5)], begin=9)
    assert back == [True] * (IN_A_ROW - 1) + [False] * (6 - IN_A_ROW)


@pytest.mark.parametrize(
    "changed",
    [{"shift": (3.0, 2.0)}, {"light": 0.6}, {"light": 1.3}, {"noise": 8.0}, {"turn": 0.3}],
    ids=str,
)
def test_noise_another_light_and_a_trembling_mount_are_no_move(changed):
    background, watch = room(), MovedWatch()
    pictures = [seen(background), *(seen(background, **changed, seed=k) for k in range(1, 8))]
    assert not any(verdicts(watch, pictures))


def test_people_who_walk_do_not_count_even_before_a_plain_wall():
    wall, watch = np.full((800, 1000, 3), 120, np.uint8), MovedWatch()
    for k in range(10):
        x = 100 + 30 * k
        people = [np.array([[x, 100.0], [x + 100, 100.0], [x + 50, 400.0]])]
        pixels = seen(wall, person=(x, 100), noise=1.0, seed=k)
        assert watch.judge(image(k, k * CHECK_NS, pixels), people) is None


def test_a_camera_that_looks_elsewhere_was_moved():
    watch = MovedWatch()
    after = verdicts(watch, [seen(room()), *(seen(room(10), seed=k) for k in range(5))])
    assert after == [False] * IN_A_ROW + [True] * (6 - IN_A_ROW)


def test_checks_of_a_background_without_texture_are_counted():
    wall, watch = np.full((800, 1000, 3), 120, np.uint8), MovedWatch()
    assert not any(verdicts(watch, [seen(wall, noise=0.5, seed=k) for k in range(5)]))
    assert watch.summary() == {"checks": 5, "undecided": 5}


def test_it_looks_twice_a_second():
    background, watch = room(), MovedWatch()
    watch.judge(image(0, 0, seen(background)), ())
    moved = seen(background, shift=(40.0, 0.0))
    for k in range(1, 3 * IN_A_ROW):  # 10 a second
        assert watch.judge(image(k, k * CHECK_NS // 5, moved), ()) is None
