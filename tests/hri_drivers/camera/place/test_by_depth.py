"""Depth images: the joints' depth, what stands behind and before them, and missing pixels."""

from dataclasses import replace

import numpy as np
import pytest

from hri_drivers.camera.place.by_depth import SKIN_M, place_by_depth, read_depth
from hri_drivers.camera.place.camera import guessed_camera
from hri_drivers.camera.place.placed import Placed, Unplaced
from hri_drivers.camera.seen import Seen
from hri_predict.base.errors import ConfigError
from tests.hri_drivers.camera.place.bodies import JOINTS, person

CAMERA = replace(guessed_camera(640, 480, 60), focal_error=0.06)
WALL_M = 4.5
PLACE = np.array([0.2, 0.0, 2.8])


def picture(half=5):
    """Return a person and his depth: at each joint a square of the skin, before a wall."""
    body = person() + PLACE
    pixels = CAMERA.project(body)
    depth = np.full((480, 640), WALL_M, np.float32)
    for (x, y), metres in sorted(zip(np.rint(pixels).astype(int).tolist(), body[:, 2], strict=True),
                                 key=lambda item: -item[1]):  # fmt: skip
        depth[max(y - half, 0) : y + half + 1, x - half : x + half + 1] = metres - SKIN_M
    return Seen(1, "mediapipe33", pixels, np.ones(33), None), depth


def off_m(found, joint):
    """Return how far a joint is from the truth; the squares of neighbours overlap by 10 cm."""
    assert isinstance(found, Placed)
    number = JOINTS.index(joint)
    assert found.observed[number]
    return float(np.linalg.norm(found.positions[number] - (person()[number] + PLACE)))


def placed_with(name: str, depth_m: float, around: int) -> Placed:
    """The person, with a surface of another depth at a joint and ``around`` pixels about it."""
    seen, depth = picture()
    x, y = np.rint(seen.pixels[JOINTS.index(name)]).astype(int)
    depth[y - around : y + around + 1, x - around : x + around + 1] = depth_m
    found = place_by_depth(seen, depth, CAMERA)
    assert isinstance(found, Placed)
    return found


@pytest.mark.parametrize("joint", ["left_knee", "right_wrist", "left_shoulder", "right_ankle"])
def test_joints_are_behind_the_skin_that_is_measured(joint):
    seen, depth = picture()
    found = place_by_depth(seen, depth, CAMERA)
    assert off_m(found, joint) < 0.15  # fingers before the wrist are 0.1 m nearer
    assert isinstance(found, Placed)
    assert 0.08 < found.error_m < 0.3


def test_the_wall_behind_a_thin_limb_does_not_count():
    seen, depth = picture(half=1)  # 9 of 49 pixels are the limb's
    found = place_by_depth(seen, depth, CAMERA)
    assert off_m(found, "left_knee") < 0.15


MISSING = [0.0, np.nan, np.inf, -1.0, 99.0]


@pytest.mark.parametrize(
    ("name", "depth_m"),
    [
        ("left_knee", WALL_M),
        ("left_elbow", 1.8),  # a robot's arm before it
        *(("left_hip", missing) for missing in MISSING),
    ],
)
def test_depth_that_is_not_the_bodys_places_no_joint(name, depth_m):
    found = placed_with(name, depth_m, 8)
    assert not found.observed[JOINTS.index(name)]
    assert found.observed[JOINTS.index("right_knee")]


@pytest.mark.parametrize(
    "name", ["left_index", "right_thumb", "left_foot_index", "right_heel", "left_ear", "nose"]
)
@pytest.mark.parametrize("depth_m", [3.6, 1.9])  # a thing behind it, and one before it
def test_a_hand_foot_or_head_that_is_too_far_from_the_body_is_not_observed(name, depth_m):
    found = placed_with(name, depth_m, 5)
    assert not found.observed[JOINTS.index(name)]
    side = "left" if name.startswith("right") else "right"
    for kept in ("wrist", "index", "ankle", "foot_index", "shoulder"):
        assert found.observed[JOINTS.index(f"{side}_{kept}")]


@pytest.mark.parametrize(
    ("carrier", "carried"),
    [
        ("left_wrist", ["left_index", "left_pinky", "left_thumb"]),
        ("right_ankle", ["right_heel", "right_foot_index"]),
        ("left_shoulder", ["left_ear", "left_eye"]),
    ],
)
def test_what_an_unobserved_joint_carries_is_not_observed(carrier, carried):
    seen, depth = picture()
    seen.visibility[JOINTS.index(carrier)] = 0.0
    found = place_by_depth(seen, depth, CAMERA)
    assert isinstance(found, Placed)
    assert not found.observed[[JOINTS.index(name) for name in carried]].any()
    assert found.observed[JOINTS.index("nose")]  # by the other shoulder


@pytest.mark.parametrize("missing", MISSING)
def test_a_picture_without_depth_is_not_a_place(missing):
    seen, depth = picture()
    assert isinstance(place_by_depth(seen, np.full_like(depth, missing), CAMERA), Unplaced)


def test_a_patch_of_many_depths_has_no_surface():
    seen, depth = picture()
    noise = np.random.default_rng(1).uniform(0.2, 14, depth.shape).astype(np.float32)
    found = place_by_depth(seen, noise, CAMERA)
    assert isinstance(found, Unplaced) or np.count_nonzero(found.observed) < 33


def test_the_stated_error_holds_what_a_wrong_focal_length_does_to_every_joint():
    """Also to a person in the middle of the picture, whose head and feet are not there."""
    body = person() + np.array([0.0, 0.0, 2.8])
    pixels = CAMERA.project(body)
    depth = np.full((480, 640), 2.8 - SKIN_M, np.float32)
    seen = Seen(1, "mediapipe33", pixels, np.ones(33), None)
    wrong = replace(CAMERA, matrix=CAMERA.matrix / [[1.36], [1.36], [1.0]])
    wrong.matrix[:2, 2] = CAMERA.matrix[:2, 2]
    exact = place_by_depth(seen, depth, replace(CAMERA, focal_error=0.0))
    off = place_by_depth(seen, depth, replace(wrong, focal_error=0.36))
    assert isinstance(exact, Placed)
    assert isinstance(off, Placed)
    assert exact.observed.all()
    assert off.observed.all()
    moved = np.linalg.norm(off.positions - exact.positions, axis=1).max()
    assert moved <= off.error_m - exact.error_m + 0.01


@pytest.mark.parametrize(
    ("focal_px", "baseline_m", "stated_m"),
    [(385, 0.05, 0.41), (640, 0.05, 0.28), (385, 0.095, 0.25)],  # D435, D435 at 1280 x 720, D455
)
def test_the_stated_error_of_stereo_grows_with_the_square_of_the_distance(
    focal_px, baseline_m, stated_m
):
    """z^2 * 0.08 px / (focal length * baseline) RMS, and 0.08 m and 2 % as for other depth."""
    pixels = CAMERA.project(person() + np.array([0.0, 0.0, 6.0]))
    seen = Seen(1, "mediapipe33", pixels, np.ones(33), None)
    stereo_error = 2.58 * 0.08 / (focal_px * baseline_m)
    far = np.full((480, 640), 6.0 - SKIN_M, np.float32)
    camera = replace(CAMERA, focal_error=0.0)
    found = place_by_depth(seen, far, camera, stereo_error)
    assert isinstance(found, Placed)
    assert found.error_m == pytest.approx(stated_m, abs=0.01)


def test_a_depth_picture_of_another_size_is_refused():
    seen, depth = picture()
    with pytest.raises(ConfigError, match="align"):
        place_by_depth(seen, depth[:240], CAMERA)


def test_depth_files_are_millimetres(tmp_path):
    cv2 = pytest.importorskip("cv2", reason="pip install 'hri-predict[camera]'")
    path = tmp_path / "depth.png"
    cv2.imwrite(str(path), np.array([[0, 1500], [65535, 2]], np.uint16))
    np.testing.assert_allclose(read_depth(path), [[np.nan, 1.5], [65.535, 0.002]], rtol=1e-6)
    for bad in (np.zeros((2, 2), np.uint8), np.zeros((2, 2, 3), np.uint16)):
        cv2.imwrite(str(path), bad)
        with pytest.raises(ConfigError, match="16-bit PNG"):
            read_depth(path)
    path.write_bytes(b"not a picture")
    with pytest.raises(ConfigError, match="not an image"):
        read_depth(path)
