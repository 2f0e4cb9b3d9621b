"""The chessboard: the sheet to print, and its corners in an image.

The number of squares is odd along one side and even along the other, so the board looks different
after half a turn: the square at the origin is black, the one in the opposite corner white.
"""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from hri_drivers.camera.seen import Float32, UInt8
from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write

MIN_CORNERS, MAX_CORNERS = 3, 40  # along a side
MIN_SQUARE_M, MAX_SQUARE_M = 0.002, 1.0
DOTS_PER_M = 11811  # 300 per inch
MAX_SIDE_M = 2.0
MIN_SIDE_PX = 64  # smaller images are refused by the detector with an exception
_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
_MARGIN = 0.7  # of a square, white around the board; the default sheet is 285 x 210 mm


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard, described by its inner corners.

    Attributes:
        columns, rows: inner corners along the long and the short side.
        square_m: side of a square, metres.

    Raises:
        ConfigError: the board is not usable.
    """

    columns: int = 9
    rows: int = 6
    square_m: float = 0.025

    def __post_init__(self) -> None:
        for flag, value in (("--columns", self.columns), ("--rows", self.rows)):
            if not MIN_CORNERS <= value <= MAX_CORNERS:
                raise ConfigError(
                    f"{flag}: must be {MIN_CORNERS} to {MAX_CORNERS} inner corners; got {value}"
                )
        if (self.columns + self.rows) % 2 == 0:
            raise ConfigError(
                f"--columns {self.columns}, --rows {self.rows}: one must be odd and the other "
                f"even, or the board looks the same after half a turn"
            )
        if not MIN_SQUARE_M <= self.square_m <= MAX_SQUARE_M:
            raise ConfigError(
                f"--square: must be {MIN_SQUARE_M:g} to {MAX_SQUARE_M:g} metres, the side of a "
                f"square; got {self.square_m:g}"
            )

    @property
    def points(self) -> Floats:
        """(N, 3) corners row by row: x right and y up on the sheet, z out of it; metres."""
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        return np.stack([column, -row, 0 * row], axis=1) * self.square_m


def draw(board: Board) -> UInt8:
    """Return the sheet (H, W), with its origin and x axis marked; ``DOTS_PER_M`` pixels a metre.

    Raises:
        ConfigError: the sheet is too large.
    """
    across, down = board.columns + 1, board.rows + 1
    if (across + 2 * _MARGIN) * board.square_m > MAX_SIDE_M:
        raise ConfigError(
            f"--square {board.square_m:g}: the sheet has sides of more than {MAX_SIDE_M:g} m; "
            f"use smaller or fewer squares"
        )
    side = round(board.square_m * DOTS_PER_M)
    margin = round(_MARGIN * side)
    sheet = np.full((down * side + 2 * margin, across * side + 2 * margin), 255, np.uint8)
    for row in range(down):
        for column in range(row % 2, across, 2):
            y, x = margin + row * side, margin + column * side
            sheet[y : y + side, x : x + side] = 0
    text, thick = side / 130, max(1, side // 90)
    x, y = margin + side, margin - side // 4
    cv2.arrowedLine(sheet, (x, y - side // 4), (x, margin - 4), 0, thick, cv2.LINE_AA)
    at = x + side // 5, y
    cv2.putText(sheet, "origin: the first inner corner below", at, 0, text, 0, thick, cv2.LINE_AA)
    label = (
        f"x ->  {board.columns} x {board.rows} inner corners, {board.square_m * 1e3:g} mm squares"
    )
    below = x, margin + down * side + side // 2
    cv2.putText(sheet, label, below, 0, text, 0, thick, cv2.LINE_AA)
    return sheet


def write_sheet(path: Path, board: Board) -> None:
    """Write the sheet as a PNG that states its size on paper.

    Raises:
        ConfigError: the path is not a .png, or the sheet is too large or cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise ConfigError(f"--out {path}: must end with .png")
    _, encoded = cv2.imencode(".png", draw(board))
    data = encoded.tobytes()
    body = b"pHYs" + struct.pack(">IIB", DOTS_PER_M, DOTS_PER_M, 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    with OsErrorAs(ConfigError, f"cannot write {path}", "name another place"):
        atomic_write(path, data[:33] + chunk + data[33:])  # after the signature and IHDR


def find(gray: UInt8, board: Board) -> Floats | None:
    """Return the corners (N, 2) of a board in an image (H, W), pixels; None if not all are seen.

    The corners are in the order of ``Board.points``.
    """
    if min(gray.shape) < MIN_SIDE_PX:
        return None
    size = board.columns, board.rows
    found, corners = cv2.findChessboardCorners(gray, size)
    if not found:
        return None
    grid = _refined(gray, np.array(corners, np.float32).reshape(board.rows, board.columns, 2))
    right, down = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    if right[0] * down[1] - right[1] * down[0] < 0:
        grid = grid[:, ::-1]
    first = _brightness(gray, grid[0, 0] + (grid[0, 0] - grid[1, 1]) / 2)
    last = _brightness(gray, grid[-1, -1] + (grid[-1, -1] - grid[-2, -2]) / 2)
    if first > last:
        grid = grid[::-1, ::-1]
    return np.ascontiguousarray(grid.reshape(-1, 2))


def _refined(gray: UInt8, grid: Float32) -> Floats:
    """Return corners (rows, columns, 2) refined to a hundredth of a pixel, using edges."""
    across, down = np.diff(grid, axis=1), np.diff(grid, axis=0)
    nearest = min(float(np.linalg.norm(d, axis=-1).min()) for d in (across, down))
    half = int(np.clip(nearest / 3, 1, 5))
    flat = grid.reshape(-1, 1, 2).copy()
    better = cv2.cornerSubPix(gray, flat, (half, half), (-1, -1), _UNTIL)
    return np.asarray(better, np.float64).reshape(grid.shape)


def _brightness(gray: UInt8, at: Floats) -> float:
    x, y = np.clip(np.rint(at), 1, np.array(gray.shape)[::-1] - 2).astype(int)
    return float(gray[y - 1 : y + 2, x - 1 : x + 2].mean())
