"""Intrinsics from images of a chessboard, and the camera's pose from one of them.

Z. Zhang, "A flexible new technique for camera calibration", IEEE PAMI 22(11), 2000, as implemented
in OpenCV's ``calibrateCamera``; the pose from T. Collins and A. Bartoli, "Infinitesimal plane-based
pose estimation", International Journal of Computer Vision 109, 2014 (``SOLVEPNP_IPPE``).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from hri_drivers.camera.calibration.board import Board, find
from hri_drivers.camera.pixels import read_picture
from hri_drivers.camera.place.camera import OPTICAL_FROM_REP103, Camera
from hri_drivers.camera.place.placed import SIGMAS_99
from hri_drivers.camera.seen import UInt8
from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import MAX_ROOM_M, Pose
from hri_predict.cli.register.solve import quaternion

ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
MIN_VIEWS, MAX_PICTURES = 6, 200
SIMILAR = 0.02
"""Two views are the same if their corners are on average closer than this fraction of the picture's
width."""
MIN_COVER = 4
"""Minimum number, of the image's nine parts, in which some view has a corner."""
MIN_TILT_DEG = 15.0
"""If all boards are parallel to the image, focal length and distance cannot be separated."""
MAX_ERROR_PX, MAX_VIEW_RATIO = 1.5, 3.0
MIN_FOCAL_ERROR, MAX_FOCAL_ERROR = 0.005, 0.05
MAX_POSE_ERROR_PX = 3.0
TWOFOLD = 1.5
"""A distant board fits two tilts; the better one must fit better by this factor."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighted:
    """The board in one image.

    Attributes:
        name: name of the file.
        corners: (N, 2) pixels.
        size: width and height of the image.
    """

    name: str
    corners: Floats
    size: tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A calibrated camera.

    Attributes:
        error_px: root mean square of the reprojection error.
        used: file -> reprojection error in that file.
        left_out: file -> reason.
    """

    camera: Camera
    error_px: float
    used: dict[str, float]
    left_out: dict[str, str]


def pictures_of(folder: Path) -> list[Path]:
    """Return the images of a folder by name.

    Raises:
        ConfigError: the folder is missing, is not a folder, or has no or too many images.
    """
    if not folder.is_dir():
        raise ConfigError(f"--images {folder}: not a folder; name one with images of the board")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    if not 0 < len(found) <= MAX_PICTURES:
        raise ConfigError(
            f"--images {folder}: has {len(found)} images ({', '.join(ENDINGS)}); 15 to 30 of "
            f"the board are best, and {MAX_PICTURES} is the maximum"
        )
    return found


def read_gray(path: Path) -> UInt8 | None:
    """Return an image (H, W) in grey; None if the file is not an image.

    Raises:
        ConfigError: the file does not exist.
    """
    data = read_picture(path, cv2.IMREAD_GRAYSCALE)
    return None if data is None else data.astype(np.uint8)


def calibrate(paths: Sequence[Path], board: Board) -> Calibration:
    """Return the camera that took these images of the board.

    Raises:
        ConfigError: too few images show the board, or the images are too similar or do not fit.
    """
    views, left_out = _views(paths, board)
    while True:
        if len(views) < MIN_VIEWS:
            why = "; ".join(f"{name}: {text}" for name, text in left_out.items())
            raise ConfigError(
                f"{len(views)} of {len(paths)} images can be used, at least {MIN_VIEWS} are "
                f"needed, preferably 15 with the board in different places and tilts{_listed(why)}"
            )
        found, tilts = _solved(views, board, left_out)
        worst = max(found.used, key=lambda name: found.used[name])
        others = float(np.median(list(found.used.values())))
        if found.used[worst] <= max(MAX_VIEW_RATIO * others, 0.5):
            break
        left_out[worst] = (
            f"corners {found.used[worst]:.2f} pixels off, the others {others:.2f}: blurred, or the "
            f"board was bent"
        )
        views = [view for view in views if view.name != worst]
    _check(found, tilts, views)
    return found


def _listed(why: str) -> str:
    return f" ({why[:400]})" if why else ""


def _views(paths: Sequence[Path], board: Board) -> tuple[list[Sighted], dict[str, str]]:
    """Return the images with distinct views of the board, and why every other image is left out."""
    views: list[Sighted] = []
    left_out: dict[str, str] = {}
    for path in paths:
        gray = read_gray(path)
        if gray is None:
            left_out[path.name] = "not an image"
            continue
        size = gray.shape[1], gray.shape[0]
        if views and size != views[0].size:
            left_out[path.name] = (
                f"{size[0]} x {size[1]} pixels, {views[0].name} has "
                f"{views[0].size[0]} x {views[0].size[1]}"
            )
            continue
        corners = find(gray, board)
        if corners is None:
            left_out[path.name] = (
                f"no board with {board.columns} x {board.rows} inner corners is fully visible"
            )
            continue
        twin = next((v.name for v in views if _similar(v.corners, corners, size[0])), None)
        if twin is not None:
            left_out[path.name] = f"the same view as {twin}"
            continue
        views.append(Sighted(path.name, corners, size))
    return views, left_out


def _similar(one: Floats, other: Floats, width: int) -> bool:
    return float(np.linalg.norm(one - other, axis=1).mean()) < SIMILAR * width


def _solved(
    views: Sequence[Sighted], board: Board, left_out: dict[str, str]
) -> tuple[Calibration, list[float]]:
    """Return the calibration, and for each view the angle in degrees between board and image."""
    points = [board.points.astype(np.float32)] * len(views)
    corners = [view.corners.astype(np.float32)[:, None] for view in views]
    size = views[0].size
    try:
        rms, matrix, distortion, turns, _, deviations, _, errors = cv2.calibrateCameraExtended(
            points, corners, size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
    except cv2.error:
        raise ConfigError(
            "no camera model fits these images: are they from one camera with one zoom, and is "
            "the board flat?"
        ) from None
    tilts = [
        math.degrees(math.acos(min(1.0, abs(float(cv2.Rodrigues(turn)[0][2, 2])))))
        for turn in turns
    ]
    intrinsics: Floats = np.array(matrix, np.float64)
    doubt = float((deviations.ravel()[:2] / intrinsics[[0, 1], [0, 1]]).max())
    camera = Camera(
        matrix=intrinsics,
        size=size,
        distortion=np.asarray(distortion, np.float64).ravel()[:5],
        focal_error=max(MIN_FOCAL_ERROR, SIGMAS_99 * doubt),
    )
    used = {v.name: float(e) for v, e in zip(views, errors.ravel(), strict=True)}
    return Calibration(camera, float(rms), used, left_out), tilts


def _check(found: Calibration, tilts: Sequence[float], views: Sequence[Sighted]) -> None:
    """Refuse a calibration that its views do not support.

    Raises:
        ConfigError: the views cover too little of the picture, tilt too little, or are too
            inaccurate or too similar.
    """
    every = np.concatenate([view.corners for view in views])
    cells = np.floor(3 * every / np.array(views[0].size)).clip(0, 2)
    cover = len(np.unique(cells, axis=0))
    if cover < MIN_COVER:
        raise ConfigError(
            f"the board was only in {cover} of the 9 parts of the image: also take pictures with "
            f"it near the edges"
        )
    if max(tilts) < MIN_TILT_DEG:
        raise ConfigError(
            f"the board was never tilted by more than {max(tilts):.0f} degrees: take pictures "
            f"with it tilted by 20 to 45 degrees in all directions"
        )
    if not found.error_px <= MAX_ERROR_PX:
        raise ConfigError(
            f"the corners are {found.error_px:.1f} pixels off on average, the limit is "
            f"{MAX_ERROR_PX:g}: is the board flat, the image sharp and the zoom fixed?"
        )
    if not found.camera.focal_error <= MAX_FOCAL_ERROR:
        raise ConfigError(
            f"the focal length is only known to {100 * found.camera.focal_error:.0f} %: the views "
            f"are too similar; tilt the board more, and take more pictures"
        )


def pose_of(
    gray: UInt8, camera: Camera, board: Board, room_from_board: Floats
) -> tuple[Camera, float]:
    """Return the camera with its pose in the room, and the reprojection error in pixels.

    Args:
        gray: (H, W) image of the board.
        camera: calibrated, for images of this shape.
        board: the board in the image.
        room_from_board: (4, 4) pose of the board, in the axes of ``Board.points``.

    Raises:
        ConfigError: the board is not seen, or not well enough.
    """
    camera = camera.of_size(gray.shape[1], gray.shape[0])
    corners = find(gray, board)
    if corners is None:
        raise ConfigError(
            f"no board with {board.columns} x {board.rows} inner corners is fully visible"
        )
    _, turns, shifts, errors = cv2.solvePnPGeneric(
        board.points, corners, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    errors = np.asarray(errors).ravel()
    if not errors[0] <= MAX_POSE_ERROR_PX:
        raise ConfigError(
            f"the board's corners are {errors[0]:.1f} pixels off: is this the calibrated camera, "
            f"and is --square right?"
        )
    if len(errors) > 1 and errors[1] < TWOFOLD * errors[0]:
        raise ConfigError(
            "the board is too small in the image for its tilt to be seen: move it closer, or "
            "use a larger one"
        )
    turn, shift = cv2.solvePnPRefineLM(
        board.points, corners, camera.matrix, camera.distortion, turns[0], shifts[0]
    )
    optical_from_board = np.eye(4)
    optical_from_board[:3, :3] = cv2.Rodrigues(turn)[0]
    optical_from_board[:3, 3] = np.asarray(shift).ravel()
    matrix = room_from_board @ np.linalg.inv(optical_from_board)
    matrix[:3, :3] = matrix[:3, :3] @ OPTICAL_FROM_REP103
    if np.abs(matrix[:3, 3]).max() > MAX_ROOM_M:
        raise ConfigError(
            "the camera would be more than 100 m away: are --at and --square in metres?"
        )
    pose = Pose(
        xyz=[round(float(v), 4) + 0.0 for v in matrix[:3, 3]],
        quaternion_xyzw=[round(float(v), 6) + 0.0 for v in quaternion(matrix[:3, :3])],
    )
    return replace(camera, pose=pose), float(errors[0])


def room_from_board(at: Floats, turned_deg: float, upright: bool) -> Floats:
    """Return (4, 4) the pose of a board whose origin is ``at`` (3,), metres.

    Args:
        turned_deg: direction of the board's x axis, counter-clockwise from the room's, seen from
            above.
        upright: the board stands with its top up; otherwise it lies face up.
    """
    cosine, sine = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg))
    right = np.array([cosine, sine, 0.0])
    up = np.array([0.0, 0.0, 1.0]) if upright else np.array([-sine, cosine, 0.0])
    matrix = np.eye(4)
    matrix[:3, :4] = np.column_stack([right, up, np.cross(right, up), at])
    return matrix
