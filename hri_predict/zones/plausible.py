"""Lower bounds of a calibration: smaller numbers are damage or fraud, not a good predictor.

People change their motion within a fraction of a second, and no predictor can know when. So the
radii of every honest fit grow with the horizon. The bounds are a seventh to a half of the smallest
numbers in the shipped calibrations.
"""

from collections.abc import Iterable

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.zones.learned_scale import Evidence, LearnedScale, ScaleNetwork
from hri_predict.zones.motion_class import SPEED_CLASSES
from hri_predict.zones.scale_shape import ScaleShape

LEAST_FACTOR = 0.1
"""Minimum factor by the size of the scale; shipped ones are above 0.7."""
LEAST_RADIUS_M, RISE_M_S = 0.005, 0.05
"""Minimum radius at horizon 0, and its growth; at 1 s shipped limits are above 0.6 m."""
LEAST_SHARE, LEAST_MEAN_SHARE = 0.05, 0.15
"""Minimum share of a radius in one direction, and in the mean of all; shipped: 0.2 and 0.35."""
LEAST_RISE_M_S = {0.0: 0.005, 1.0: 0.02}
"""Speed of a person -> minimum growth of the estimated radii; shipped: above 0.02 and 0.08 m/s."""
_BACK = 25  # steps of history of that person


def demand_radii(name: str, tables: Iterable[Floats], rate_hz: float) -> None:
    """Check radii (..., H) in metres.

    Raises:
        ValueError: one is too small for its step, or smaller than at the step before.
    """
    for table in tables:
        if not (table[..., 1:] >= table[..., :-1]).all():
            raise ValueError("a radius shrinks with the horizon")
        least = LEAST_RADIUS_M + RISE_M_S * np.arange(1, table.shape[-1] + 1) / rate_hz
        small = np.argwhere(table < least)
        if len(small):
            at = tuple(small[0])
            raise ValueError(
                f"{name} holds {1e3 * table[at]:g} mm at {(at[-1] + 1) / rate_hz:.2g} s, which "
                f"makes zones far too small (at least {1e3 * least[at[-1]]:.0f} mm is expected)"
            )


def demand_shares(shares: Floats) -> None:
    """Check shares (..., BINS) of the radii by direction.

    Raises:
        ValueError: one is too small, or those of one step on average.
    """
    for least, found in ((LEAST_SHARE, shares.min()), (LEAST_MEAN_SHARE, shares.mean(-1).min())):
        if found < least:
            where = "in one direction" if least == LEAST_SHARE else "on average"
            raise ValueError(
                f"toward_thousandths makes zones far too small: {1e3 * found:.0f} {where} (at "
                f"least {1e3 * least:.0f} is expected)"
            )


def demand_scale(
    scale: ScaleNetwork, shape: ScaleShape | None, factors: Floats, rate_hz: float
) -> None:
    """Check the estimated radii around a person who stands, and one who walks past.

    Args:
        scale, shape: the learned scale and its shape.
        factors: (L, 3, H) factors on it, by level and speed class.
        rate_hz: steps per second.

    Raises:
        ValueError: the radii of most joints are too small at some step.
    """
    if shape is not None and shape.factor.min() < LEAST_FACTOR:
        raise ValueError(
            f"shape holds the factor {shape.factor.min():g}, which makes zones far too small (at "
            f"least {LEAST_FACTOR:g} is expected)"
        )
    steps, classes = factors.shape[-1], len(SPEED_CLASSES)
    times_s = np.arange(1, steps + 1) / rate_hz
    learned = LearnedScale(scale, CANONICAL, rate_hz, steps)
    for speed_m_s, rise_m_s in LEAST_RISE_M_S.items():
        scale_m = np.repeat(learned(_person(speed_m_s, steps, rate_hz)), classes, axis=0)
        if shape is not None:
            scale_m = shape.of(scale_m, np.arange(classes))
        radii_m = np.maximum.accumulate(factors * np.median(scale_m, axis=2), axis=-1)
        smallest_m = radii_m.min((0, 1))
        small = np.flatnonzero(smallest_m < rise_m_s * times_s)
        if len(small):
            at = small[-1]
            raise ValueError(
                f"scale and estimated_thousandths give a radius of {1e3 * smallest_m[at]:.2g} mm "
                f"at {times_s[at]:.2g} s, which makes zones far too small (at least "
                f"{1e3 * rise_m_s * times_s[at]:.2g} mm is expected)"
            )


def _person(speed_m_s: float, steps: int, rate_hz: float) -> Evidence:
    """Return a person who moves straight on, as a forecast at constant velocity expects."""
    times_s = np.arange(1 - _BACK, steps + 1) / rate_hz
    positions = np.zeros((1, len(times_s), len(JOINTS), 3))
    positions[0, :, :, 0] = speed_m_s * times_s[:, None]
    return Evidence(
        history=positions[:, :_BACK],
        observed=np.ones((1, _BACK, len(JOINTS)), np.bool_),
        forecast=positions[:, _BACK:],
        error_m=np.full((1, 2, len(JOINTS)), 0.02 * speed_m_s),
        residual_m=np.full(1, 0.02 * speed_m_s),
        std=np.zeros((1, steps, len(JOINTS))),
    )
