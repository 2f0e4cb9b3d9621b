"""Capsules as scaled copies of one sphere and one cylinder: a few numbers each for the browser."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hri_predict.viewing.picture import Shapes

_AROUND, _RINGS = 18, 9
NO_SIZE = 1e-30
ENDS_M = np.array([[0, 0, -500], [0, 0, 500]], np.float32)
"""Two points without size in each transparent batch, which make the room's origin the middle of all
batches. Browsers draw the batch with the more distant middle first.
"""
_SRGB = np.arange(256) / 255.0
_LINEAR = np.round(
    255.0 * np.where(_SRGB <= 0.04045, _SRGB / 12.92, ((_SRGB + 0.055) / 1.055) ** 2.4)
).astype(np.uint8)


def sphere() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices and triangles of a sphere of radius 1."""
    heights = np.linspace(0.0, np.pi, _RINGS + 1)
    turns = np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False)
    polar, turn = np.meshgrid(heights, turns, indexing="ij")
    points = np.stack((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)))
    return points.reshape(3, -1).T.astype(np.float32), _sides(_RINGS)


def cylinder() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices and triangles of an open cylinder of radius 1 along z, from -0.5 to 0.5."""
    turns = np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False)
    ring = np.stack((np.cos(turns), np.sin(turns), np.zeros(_AROUND)), axis=-1)
    up = np.array([0.0, 0.0, 0.5])
    points = np.concatenate((ring + up, ring - up))
    return points.astype(np.float32), _sides(1)


def _sides(rings: int) -> NDArray[np.uint32]:
    """Triangles between rings of vertices, from the top down, seen from outside."""
    first, ring = np.meshgrid(np.arange(_AROUND), np.arange(rings))
    a = (ring * _AROUND + first).ravel()
    b = (ring * _AROUND + (first + 1) % _AROUND).ravel()
    c, d = a + _AROUND, b + _AROUND
    return np.concatenate((np.stack((a, c, b), -1), np.stack((b, c, d), -1))).astype(np.uint32)


def linear(colours: Any) -> NDArray[np.uint8]:
    """Return colours for a batch, which expects linear light, not sRGB (IEC 61966-2-1).

    Unconverted, they would be paler than the same colours in the panel.
    """
    return _LINEAR[np.asarray(colours, np.uint8)]


def spheres_of(capsules: Shapes) -> tuple[Shapes, Shapes]:
    """Return (2 N, 3) middles and (2 N, 3) scales of the ends of N capsules: all first ends first.

    A capsule without length has only one visible end: two would look less transparent.
    """
    middles = np.concatenate((capsules[:, :3], capsules[:, 3:6]))
    point = (capsules[:, :3] == capsules[:, 3:6]).all(axis=1)
    radii = np.concatenate((capsules[:, 6], np.where(point, NO_SIZE, capsules[:, 6])))
    return middles, np.repeat(radii[:, None], 3, axis=1)


def cylinders_of(capsules: Shapes) -> tuple[Shapes, Shapes, Shapes]:
    """(N, 3) middles, (N, 4) turns (w x y z) and (N, 3) scales of the capsules' middle parts."""
    along = capsules[:, 3:6] - capsules[:, :3]
    length = np.linalg.norm(along, axis=1)
    scale = np.stack((capsules[:, 6], capsules[:, 6], np.maximum(length, 1e-6)), axis=1)
    return 0.5 * (capsules[:, :3] + capsules[:, 3:6]), _from_z(along, length), scale


def _from_z(along: Shapes, length: Shapes) -> Shapes:
    """Return unit quaternions that turn z to each direction; the halfway form, safe for directions
    down.

    A vector without length keeps z.
    """
    unit = np.where(length[:, None] > 1e-9, along / np.maximum(length, 1e-9)[:, None], [0, 0, 1])
    turn = np.stack((1.0 + unit[:, 2], -unit[:, 1], unit[:, 0], np.zeros(len(unit))), axis=1)
    turn[turn[:, 0] < 1e-6] = [0.0, 1.0, 0.0, 0.0]  # straight down: about x
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    return turn.astype(np.float32)
