"""Cameras that are moved, and what only looks like it."""

import numpy as np
import pytest

from tests.hri_drivers.camera.pictures import cv2, image

from hri_drivers.camera.place.camera import guessed_camera  # isort: skip
from hri_drivers.camera.moved import CHECK_NS, IN_A_ROW, MovedWatch  # isort: skip

SIZE = (640, 480)
CAMERA = guessed_camera(*SIZE, 64)
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
    background, watch = room(), MovedWatch(CAMERA)
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
    background, watch = room(), MovedWatch(CAMERA)
    pictures = [seen(background), *(seen(background, **changed, seed=k) for k in range(1, 8))]
    assert not any(verdicts(watch, pictures))


def turned(background, camera, axis, degrees):
    """What the camera sees of a far background after a turn about its x, y or z axis."""
    rotation, _ = cv2.Rodrigues(np.radians(degrees) * np.eye(3)["xyz".index(axis)])
    whole = camera.matrix.copy()
    whole[:2, 2] = 500, 400
    ways = camera.matrix @ rotation @ np.linalg.inv(whole)
    return cv2.warpPerspective(background, ways, SIZE, borderMode=cv2.BORDER_REFLECT)


@pytest.mark.parametrize("view_deg", [45, 64, 90, 110])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize(("degrees", "is_moved"), [(1.0, True), (-1.1, True), (0.5, False)])
def test_a_turn_by_a_degree_is_noticed_however_wide_the_lens(view_deg, axis, degrees, is_moved):
    camera, wrong = guessed_camera(*SIZE, view_deg), 0
    for seed in (3, 4):
        background, watch = room(seed), MovedWatch(camera)
        pixels = turned(background, camera, axis, 0.0)
        after = turned(background, camera, axis, degrees)
        rng = np.random.default_rng(seed)
        pictures = [
            np.clip(each + rng.normal(0, 3, each.shape), 0, 255).astype(np.uint8)
            for each in (pixels, *[after] * (IN_A_ROW + 1))
        ]
        wrong += verdicts(watch, pictures)[-1] != is_moved
    assert wrong == 0


def test_people_who_walk_do_not_count_even_before_a_plain_wall():
    wall, watch = np.full((800, 1000, 3), 120, np.uint8), MovedWatch(CAMERA)
    for k in range(10):
        x = 100 + 30 * k
        people = [np.array([[x, 100.0], [x + 100, 100.0], [x + 50, 400.0]])]
        pixels = seen(wall, person=(x, 100), noise=1.0, seed=k)
        assert watch.judge(image(k, k * CHECK_NS, pixels), people) is None


def test_a_camera_that_looks_elsewhere_was_moved():
    watch = MovedWatch(CAMERA)
    after = verdicts(watch, [seen(room()), *(seen(room(10), seed=k) for k in range(5))])
    assert after == [False] * IN_A_ROW + [True] * (6 - IN_A_ROW)


def test_checks_of_a_background_without_texture_are_counted():
    wall, watch = np.full((800, 1000, 3), 120, np.uint8), MovedWatch(CAMERA)
    assert not any(verdicts(watch, [seen(wall, noise=0.5, seed=k) for k in range(5)]))
    assert watch.summary() == {"checks": 5, "undecided": 5}


def test_it_looks_twice_a_second():
    background, watch = room(), MovedWatch(CAMERA)
    watch.judge(image(0, 0, seen(background)), ())
    moved = seen(background, shift=(40.0, 0.0))
    for k in range(1, 3 * IN_A_ROW):  # 10 a second
        assert watch.judge(image(k, k * CHECK_NS // 5, moved), ()) is None
