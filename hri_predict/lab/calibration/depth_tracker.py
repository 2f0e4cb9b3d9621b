"""Presences as the tracker of a live depth camera delivers them.

The errors of optical motion capture are below a millimetre, and white or normal noise is milder
than a depth camera's. Errors here are along the camera's ray, have heavy tails, are correlated in
time, and grow with the square of the distance. Bone lengths vary, joints drop out in bursts, and
the tracker's smoothing causes a lag.

Figures for strength 1 at 3 m. Depth: a standard deviation of 17 mm is the limit that Microsoft
states for the Azure Kinect; measured and confirmed by M. Tölgyessy et al., "Evaluation of the Azure
Kinect and Its Comparison to Kinect V1 and Kinect V2", Sensors 21 (2021) 413. Growth with the square
of the distance: a disparity error d of stereo cameras (ZED) gives z² d / (f b); the random error of
structured light grows likewise. Heavy tails: Q. Wang et al., "Evaluation of Pose Tracking Accuracy
in the First and Second Generations of Microsoft Kinect", ICHI 2015, fit joints' offsets by a normal
and a uniform distribution, whose uniform part holds the outliers. The other figures are
assumptions, chosen so that a calibration without this noise falls short as it did on live
recordings.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.lab.calibration.presence import Presence, ar1

RATE_HZ = 30.0
DEPTH_M = 0.017
"""Standard deviation of a joint's depth at ``REFERENCE_M``."""
REFERENCE_M = 3.0
ACROSS = 0.35
"""Ratio of the standard deviation across the ray to that along it."""
TAIL = 3.0
"""Degrees of freedom of Student's t for each new part of an error; 3 is the smallest whole number
with a finite variance."""
LASTS_S = (0.1, 0.8)
"""Correlation time of a recording's errors."""
BONE = 0.03
"""Standard deviation of a bone's length, relative to the length."""
BONE_LASTS_S = 1.0
DROPPED, DROPPED_S = 0.03, 0.25
"""Share of a joint's captures that are not observed, and the mean length of such a burst."""
POOR, POOR_S, WORSE = 0.1, 0.5, 4.0
"""Share of a joint's captures in which it is barely visible, the mean duration, and the factor
on its error during that time."""
COMMON, COMMON_LASTS_S = 1.0, 1.0
"""Error of the whole body's depth relative to a joint's, and its correlation time."""
SMOOTHS_S = (0.03, 0.1)
"""Time constant of the tracker's filter."""
CAMERA_M, CAMERA_HEIGHT_M = (2.0, 4.0), (1.2, 2.4)
"""Horizontal distance of the camera from the middle of the recording, and its height."""

CHAINS = (
    ("neck", "head", "head_top"),
    *(
        tuple(f"{side}_{part}" for part in parts)
        for side in "lr"
        for parts in (("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot"))
    ),
)
"""Bones of which a tracker estimates the length, from the trunk outwards."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthTracker:
    """A tracker. Everything else is drawn for each recording.

    Attributes:
        strength: factor on errors and changes of bones.
        tail: see ``TAIL``; infinite for normal noise.
        lasts_s: see ``LASTS_S``.
        quantum_m: resolution of depth; 0: continuous depth.
    """

    strength: float = 1.0
    tail: float = TAIL
    lasts_s: tuple[float, float] = LASTS_S
    quantum_m: float = 0.0

    def seen(self, presence: Presence, seed: int) -> Presence:
        """Return the person as the tracker delivers them, at up to ``RATE_HZ``.

        Args:
            presence: as recorded; z is up.
            seed: seed of all random draws.
        """
        rng = np.random.default_rng(seed)
        every = max(1, round(presence.rate_hz / RATE_HZ))
        there = presence.only(np.arange(0, len(presence.stamps_ns), every))
        observed = there.observed
        dt_s = np.diff(there.stamps_ns) * 1e-9
        camera = _camera(rng, there)
        shown = np.where(observed[..., None], there.positions, np.nan)
        shown = self._with_bones(rng, shown, dt_s)
        ray = shown - camera
        far_m = np.linalg.norm(ray, axis=-1, keepdims=True)
        ray = ray / np.maximum(far_m, 1e-6)
        sigma_m = self.strength * DEPTH_M * (far_m / REFERENCE_M) ** 2
        whole = COMMON * ar1(rng, dt_s, COMMON_LASTS_S, (len(shown), 1, 1), tail=self.tail)
        poor = _bursts(rng, dt_s, observed.shape, share=POOR, lasts_s=POOR_S)[..., None]
        lasts_s = np.exp(rng.uniform(*np.log(self.lasts_s)))
        along = ar1(rng, dt_s, lasts_s, (*shown.shape[:2], 1), tail=self.tail)
        across = ar1(rng, dt_s, lasts_s, shown.shape, tail=self.tail)
        error = np.where(poor, WORSE, 1.0) * (along * ray + ACROSS * across) + whole * ray
        error = sigma_m * error
        shown = shown + error
        if self.quantum_m > 0:
            far_m = np.einsum("fji,fji->fj", shown - camera, ray)[..., None]
            shown = shown + (np.round(far_m / self.quantum_m) * self.quantum_m - far_m) * ray
        shown = _smoothed(shown, dt_s, rng.uniform(*SMOOTHS_S))
        kept = (
            observed
            & ~_bursts(rng, dt_s, observed.shape, share=DROPPED, lasts_s=DROPPED_S)
            & np.isfinite(shown).all(-1)
        )
        return replace(there, positions=np.where(kept[..., None], shown, 0.0), observed=kept)

    def _with_bones(self, rng: np.random.Generator, shown: Floats, dt_s: Floats) -> Floats:
        """The bodies with varying bone lengths; joints further out move along."""
        moved = shown.copy()
        for chain in CHAINS:
            at = [JOINTS.index(name) for name in chain]
            part = self.strength * BONE * ar1(rng, dt_s, BONE_LASTS_S, (len(shown), len(at) - 1))
            carried = np.zeros_like(shown[:, 0])
            for bone, (inner, outer) in enumerate(itertools.pairwise(at)):
                longer = part[:, bone, None] * (shown[:, outer] - shown[:, inner])
                carried = carried + np.where(np.isfinite(longer), longer, 0.0)
                moved[:, outer] = shown[:, outer] + carried
        return moved


def _camera(rng: np.random.Generator, presence: Presence) -> Floats:
    """(3,) a random position of the camera around the middle of the motion."""
    seen = presence.observed[..., None]
    middle = np.where(seen, presence.positions, 0.0).sum((0, 1)) / max(seen.sum(), 1)
    angle, far_m = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*CAMERA_M)
    beside = far_m * np.array([np.cos(angle), np.sin(angle), 0.0])
    place: Floats = middle * [1.0, 1.0, 0.0] + beside + [0.0, 0.0, rng.uniform(*CAMERA_HEIGHT_M)]
    return place


def _smoothed(shown: Floats, dt_s: Floats, time_s: float) -> Floats:
    """Exponential smoothing; it restarts where a joint was not seen."""
    found = shown.copy()
    for i, share in enumerate(1.0 - np.exp(-dt_s / time_s), 1):
        step = found[i - 1] + share * (found[i] - found[i - 1])
        found[i] = np.where(np.isfinite(step), step, found[i])
    return found


def _bursts(
    rng: np.random.Generator, dt_s: Floats, shape: tuple[int, int], *, share: float, lasts_s: float
) -> Bools:
    """(F, J) true during a joint's bursts: an independent two-state Markov chain per joint."""
    found = np.zeros(shape, np.bool_)
    found[0] = rng.random(shape[1]) < share
    for i, dt in enumerate(dt_s, 1):
        end = 1.0 - np.exp(-dt / lasts_s)
        begin = end * share / (1.0 - share)
        drawn = rng.random(shape[1])
        found[i] = np.where(found[i - 1], drawn >= end, drawn < begin)
    return found
