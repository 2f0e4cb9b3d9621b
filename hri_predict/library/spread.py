"""The standard deviation of a forecast, from the calibration of its predictor."""

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.contracts.predictor import Forecast, Predictor
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.calibration import Calibration
from hri_predict.zones.human_speed import velocities_in
from hri_predict.zones.learned_scale import Evidence
from hri_predict.zones.motion_class import trunk_speed
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants
from hri_predict.zones.settings import CoverageSettings

_LEVEL = 0.9
_DEVIATIONS = 2.5003
"""Radius, in standard deviations, of a ball that holds 90 % of a normal distribution of three axes:
the root of the 0.9 quantile of chi-squared with 3 degrees of freedom, 6.2514.
"""


class Spread:
    """Gives forecasts their ``std``; for one recording, whose forecasts come in order.

    It is the standard deviation of the normal distribution, alike in all directions, of which as
    much lies within the calibrated radius as that radius was stated to hold (90 % of joints).
    Errors have heavier tails than this; for zones use the radii themselves. Nothing is widened, and
    motion that differs from the calibration data is not reported. Only the steps a second are
    compared: the calibration of another predictor gives numbers that mean nothing.

    Args:
        calibration: of the predictor.
        predictor: the predictor that makes the forecasts.

    Raises:
        ConfigError: the calibration has other steps a second than the predictor.
    """

    def __init__(self, calibration: Calibration, predictor: Predictor) -> None:
        if calibration.rate_hz != predictor.rate_hz:
            raise ConfigError(
                f"calibration: is for {calibration.rate_hz:g} steps per second, the predictor has "
                f"{predictor.rate_hz:g}; give the calibration of this predictor"
            )
        skeleton, steps = predictor.skeleton, predictor.horizon_steps
        self._skeleton, self._rate_hz = skeleton, predictor.rate_hz
        self._radii = Radii(calibration, CoverageSettings(level=_LEVEL), skeleton, steps)
        self._check = SelfCheck(
            SelfCheckConstants(),
            level=_LEVEL,
            of="joint",
            rate_hz=predictor.rate_hz,
            horizon_steps=steps,
            ranges=None,
        )

    def of(self, snapshot: PeopleSnapshot, forecast: Forecast) -> Floats:
        """(P, H, J) metres; infinite where the calibration knows nothing.

        Args:
            snapshot: the people; their earlier forecasts are judged by it.
            forecast: made from it.
        """
        velocities = velocities_in(snapshot, self._rate_hz)
        trust = self._check.check(snapshot, velocities)
        radius = self._radii.of(
            trunk_speed(velocities, self._skeleton),
            Evidence(
                history=snapshot.history,
                observed=snapshot.observed,
                forecast=forecast.positions,
                error_m=trust.error_m,
                residual_m=trust.residual_m,
            ),
        )
        seen = np.asarray(snapshot.observed.any(1))
        radius = np.where(seen[:, None], radius, np.inf)
        self._check.note(snapshot, forecast, radius)
        return radius / _DEVIATIONS
