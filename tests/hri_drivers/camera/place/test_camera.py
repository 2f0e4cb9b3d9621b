"""The camera's geometry and its file."""

from dataclasses import replace

import numpy as np
import pytest

from hri_drivers.camera.place.camera import Camera, guessed_camera, read_camera, write_camera
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Pose

BENT = Camera(
    matrix=np.array([[600.0, 0, 310], [0, 610, 250], [0, 0, 1]]),
    size=(640, 480),
    distortion=np.array([-0.3, 0.1, 0.001, -0.002, -0.01]),
    focal_error=0.01,
    pose=Pose(xyz=[1.0, 2.0, 2.5], quaternion_xyzw=[0.0, 0.0, 0.6, 0.8]),
)


KINECTS = replace(  # an Azure Kinect's colours at 1280 x 720, by its SDK
    BENT,
    matrix=np.array([[611.795, 0, 639.304], [0, 611.927, 365.853], [0, 0, 1]]),
    size=(1280, 720),
    distortion=np.array(
        [
            0.3301213,
            -2.4893966,
            -1.617824e-4,
            -1.294453e-4,
            1.4536709,
            0.2089121,
            -2.3029151,
            1.3751276,
        ]
    ),
)


@pytest.mark.parametrize("camera", [BENT, KINECTS])
def test_rays_lead_back_to_their_pixels(camera):
    x, y = np.meshgrid(
        *(np.linspace(0, n - 1, k) for n, k in zip(camera.size, (9, 7), strict=True))
    )
    pixels = np.stack([x, y], axis=-1)
    points = np.concatenate([camera.rays(pixels), np.ones((7, 9, 1))], axis=-1)
    np.testing.assert_allclose(camera.project(points * 3), pixels, atol=1e-3)  # 1e-6 of the focal


@pytest.mark.parametrize("camera", [BENT, KINECTS])
def test_the_distortion_is_opencvs(camera):
    cv2 = pytest.importorskip("cv2", reason="pip install 'hri-predict[camera]'")
    points = np.random.default_rng(1).uniform([-1, -1, 2], [1, 1, 4], (50, 3))
    theirs, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion
    )
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], atol=1e-9)


def test_a_kinects_points_lie_where_its_sdk_shows_them():
    points = np.array([[0.8, 0.4, 3.0], [-1.5, -0.7, 3.0]])
    theirs = [[803.949, 448.188], [325.807, 219.504]]  # k4a_calibration_3d_to_2d
    np.testing.assert_allclose(KINECTS.project(points), theirs, atol=0.01)


def test_a_pixel_outside_or_that_the_distortion_cannot_reach_has_no_ray():
    assert np.isnan(BENT.rays(np.array([[700.0, 10.0], [np.nan, 3.0]]))).all()
    folded = replace(BENT, distortion=np.array([-2.0, 0, 0, 0, 0]))
    assert np.isnan(folded.rays(np.array([639.0, 479.0]))).all()


def test_the_file_holds_the_camera(tmp_path):
    write_camera(tmp_path / "camera.yaml", BENT)
    again = read_camera(tmp_path / "camera.yaml")
    np.testing.assert_allclose(again.matrix, BENT.matrix, atol=1e-3)
    np.testing.assert_allclose(again.distortion, BENT.distortion, atol=1e-6)
    assert (again.size, again.focal_error, again.pose) == (BENT.size, 0.01, BENT.pose)


def test_another_size_of_the_same_shape_sees_the_same_rays():
    half = BENT.of_size(320, 240)
    middle = np.array([100.0, 50.0])
    np.testing.assert_allclose(half.rays((middle + 0.5) / 2 - 0.5), BENT.rays(middle), atol=1e-9)
    with pytest.raises(ConfigError, match="320 x 180"):
        BENT.of_size(320, 180)


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("focal: [5, 600]", "focal: 5 is not"),
        ("focal: [600]", "focal"),
        ("centre: [310, 900]", "centre"),
        ("distortion: [1, 2]", "distortion"),
        ("focal_error: 0", "focal_error"),
        ("lens: wide", "lens"),
    ],
)
def test_a_wrong_file_is_refused_by_one_line(tmp_path, line, named):
    path = tmp_path / "camera.yaml"
    key = line.partition(":")[0]
    good = {"width": "640", "height": "480", "focal": "[600, 610]", "centre": "[310, 250]"}
    good.pop(key, None)
    path.write_text("\n".join([*(f"{k}: {v}" for k, v in good.items()), line]))
    with pytest.raises(ConfigError, match=named) as caught:
        read_camera(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_guess_says_how_little_it_knows():
    assert guessed_camera(640, 360).focal_error > guessed_camera(640, 360, 70).focal_error
    with pytest.raises(ConfigError, match="field of view"):
        guessed_camera(640, 480, 170)


@pytest.mark.parametrize("size", [(640, 480), (480, 480), (960, 720)])
def test_the_error_of_a_stated_angle_holds_images_that_lack_the_sides(size):
    """A webcam of 70 degrees at 16:9 cuts 640 x 480 out of its images."""
    width, height = size
    whole = guessed_camera(round(height * 16 / 9), height, 70)  # before the sides are cut off
    found = guessed_camera(width, height, 70)
    wrong = whole.matrix[0, 0] / found.matrix[0, 0] - 1
    assert whole.focal_error < 0.07
    assert wrong < found.focal_error < wrong + 0.12


@pytest.mark.parametrize("field_of_view_deg", [None, 70])
def test_a_portrait_picture_is_that_of_a_camera_turned_on_its_side(field_of_view_deg):
    upright = guessed_camera(360, 640, field_of_view_deg)
    level = guessed_camera(640, 360, field_of_view_deg)
    assert upright.matrix[0, 0] == upright.matrix[1, 1] == level.matrix[0, 0]
    assert upright.focal_error == level.focal_error
    assert upright.matrix[:2, 2].tolist() == [179.5, 319.5]


def test_a_camera_without_a_pose_is_not_in_the_room():
    with pytest.raises(ConfigError, match="no pose"):
        guessed_camera(640, 480).room_from_optical()
    ahead = BENT.room_from_optical() @ [0, 0, 1, 1]  # a metre away from the camera
    np.testing.assert_allclose(ahead[:3], [1 + 0.28, 2 + 0.96, 2.5], atol=1e-9)
