"""The calibration by rendered pictures of a chessboard, whose camera is known."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

cv2 = pytest.importorskip("cv2", reason="pip install 'hri-predict[camera]'")

from hri_drivers.camera.calibration.board import Board, find, write_sheet  # noqa: E402
from hri_drivers.camera.calibration.command import app  # noqa: E402
from hri_drivers.camera.calibration.solving import (  # noqa: E402
    calibrate,
    pictures_of,
    pose_of,
    room_from_board,
)
from hri_drivers.camera.place.camera import OPTICAL_FROM_REP103, read_camera  # noqa: E402
from hri_predict.base.errors import ConfigError  # noqa: E402
from tests.hri_drivers.camera.calibration.photographs import (  # noqa: E402
    BOARD,
    CAMERA,
    VIEWS,
    facing,
    photograph,
)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """A folder with the board in eight views, and some pictures that are of no use."""
    folder = tmp_path_factory.mktemp("pictures")
    for number, view in enumerate(VIEWS):
        cv2.imwrite(str(folder / f"{number}.png"), photograph(view))
    again = cv2.imread(str(folder / "3.png"))
    cv2.imwrite(str(folder / "3_again.png"), again)
    cv2.imwrite(str(folder / "half.png"), again[:, :320])
    cv2.imwrite(str(folder / "table.png"), np.full_like(again, 120))
    (folder / "text.png").write_text("not a picture")
    (folder / "notes.txt").write_text("not looked at")
    return folder


@pytest.fixture(scope="module")
def solved(pictures, tmp_path_factory):
    path = tmp_path_factory.mktemp("solved") / "camera.yaml"
    line = f"solve --images {pictures} --square 0.025 --out {path} --json".split()
    result = CliRunner().invoke(app, line, catch_exceptions=False)
    return path, json.loads(result.stdout)


def test_a_file_that_is_not_a_camera_is_not_replaced(pictures, tmp_path):
    """Such as the node's configuration, which a guide also calls by the camera."""
    cell = tmp_path / "camera.yaml"
    cell.write_text("rate_hz: 25\nsource: {kind: udp}\n")
    line = f"solve --images {pictures} --square 0.025 --out {cell}".split()
    result = CliRunner().invoke(app, line)
    assert isinstance(result.exception, ConfigError)
    assert str(result.exception) == (
        f"{cell}: exists and is not a camera file; name another file with --out"
    )
    assert "kind: udp" in cell.read_text()


def test_the_camera_is_the_one_that_took_the_pictures(solved):
    path, shown = solved
    camera = read_camera(path)
    off = np.abs(camera.matrix[[0, 1], [0, 1]] / CAMERA.matrix[[0, 1], [0, 1]] - 1)
    assert off.max() < camera.focal_error < 0.03
    assert np.abs(camera.matrix[:2, 2] - CAMERA.matrix[:2, 2]).max() < 6  # a hundredth of the width
    x, y = np.meshgrid(np.linspace(40, 600, 8), np.linspace(40, 440, 6))
    corners = np.stack([x, y], axis=-1)
    assert np.abs(camera.rays(corners) - CAMERA.rays(corners)).max() < 0.02  # a degree
    assert shown["error_px"] < 0.4
    assert sorted(shown["used"]) == [f"{number}.png" for number in range(8)]


def test_each_useless_picture_is_named_with_the_reason(solved):
    left_out = solved[1]["left_out"]
    assert left_out.keys() == {"3_again.png", "half.png", "table.png", "text.png"}
    assert "same view as 3.png" in left_out["3_again.png"]
    assert "320 x 480" in left_out["half.png"]
    assert "no board with 9 x 6" in left_out["table.png"]
    assert left_out["text.png"] == "not an image"


def test_too_few_pictures_are_refused(pictures):
    with pytest.raises(ConfigError, match=r"3 of 4 images can be used.*not an image"):
        calibrate([*pictures_of(pictures)[:3], pictures / "text.png"], BOARD)


def test_a_board_that_was_never_tilted_is_refused(tmp_path):
    for number, (x, y) in enumerate([(0, 0), (0.12, 0.1), (-0.12, -0.1), (0.1, -0.1),
                                     (-0.1, 0.1), (0.05, 0)]):  # fmt: skip
        cv2.imwrite(str(tmp_path / f"{number}.png"), photograph(facing(x, y, 0.6)))
    with pytest.raises(ConfigError, match="tilt"):
        calibrate(pictures_of(tmp_path), BOARD)


def test_a_folder_without_pictures_is_refused(tmp_path):
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(ConfigError, match="--images"):
            pictures_of(folder)


@pytest.mark.parametrize(("turned", "upright"), [(0.0, False), (-60.0, True)])
def test_the_pose_is_where_the_camera_stood(turned, upright):
    """Upside-down too: half a turn of the board is half a turn of the camera about it."""
    known = room_from_board(np.array([1.0, 2.0, 0.8]), turned, upright)
    view = facing(0.03, -0.02, 0.5, tilt=30, turn=10)
    spun = np.diag([-1.0, -1.0, 1.0, 1.0]) @ view  # the camera rolled by half a turn
    for optical_from_board in (view, spun):
        placed, error_px = pose_of(photograph(optical_from_board), CAMERA, BOARD, known)
        truth = known @ np.linalg.inv(optical_from_board)
        assert error_px < 0.5
        found = placed.room_from_optical()
        np.testing.assert_allclose(found[:3, 3], truth[:3, 3], atol=0.005)
        cosine = (np.trace(found[:3, :3].T @ truth[:3, :3]) - 1) / 2
        assert math.degrees(math.acos(min(1.0, cosine))) < 0.5


def test_a_board_lies_face_up_or_stands_top_up():
    lying, standing = (room_from_board(np.zeros(3), 90.0, upright) for upright in (False, True))
    np.testing.assert_allclose(lying[:3, :3].T, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(standing[:3, :3].T, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-12)


def test_the_command_writes_the_pose_and_prints_it(solved, tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(solved[0].read_text())
    picture = tmp_path / "board.png"
    above = facing(0.03, -0.02, 0.5, tilt=30)
    cv2.imwrite(str(picture), photograph(above))
    line = f"pose --camera {path} --image {picture} --square 0.025 --at 1,2,0.8".split()
    result = CliRunner().invoke(app, line, catch_exceptions=False)
    pose = read_camera(path).pose
    assert pose is not None
    assert "room_from_source: {xyz: [" in result.stdout
    ahead = pose.matrix()[:3, :3] @ [1, 0, 0]  # x of REP-103 is where it looks
    truth = np.linalg.inv(above)[:3, :3] @ OPTICAL_FROM_REP103 @ [1, 0, 0]
    assert ahead @ truth > math.cos(math.radians(1))
    assert pose.xyz[2] > 0.8


def test_a_pose_from_an_image_of_another_shape_names_a_remedy_that_the_command_has(tmp_path):
    path, picture = tmp_path / "camera.yaml", tmp_path / "board.png"
    path.write_text("{width: 640, height: 480, focal: [500, 500], centre: [320, 240]}")
    cv2.imwrite(str(picture), np.zeros((360, 640), np.uint8))
    line = f"pose --camera {path} --image {picture} --square 0.025 --at 1,2,0.8".split()
    said = str(CliRunner().invoke(app, line).exception)
    assert "use images of 640 x 480 or of the same shape, or calibrate again" in said
    assert "--size" not in said


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"columns": 8, "rows": 6}, "--rows 6"),
        ({"columns": 2}, "--columns"),
        ({"rows": 50}, "--rows"),
        ({"square_m": 25.0}, "--square"),
        ({"square_m": float("nan")}, "--square"),
    ],
)
def test_a_board_that_cannot_be_used_is_refused(arguments, named):
    with pytest.raises(ConfigError, match=named):
        Board(**arguments)


def test_the_sheet_knows_its_size_and_is_found(tmp_path):
    path = tmp_path / "board.png"
    small = Board(columns=5, rows=4, square_m=0.02)
    write_sheet(path, small)
    data = path.read_bytes()
    at = data.index(b"pHYs") + 4
    assert int.from_bytes(data[at : at + 4], "big") == 11811  # 300 dots per inch, per metre
    corners = find(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), small)
    assert corners is not None
    side = np.linalg.norm(corners[1] - corners[0])
    assert side == pytest.approx(0.02 * 11811, abs=1)
    assert corners[0, 0] < corners[4, 0]  # the first corner is the left one of the upper row
    assert corners[0, 1] < corners[5, 1]
    with pytest.raises(ConfigError, match=r"\.png"):
        write_sheet(tmp_path / "board.pdf", small)
    with pytest.raises(ConfigError, match="sides of more than 2 m"):
        write_sheet(path, Board(square_m=0.9))


@pytest.mark.parametrize("shape", [(1, 1), (10, 3), (480, 640)])
def test_pictures_without_a_board_have_no_corners(shape):
    noise = np.random.default_rng(0).integers(0, 255, shape, np.uint8)
    assert find(noise, BOARD) is None
