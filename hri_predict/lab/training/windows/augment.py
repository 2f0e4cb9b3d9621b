"""Augmentation of training windows: a few minutes of motion represent more people and sensors.

Everything is drawn per window from one generator, in the room's frame. Speed and direction in time
are drawn before the window is cut (``motion``). Geometry (mirror, scale, yaw) changes history and
future alike. Noise and dropped joints change the history alone; the future stays true.
"""

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Bools
from hri_predict.base.settings import Settings
from hri_predict.lab.datasets.tracks import mirrored_joints
from hri_predict.predictors.neural.body import BODY, BODY_PARTS, SHARED_BODY

_LIMBS = tuple(BODY_PARTS[part] for part in BODY_PARTS if part != "torso")
_ARMS = tuple(
    BODY.joints.index(side + joint)
    for side in ("l_", "r_")
    for joint in ("shoulder", "elbow", "wrist")
)


class AugmentSettings(Settings):
    """Frequency and strength; shares are shares of windows and may add up to more than 1."""

    mirror: float = Field(0.5, ge=0, le=1, description="share mirrored left to right")
    yaw: bool = Field(True, description="turn about the vertical, uniformly")
    scale: float = Field(0.1, ge=0, lt=1, description="body size within 1 ± this")
    warp: float = Field(0.15, ge=0, lt=1, description="speed within 1 ± this, log-uniform")
    slow: float = Field(
        0.15,
        ge=0,
        le=1,
        description="share slowed down, to a speed drawn uniformly between full and zero",
    )
    reverse: float = Field(
        0.12, ge=0, le=1, description="share played backwards: people step back from a robot"
    )
    truncate: float = Field(0.15, ge=0, le=1, description="share whose history starts late")
    noise: float = Field(0.2, ge=0, le=1, description="share with sensor noise")
    noise_m: float = Field(0.015, ge=0, le=1, description="largest standard deviation of the noise")
    outliers: float = Field(
        0.1, ge=0, le=1, description="share with gross noise on some coordinates"
    )
    outliers_m: float = Field(
        0.05, ge=0, le=1, description="largest standard deviation of the gross noise"
    )
    missing: float = Field(0.2, ge=0, le=1, description="share with joint-frames missing at random")
    limb: float = Field(0.08, ge=0, le=1, description="share with a limb occluded")
    frames: float = Field(0.08, ge=0, le=1, description="share with whole frames dropped")
    sparse: float = Field(0.2, ge=0, le=1, description="share with only the canonical joints")
    arms: float = Field(0.05, ge=0, le=1, description="share with only the arms seen")


def move(
    settings: AugmentSettings, rng: np.random.Generator, positions: np.ndarray, observed: Bools
) -> tuple[np.ndarray, Bools]:
    """Mirror, scale and turn whole windows (B, T + H, J, 3) about their own middle."""
    count = len(positions)
    mirrored = rng.random(count) < settings.mirror
    if mirrored.any():
        swap = mirrored_joints()
        flipped = positions[mirrored][:, :, swap]
        flipped[..., 1] *= -1.0
        positions[mirrored] = flipped
        observed[mirrored] = observed[mirrored][:, :, swap]
    scale = rng.uniform(1 - settings.scale, 1 + settings.scale, count).astype(np.float32)
    angle = rng.uniform(-np.pi, np.pi, count) if settings.yaw else np.zeros(count)
    cos, sin = (f(angle).astype(np.float32) * scale for f in (np.cos, np.sin))
    x, y = positions[..., 0], positions[..., 1]
    cos, sin = cos[:, None, None], sin[:, None, None]
    moved = np.empty_like(positions)
    moved[..., 0] = cos * x - sin * y
    moved[..., 1] = sin * x + cos * y
    moved[..., 2] = positions[..., 2] * scale[:, None, None]
    return moved, observed


def disturb(
    settings: AugmentSettings, rng: np.random.Generator, history: np.ndarray, observed: Bools
) -> None:
    """Add noise to histories (B, T, J, 3) and hide joints (B, T, J), in place."""
    _add_noise(settings, rng, history)
    _hide(settings, rng, observed)


def _add_noise(settings: AugmentSettings, rng: np.random.Generator, history: np.ndarray) -> None:
    noisy = np.flatnonzero(rng.random(len(history)) < settings.noise)
    if noisy.size:
        sigma = rng.uniform(0, settings.noise_m, (noisy.size, 1, 1, 1)).astype(np.float32)
        shape = (noisy.size, *history.shape[1:])
        history[noisy] += sigma * rng.standard_normal(shape, dtype=np.float32)
    gross = np.flatnonzero(rng.random(len(history)) < settings.outliers)
    if gross.size:
        shape = (gross.size, *history.shape[1:])
        sigma = rng.uniform(0, settings.outliers_m, (gross.size, 1, 1, 1)).astype(np.float32)
        hit = rng.random(shape, dtype=np.float32) < rng.uniform(0.1, 0.5, (gross.size, 1, 1, 1))
        history[gross] += hit * sigma * rng.standard_normal(shape, dtype=np.float32)


def _hide(settings: AugmentSettings, rng: np.random.Generator, observed: Bools) -> None:
    count, steps, joints = observed.shape
    for window in np.flatnonzero(rng.random(count) < settings.truncate):
        observed[window, : int(rng.integers(0, max(1, steps - 4)))] = False
    for window in np.flatnonzero(rng.random(count) < settings.missing):
        share = rng.uniform(0.05, 0.5)
        observed[window] &= rng.random((steps, joints)) >= share
    for window in np.flatnonzero(rng.random(count) < settings.limb):
        limb = _LIMBS[int(rng.integers(len(_LIMBS)))]
        observed[window, int(rng.integers(steps)) :, limb] = False
    for window in np.flatnonzero(rng.random(count) < settings.frames):
        observed[window, rng.random(steps) < rng.uniform(0.05, 0.5)] = False
    draw = rng.random(count)
    observed[draw < settings.sparse] &= _only(SHARED_BODY)
    observed[draw > 1 - settings.arms] &= _only(_ARMS)


def _only(joints: tuple[int, ...]) -> Bools:
    """(J,) true for these joints alone."""
    return np.isin(np.arange(len(BODY.joints)), joints)
