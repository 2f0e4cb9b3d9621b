"""Pictures of recorded bodies: a figure of capsules with clothes and a face, before a background.

It looks enough like a person for BlazePose: it finds nearly all of them, surely.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from hri_drivers.camera.place.camera import Camera
from hri_drivers.camera.seen import UInt8
from hri_predict.base.arrays import Floats

SKIN, SHIRT, TROUSERS = (140, 170, 215), (150, 80, 40), (70, 60, 55)
SHOES, HAIR, WHITE, PUPIL, LIPS = (
    (30, 30, 35), (25, 35, 55), (240, 240, 240), (30, 20, 20), (90, 90, 190),
)  # fmt: skip
_LIGHT = np.array([-0.4, -0.7, -0.6]) / np.linalg.norm([0.4, 0.7, 0.6])
_NEAREST_M = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A capsule from ``a`` to ``b``, metres in the camera's axes, of one colour (BGR)."""

    a: Floats
    b: Floats
    radius: float
    colour: tuple[int, int, int]


def figure(joints: dict[str, Floats]) -> list[Part]:
    """Return the parts of a body by its joints, with the names of the data pack's 38."""
    hips = (joints["LeftUpLeg"] + joints["RightUpLeg"]) / 2
    neck = (joints["LeftArm"] + joints["RightArm"]) / 2
    across = _unit(joints["LeftArm"] - joints["RightArm"])
    pelvis = _unit(joints["LeftUpLeg"] - joints["RightUpLeg"])
    up = _unit(neck - hips)
    parts = [Part(neck, joints["Head"], 0.055, SKIN)]
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        hip, knee, ankle = (joints[side + name] for name in ("UpLeg", "Leg", "Foot"))
        arm, elbow, wrist = (joints[side + name] for name in ("Arm", "ForeArm", "Hand"))
        seat, flank = hips + sign * 0.07 * pelvis, hips + 0.13 * up + sign * 0.06 * across
        parts += [
            Part(hip, knee, 0.078, TROUSERS),
            Part(knee, ankle, 0.055, TROUSERS),
            Part(ankle, joints[side + "ToeBase_End"], 0.042, SHOES),
            Part(arm, elbow, 0.05, SHIRT),
            Part(elbow, wrist, 0.038, SKIN),
            Part(wrist, wrist + 0.45 * (wrist - elbow), 0.036, SKIN),
            Part(seat, seat + 0.12 * up, 0.10, TROUSERS),
            Part(flank, neck - 0.08 * up + sign * 0.09 * across, 0.095, SHIRT),
            Part(neck + sign * 0.02 * across - 0.02 * up, arm, 0.055, SHIRT),
        ]
    ahead = _unit(np.cross(across, up))
    return parts + _head(joints["Head"], _unit(joints["Head_End"] - joints["Head"]), ahead)


def _head(base: Floats, up: Floats, ahead: Floats) -> list[Part]:
    ahead = _unit(ahead - up * (ahead @ up))
    left = np.cross(up, ahead)
    middle = base + 0.10 * up + 0.02 * ahead
    nose = middle + 0.09 * ahead - 0.03 * up
    mouth = middle + 0.083 * ahead - 0.068 * up
    parts = [
        Part(middle - 0.045 * up + 0.012 * ahead, middle + 0.025 * up, 0.078, SKIN),
        Part(middle + 0.03 * up - 0.022 * ahead, middle + 0.045 * up, 0.086, HAIR),
        Part(nose + 0.03 * up - 0.008 * ahead, nose, 0.012, SKIN),
        Part(mouth - 0.022 * left, mouth + 0.022 * left, 0.008, LIPS),
    ]
    for sign in (1.0, -1.0):
        eye = middle + 0.071 * ahead + 0.008 * up + sign * 0.032 * left
        ear = middle + sign * 0.08 * left
        brow = eye + 0.026 * up + 0.004 * ahead
        parts += [
            Part(eye, eye, 0.014, WHITE),
            Part(eye + 0.007 * ahead, eye + 0.007 * ahead, 0.009, PUPIL),
            Part(ear - 0.02 * up, ear + 0.02 * up, 0.015, SKIN),
            Part(brow - 0.015 * left, brow + 0.015 * left, 0.006, HAIR),
        ]
    return parts


def render(parts: list[Part], camera: Camera, random: np.random.Generator) -> UInt8:
    """Return a picture (H, W, 3), BGR, by a camera without distortion."""
    width, height = camera.size
    coarse = random.uniform(120, 200, (6, 8, 3))
    picture = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    picture = picture + random.normal(0, 3, picture.shape)
    nearest = np.full((height, width), np.inf)
    for part in parts:
        ends = np.array([part.a, part.b])
        if ends[:, 2].min() < _NEAREST_M + part.radius:
            continue
        pixels = camera.project(ends)
        reach = 1.5 * camera.matrix[0, 0] * part.radius / (ends[:, 2].min() - part.radius) + 2
        x0, y0 = np.clip(np.floor(pixels.min(axis=0) - reach), 0, [width, height]).astype(int)
        x1, y1 = np.clip(np.ceil(pixels.max(axis=0) + reach), 0, [width, height]).astype(int)
        if x1 <= x0 or y1 <= y0:
            continue
        x, y = np.meshgrid(np.arange(x0, x1, dtype=float), np.arange(y0, y1, dtype=float))
        ways = np.dstack([camera.rays(np.dstack([x, y])), np.ones_like(x)])
        ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
        reached, normals = _hit(part, ways)
        before = nearest[y0:y1, x0:x1]
        new = reached < before
        before[new] = reached[new]
        bright = 0.45 + 0.6 * np.maximum(normals @ _LIGHT, 0) + random.normal(0, 0.03, x.shape)
        picture[y0:y1, x0:x1][new] = (np.array(part.colour) * bright[..., None])[new]
    sharp = np.clip(picture, 0, 255).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(sharp, (3, 3), 0.7), np.uint8)


def _hit(part: Part, ways: Floats) -> tuple[Floats, Floats]:
    """Return how far along unit ``ways`` (..., 3) from the origin the surface is, and its normal.

    Infinite where a way misses it.
    """
    axis = part.b - part.a
    square = float(axis @ axis)
    hits = [_sphere(part.a, part.radius, ways), _sphere(part.b, part.radius, ways)]
    if square > 1e-9:
        along, start = ways @ axis, float(part.a @ axis)
        a = square - along**2
        b = start * along - square * (ways @ part.a)
        c = square * float(part.a @ part.a) - start**2 - part.radius**2 * square
        root = b**2 - a * c
        ok = (root > 0) & (a > 1e-9)
        t = (-b - np.sqrt(np.maximum(root, 0))) / np.maximum(a, 1e-9)
        share = (t * along - start) / square
        t = np.where(ok & (share > 0) & (share < 1) & (t > 0), t, np.inf)
        at = np.where(np.isfinite(t), t, 0.0)[..., None] * ways
        hits.append((t, (at - part.a - share[..., None] * axis) / part.radius))
    reached, normals = hits[0]
    for t, normal in hits[1:]:
        nearer = t < reached
        reached = np.where(nearer, t, reached)
        normals = np.where(nearer[..., None], normal, normals)
    return reached, normals


def _sphere(middle: Floats, radius: float, ways: Floats) -> tuple[Floats, Floats]:
    along = ways @ middle
    root = along**2 - (middle @ middle - radius**2)
    t = np.where(root > 0, along - np.sqrt(np.maximum(root, 0)), np.inf)
    at = np.where(np.isfinite(t), t, 0.0)[..., None] * ways
    return t, (at - middle) / radius


def _unit(vector: Floats) -> Floats:
    unit: Floats = vector / np.linalg.norm(vector)
    return unit
