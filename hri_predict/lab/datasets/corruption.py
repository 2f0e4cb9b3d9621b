"""Sensor faults, applied to the windows of the evaluation on recordings.

Windows are disturbed after the ring buffer, so shares refer to the predictor's input: the buffer
cannot bridge these gaps. All random numbers come from a generator seeded with the corruption, the
recording and the batch, newest step first. So every predictor gets the same disturbance, whatever
the length of its history.
"""

import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.predictors.neural.body import BODY, BODY_PARTS

Kind = Literal["missing", "limb", "noise", "frames"]
LIMBS = tuple(BODY_PARTS[part] for part in BODY_PARTS if part != "torso")


@dataclass(frozen=True, slots=True)
class Corruption:
    """One kind of disturbance.

    Attributes:
        kind: "missing": each joint of each step is independently unobserved with probability
            ``share``. "limb": one arm or leg of each window, drawn uniformly, is unobserved in its
            newest ``share`` of steps (1: in all of them). "noise": each coordinate has Gaussian
            noise of ``sigma_m`` added, with probability ``share``. "frames": each step but the
            newest, which is the capture itself, is unobserved with probability ``share``.
        share: see ``kind``.
        sigma_m: standard deviation of the noise.
        seed: random seed.
    """

    kind: Kind
    share: float
    sigma_m: float = 0.0
    seed: int = 0

    @property
    def name(self) -> str:
        """Name in tables."""
        percent = f"{self.share * 100:g} %"
        if self.kind == "noise":
            return f"noise of {self.sigma_m * 1000:g} mm on {percent} of coordinates"
        if self.kind == "missing":
            return f"{percent} of joint-frames missing"
        if self.kind == "frames":
            return f"{percent} of frames dropped"
        return "a limb never seen" if self.share >= 1 else f"a limb occluded in the last {percent}"

    def apply(
        self, history: Floats, observed: Bools, window: tuple[str, int], steps: int
    ) -> tuple[Floats, Bools]:
        """Return disturbed copies.

        Args:
            history: (N, T, 28, 3) metres.
            observed: (N, T, 28).
            window: name of the recording, and number of the batch in it: they seed the generator.
            steps: steps that a share of the newest steps refers to, the same for all predictors.
        """
        name, batch = window
        rng = np.random.default_rng([self.seed, zlib.crc32(f"{self.kind} {name}".encode()), batch])
        count, total, joints = observed.shape
        if self.kind == "noise":
            return _noisy(rng, history, self.share, self.sigma_m), observed.copy()
        if self.kind == "missing":
            hidden = _newest_last(rng.random((total, count, joints))) < self.share
        elif self.kind == "frames":
            hidden = np.repeat(_newest_last(rng.random((total, count, 1))) < self.share, joints, 2)
            hidden[:, -1] = False
        else:
            hidden = np.zeros_like(observed)
            occluded = total if self.share >= 1 else max(1, round(self.share * steps))
            chosen: NDArray[np.int64] = rng.integers(len(LIMBS), size=(count,))
            for row in range(count):
                hidden[row, total - occluded :, LIMBS[chosen[row]]] = True
        return history.copy(), observed & ~hidden


def _newest_last(drawn: Floats) -> Floats:
    """From (T, N, ...) in the order drawn, newest step first, to (N, T, ...), newest step last."""
    return np.ascontiguousarray(np.moveaxis(drawn[::-1], 0, 1))


def _noisy(rng: np.random.Generator, history: Floats, share: float, sigma_m: float) -> Floats:
    result = history.copy()
    shape = (len(history), len(BODY.joints), 3)
    for step in range(history.shape[1] - 1, -1, -1):  # newest first, for any length
        hit = rng.random(shape) < share
        result[:, step] += np.where(hit, sigma_m * rng.standard_normal(shape), 0.0)
    return result


def standard(seed: int = 0) -> tuple[Corruption, ...]:
    """Every corruption in reports: 10-50 % missing, limbs, noise, dropped frames."""
    shares = (0.1, 0.2, 0.3, 0.4, 0.5)
    return (
        *(Corruption("missing", share, seed=seed) for share in shares),
        Corruption("limb", 0.4, seed=seed),
        Corruption("limb", 1.0, seed=seed),
        *(
            Corruption("noise", share, sigma_m, seed)
            for sigma_m in (0.01, 0.03, 0.05)
            for share in (0.1, 0.3, 0.5)
        ),
        *(Corruption("frames", share, seed=seed) for share in (0.1, 0.3, 0.5)),
    )
