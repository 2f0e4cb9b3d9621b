"""A constant-acceleration Kalman filter per joint and axis: a forecast with its uncertainty.

State: position, velocity, acceleration; process noise: white jerk. Bar-Shalom, Li, Kirubarajan,
"Estimation with Applications to Tracking and Navigation", Wiley 2001, section 6.2.3 ("Continuous
Wiener process acceleration model"); filter equations: section 5.2.3.

The filter runs over the history window alone, from a prior of a body at rest, so a prediction
depends on nothing else. The three axes of a joint share one covariance.

No person keeps the same acceleration for a second. Use this filter for horizons of about 0.3 s; its
``std`` indicates how reliable it is. The default jerk was chosen on the CMU training recordings at
30 fps with 10 mm of noise added: there 69, 73 and 79 % of the errors per axis at 0.1, 0.2 and 0.4 s
are within one ``std`` (68 % for a Gaussian), and 90, 91 and 92 % within two (95 %).
"""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, Skeleton, neighbours
from hri_predict.contracts.predictor import Forecast, PredictorSettings
from hri_predict.predictors.masked import at_step, ever, nearest_seen, steps, steps_to_cover

# An unknown joint may be anywhere in the room.
UNKNOWN_STD_M = 100.0


class KalmanSettings(PredictorSettings):
    """Settings of ``kalman``."""

    history_s: float = Field(0.5, ge=0.01, le=5, description="length of the filtered history")
    measurement_std_m: float = Field(
        0.01, ge=1e-4, le=1, description="standard deviation of the joints' noise, per axis"
    )
    jerk_density: float = Field(
        100.0, ge=1e-3, le=1e6, description="power spectral density of jerk, m²/s⁵, per axis"
    )
    speed_std_m_s: float = Field(
        1.0, ge=0.01, le=100, description="prior standard deviation of velocity, per axis"
    )
    acceleration_std_m_s2: float = Field(
        3.0, ge=0.01, le=1000, description="prior standard deviation of acceleration, per axis"
    )


@dataclass(slots=True, kw_only=True)
class _State:
    """Means (P, J, 3) and the six different entries of the covariance (P, J, 1)."""

    p: Floats
    v: Floats
    a: Floats
    pp: Floats
    pv: Floats
    pa: Floats
    vv: Floats
    va: Floats
    aa: Floats


class ConstantAccelerationKalman:
    """Each joint and axis separately: constant acceleration disturbed by white jerk.

    ``std`` is the standard deviation of the true position, without measurement noise. A joint never
    observed in the window moves with the nearest observed joint in the tree; its ``std`` grows by
    the longest possible distance between the two.
    """

    settings_model = KalmanSettings

    def __init__(self, settings: KalmanSettings, skeleton: Skeleton = CANONICAL) -> None:
        self.skeleton = skeleton
        self.rate_hz = settings.rate_hz
        self.history_steps = steps(settings.history_s, settings.rate_hz) + 1
        self.horizon_steps = steps_to_cover(settings.horizon_s, settings.rate_hz)
        self._settings = settings
        self._neighbours = neighbours(skeleton.parents)
        self._reach = np.minimum(skeleton.reach, UNKNOWN_STD_M)

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Filter the window and extrapolate; see ``Predictor.predict``."""
        seen = ever(observed)
        state = self._prior(history, observed, seen)
        for step in range(self.history_steps):
            if step > 0:
                self._advance(state, 1.0 / self.rate_hz)
            self._correct(state, history[:, step], observed[:, step])
        return self._placed(*self._extrapolated(state), seen)

    def _prior(self, history: Floats, observed: Bools, seen: Bools) -> _State:
        """Prior: at rest, near the joint's first observed position, with a large variance."""
        first = at_step(history, np.argmax(observed, axis=1))
        position = np.where(seen[..., np.newaxis], first, 0.0)
        shape = (*seen.shape, 1)
        zero = np.zeros(shape)
        return _State(
            p=position,
            v=np.zeros_like(position),
            a=np.zeros_like(position),
            pp=np.full(shape, UNKNOWN_STD_M**2),
            pv=zero,
            pa=zero,
            vv=np.full(shape, self._settings.speed_std_m_s**2),
            va=zero,
            aa=np.full(shape, self._settings.acceleration_std_m_s2**2),
        )

    def _advance(self, s: _State, t: float) -> None:
        """Predict ``t`` seconds ahead: x = F x, P = F P F' + Q."""
        q, half = self._settings.jerk_density, t * t / 2.0
        s.p = s.p + s.v * t + s.a * half
        s.v = s.v + s.a * t
        pv = s.pv + t * s.vv + half * s.va  # row of F P for position
        pa = s.pa + t * s.va + half * s.aa
        va = s.va + t * s.aa
        pp = s.pp + t * s.pv + half * s.pa
        s.pp = pp + t * pv + half * pa + q * t**5 / 20.0
        s.pv = pv + t * pa + q * t**4 / 8.0
        s.pa = pa + q * t**3 / 6.0
        s.vv = s.vv + t * s.va + t * va + q * t**3 / 3.0
        s.va = va + q * t**2 / 2.0
        s.aa = s.aa + q * t

    def _correct(self, s: _State, measured: Floats, observed: Bools) -> None:
        """Update by measured positions (P, J, 3); joints not observed (P, J) stay as they are."""
        seen = observed[..., np.newaxis]
        precision = np.where(seen, 1.0 / (s.pp + self._settings.measurement_std_m**2), 0.0)
        residual = np.where(seen, measured, s.p) - s.p
        gain_p, gain_v, gain_a = s.pp * precision, s.pv * precision, s.pa * precision
        s.p = s.p + gain_p * residual
        s.v = s.v + gain_v * residual
        s.a = s.a + gain_a * residual
        s.vv = s.vv - gain_v * s.pv
        s.va = s.va - gain_v * s.pa
        s.aa = s.aa - gain_a * s.pa
        # (1 - gain) written without the cancellation that a prior of 100 m would suffer
        kept = np.where(seen, self._settings.measurement_std_m**2 * precision, 1.0)
        s.pp, s.pv, s.pa = s.pp * kept, s.pv * kept, s.pa * kept

    def _extrapolated(self, s: _State) -> tuple[Floats, Floats]:
        """Positions (P, H, J, 3) and variances (P, H, J) at every step of the horizon."""
        t = np.arange(1.0, self.horizon_steps + 1)[:, np.newaxis, np.newaxis] / self.rate_hz
        half = t * t / 2.0
        p, v, a, pp, pv, pa, vv, va, aa = (
            part[:, np.newaxis] for part in (s.p, s.v, s.a, s.pp, s.pv, s.pa, s.vv, s.va, s.aa)
        )
        variance = (
            pp
            + 2.0 * t * pv
            + 2.0 * half * pa
            + t * t * vv
            + 2.0 * t * half * va
            + half * half * aa
            + self._settings.jerk_density * t**5 / 20.0
        )
        return p + v * t + a * half, variance[..., 0]

    def _placed(self, positions: Floats, variance: Floats, seen: Bools) -> Forecast:
        """Place unseen joints at their nearest seen neighbour."""
        source = nearest_seen(seen, self._neighbours)
        away = self._reach[np.arange(source.shape[1]), source]
        away = np.where(ever(seen)[:, np.newaxis], away, UNKNOWN_STD_M)[:, np.newaxis]
        index = source[:, np.newaxis, :]
        variance = np.take_along_axis(variance, index, axis=2) + away**2
        positions = np.take_along_axis(positions, index[..., np.newaxis], axis=2)
        return Forecast(positions, np.sqrt(np.minimum(variance, UNKNOWN_STD_M**2)))
