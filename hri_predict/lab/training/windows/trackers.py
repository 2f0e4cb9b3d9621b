"""Motion as trackers report it: capture rates, lost captures and joints, and errors.

Trackers deliver captures, not motion. Captures are disturbed before they are resampled, as in the
node: errors stay correlated in time, and a lost capture leaves a gap.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hri_predict.base.arrays import Bools
from hri_predict.base.settings import Settings
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.predictors.neural.body import BODY, SHARED_BODY, SHARED_CANONICAL

CONVENTIONS = (
    "assembly_arms", "azure_kinect32", "coco17", "mediapipe33", "smpl22", "xsens23", "zed34",
)  # fmt: skip
"""Joint maps; the share ``convention`` of windows keeps only the joints of one of them."""
FASTEST_HZ = 60.0
"""Maximum rate: more frequent captures are thinned, which loses nothing at steps of 40 ms."""


class TrackerSettings(Settings):
    """Frequency and strength of trackers' errors (``data.trackers:``); shares are of windows."""

    rate: float = Field(0.35, ge=0, le=1, description="share at another capture rate")
    slowest_hz: float = Field(8.0, ge=5, le=60, description="lowest such rate; the highest is 60")
    dropped: float = Field(0.15, ge=0, le=1, description="share that loses whole captures")
    dropped_most: float = Field(0.3, ge=0, lt=1, description="largest share of captures lost")
    noise: float = Field(0.3, ge=0, le=1, description="share with noise on every joint")
    noise_m: float = Field(0.03, ge=0, le=1, description="largest standard deviation of that noise")
    correlated: float = Field(
        0.5, ge=0, le=1, description="share of noisy windows whose noise is correlated in time"
    )
    correlation_s: float = Field(
        0.5,
        gt=0,
        le=10,
        description="longest time constant of correlated noise (the shortest is a tenth)",
    )
    convention: float = Field(
        0.25, ge=0, le=1, description="share with only the joints that some tracker delivers"
    )


def draw_periods(
    settings: TrackerSettings, rng: np.random.Generator, period_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(B,) time between captures, at least that of the recording (``period_s``, as played)."""
    count = len(period_s)
    slowest, fastest = np.log(settings.slowest_hz), np.log(FASTEST_HZ)
    drawn = np.exp(-rng.uniform(slowest, fastest, count))
    other = rng.random(count) < settings.rate
    return np.maximum(period_s, np.where(other, drawn, 1 / FASTEST_HZ))


def draw_lost(
    settings: TrackerSettings, rng: np.random.Generator, count: int, captures: int
) -> Bools:
    """(B, M) captures that are lost; never the newest, which ends the window."""
    share = settings.dropped_most * rng.random((count, 1))
    share *= rng.random((count, 1)) < settings.dropped
    lost: Bools = rng.random((count, captures)) < share
    lost[:, -1] = False
    return lost


def draw_noise(
    settings: TrackerSettings,
    rng: np.random.Generator,
    times: NDArray[np.float64],
    joints: int,
) -> NDArray[np.float32]:
    """(B, M, J, 3) metres of noise of captures at ``times`` (B, M), seconds, increasing.

    White, or a first-order autoregression (AR(1)) whose correlation falls by 1/e in a time constant
    drawn log-uniformly. Every joint of a window has the same standard deviation throughout.
    """
    count, captures = times.shape
    noisy = np.flatnonzero(rng.random(count) < settings.noise)
    result = np.zeros((count, captures, joints, 3), np.float32)
    if not noisy.size:
        return result
    sigma = rng.uniform(0, settings.noise_m, (noisy.size, 1, 1, 1)).astype(np.float32)
    constant = settings.correlation_s * 10.0 ** -rng.random((noisy.size, 1))
    correlated = rng.random((noisy.size, 1)) < settings.correlated
    kept = np.where(correlated, np.exp(-np.diff(times[noisy], axis=1) / constant), 0.0)
    drawn = rng.standard_normal((noisy.size, captures, joints, 3), np.float32)
    for m, share in enumerate(kept.T.astype(np.float32), start=1):
        share = share[:, None, None]
        drawn[:, m] = share * drawn[:, m - 1] + np.sqrt(1 - share**2) * drawn[:, m]
    result[noisy] = sigma * drawn
    return result


def hide_by_convention(
    settings: TrackerSettings, rng: np.random.Generator, observed: Bools
) -> None:
    """Hide all but one tracker convention's joints in some windows (B, T, J), in place."""
    count = len(observed)
    which = rng.integers(len(CONVENTIONS), size=count)
    hit = np.flatnonzero(rng.random(count) < settings.convention)
    observed[hit] &= _delivered()[which[hit]][:, None]


@cache
def _delivered() -> Bools:
    """(conventions, J) which joints of ``BODY`` each convention delivers."""
    result = np.zeros((len(CONVENTIONS), len(BODY.joints)), bool)
    for row, name in zip(result, CONVENTIONS, strict=True):
        row[list(SHARED_BODY)] = load_joint_map(name).mapped[list(SHARED_CANONICAL)]
    return result
