"""Pictures of a chessboard by a camera that is known."""

from functools import cache

import cv2
import numpy as np

from hri_drivers.camera.calibration.board import DOTS_PER_M, Board, draw
from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.seen import UInt8
from hri_predict.base.arrays import Floats

BOARD = Board()
SHRUNK = 0.25
"""Pixels per pixel of the printed sheet."""
CAMERA = Camera(
    matrix=np.array([[560.0, 0, 325], [0, 562, 236], [0, 0, 1]]),
    size=(640, 480),
    distortion=np.array([-0.2, 0.05, 0.0005, -0.001, 0.0]),
)


@cache
def _rays() -> Floats:
    x, y = np.meshgrid(np.arange(640.0), np.arange(480.0))
    return np.dstack([CAMERA.rays(np.dstack([x, y])), np.ones_like(x)])


@cache
def _sheet() -> UInt8:
    sheet = draw(BOARD)
    small = cv2.resize(sheet, None, fx=SHRUNK, fy=SHRUNK, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def photograph(optical_from_board: Floats) -> UInt8:
    """Return what CAMERA sees of BOARD at a pose (4, 4): the sheet, on a grey table."""
    board_from_optical = np.linalg.inv(optical_from_board)
    ways = _rays() @ board_from_optical[:3, :3].T
    eye = board_from_optical[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = -eye[2] / ways[..., 2]
    at = np.where(reach[..., None] > 0, eye + reach[..., None] * ways, 1e3)[..., :2]
    side = round(BOARD.square_m * DOTS_PER_M)
    first = round(0.7 * side) + side - 0.5  # the first inner corner is between two pixels
    full = first + at * [1, -1] / BOARD.square_m * side
    pixels = (full + 0.5) * SHRUNK - 0.5
    mapped = pixels.astype(np.float32)
    picture = cv2.remap(
        _sheet(), mapped[..., 0], mapped[..., 1], cv2.INTER_LINEAR, borderValue=(120,)
    )
    noise = np.random.default_rng(0).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (3, 3), 0.6) + noise, 0, 255).astype(np.uint8)


def facing(x: float, y: float, z: float, *, tilt: float = 0.0, turn: float = 0.0) -> Floats:
    """Return the pose of a board whose middle is at x, y, z; it faces the camera, then tilts.

    Degrees: about its own x axis, and about its y axis.
    """
    pose = np.eye(4)
    a, _ = cv2.Rodrigues(np.radians([tilt, 0.0, 0.0]))
    b, _ = cv2.Rodrigues(np.radians([0.0, turn, 0.0]))
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ a @ b
    pose[:3, 3] = [x, y, z] - pose[:3, :3] @ BOARD.points.mean(axis=0)
    return pose


VIEWS = [
    facing(-0.12, -0.08, 0.55, tilt=30), facing(0.12, 0.08, 0.6, tilt=-30),
    facing(0.1, -0.1, 0.6, turn=35), facing(-0.12, 0.1, 0.65, turn=-35),
    facing(0, 0, 0.4, tilt=20, turn=20), facing(0.05, 0.02, 0.7, tilt=-25, turn=25),
    facing(-0.05, 0, 0.5, tilt=25, turn=-25), facing(0.02, -0.03, 0.45, tilt=-20, turn=-20),
]  # fmt: skip
