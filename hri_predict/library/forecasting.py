"""Forecasts for a recording, made in the same way as by a running node."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.settings import Pose
from hri_predict.contracts.predictor import Forecast, Predictor, checked
from hri_predict.contracts.source import SourceSettings
from hri_predict.people.people import People
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.recording import Recording
from hri_predict.run.assemble import predictor_of
from hri_predict.run.config import predictor_settings
from hri_predict.zones.calibration import Calibration, calibration_for
from hri_predict.zones.human_speed import velocities_in
from hri_predict.zones.learned_scale import Evidence
from hri_predict.zones.motion_class import trunk_speed
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants
from hri_predict.zones.settings import CoverageSettings

# -- the standard deviation of a forecast, from the calibration of its predictor -------------------

_LEVEL = 0.9
_DEVIATIONS = 2.5003
"""Radius, in standard deviations, of a ball that contains 90 % of a three-axis normal distribution:
the root of the 0.9 quantile of chi-squared with 3 degrees of freedom, 6.2514.
"""


class Spread:
    """Adds ``std`` to the forecasts of one recording, which must be in order.

    It is the standard deviation of an isotropic normal distribution with the same share within the
    calibrated radius as the calibration states (90 % of joints). Errors have heavier tails than
    this; for zones use the radii themselves. Nothing is widened, and motion that differs from the
    calibration data is not reported. Only the steps per second are checked: the calibration of
    another predictor gives meaningless numbers.

    Args:
        calibration: calibration of the predictor.
        predictor: the predictor of the forecasts.

    Raises:
        ConfigError: calibration and predictor differ in steps per second.
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
        """Return (P, H, J) metres; infinite where the calibration has no value.

        Args:
            snapshot: the people; their earlier forecasts are compared with it.
            forecast: forecast from this snapshot.
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
                measured=snapshot.measured,
                std=forecast.std,
            ),
        )
        seen = np.asarray(snapshot.observed.any(1))
        radius = np.where(seen[:, None], radius, np.inf)
        self._check.note(snapshot, forecast, radius)
        return radius / _DEVIATIONS


# --------------------------------------------------------------------------------------------------

MOST_PEOPLE = 64
"""Maximum number of people that the people stage can track, so that all people of a recording are
included.
"""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecordedForecast:
    """Forecast of a predictor at one capture of a recording. P people, H steps, J joints.

    Attributes:
        time_s: when the scene arrived, seconds since the recording's first.
        ids: (P,) ids of the people.
        capture_s: (P,) each person's newest capture, seconds since the recording's first arrival.
        horizons_s: (H,) time of each step after that capture.
        joints: (J,) names of the joints.
        positions: (P, H, J, 3) metres, in the recording's own frame with z up.
        std: (P, H, J) metres, one standard deviation per axis, from a calibration or the predictor;
            infinite where unknown.
        reasons: why this input is not trusted; empty if it is.
    """

    time_s: float
    ids: tuple[int, ...]
    capture_s: Floats
    horizons_s: Floats
    joints: tuple[str, ...]
    positions: Floats
    std: Floats
    reasons: tuple[Reason, ...]


def load_predictor(name: str, **settings: Any) -> Predictor:
    """Build a predictor by its registered name (``hri-predict predictors`` lists them).

    Args:
        name: as in a configuration's ``predictor.name``.
        settings: its other keys in the configuration, such as ``horizon_s``, ``rate_hz`` or
            ``weights``; relative paths start in the working directory.

    Raises:
        ConfigError: the predictor does not exist, a setting is wrong, or a package is missing.
        PredictorError: its weights are broken.
    """
    asked = predictor_settings({**settings, "name": name}, f"load_predictor('{name}')")
    return predictor_of(asked.resolved(Path()))


def load_calibration_of(name: str, **settings: Any) -> Calibration | None:
    """Load the shipped calibration of a predictor; ``None`` if these settings have none.

    Args:
        name, settings: as in ``load_predictor``.

    Raises:
        ConfigError: the predictor does not exist, or a setting is wrong.
    """
    where = f"load_calibration_of('{name}')"
    asked = predictor_settings({**settings, "name": name}, where).resolved(Path())
    return calibration_for(asked, CoverageSettings(), Path())


def forecasts(
    recording: Recording, predictor: Predictor, calibration: Calibration | None = None
) -> Iterator[RecordedForecast]:
    """Yield a forecast for each scene of a recording, in order.

    The node's people stage tracks all people, so a forecast depends only on captures up to its
    scene. People in the recording with implausible data (a jump, a body of non-human size) are left
    out, as stated in ``reasons``.

    Args:
        recording: the captures.
        predictor: see ``load_predictor``.
        calibration: the predictor's; see ``load_calibration_of``. ``std`` then follows from it,
            this person's motion and the errors of the forecasts of 0.12 and 0.4 s ago; otherwise
            ``std`` is the predictor's own, if it states one.

    Raises:
        ConfigError: the calibration is for a different number of steps per second.
        PredictorError: the predictor works on other joints than the node's, or breaks its contract.
    """
    people = _people(recording, predictor)
    spread = None if calibration is None else Spread(calibration, predictor)
    for scene, arrival_ns in zip(recording.scenes, recording.arrival_ns, strict=True):
        people.receive(scene, arrival_ns)
        yield _forecast(recording, predictor, people.snapshot(arrival_ns), spread)


def forecast_at(recording: Recording, predictor: Predictor, time_s: float) -> RecordedForecast:
    """Return the forecast at one time, from the newest scene that had arrived by then.

    Args:
        recording: the captures.
        predictor: see ``load_predictor``.
        time_s: seconds since the recording's first arrival.

    Raises:
        RecordingError: ``time_s`` is not within the recording.
        PredictorError: as ``forecasts``.
    """
    if not 0.0 <= time_s <= recording.duration_s:
        raise RecordingError(
            f"recording {recording.path}: {time_s:g} s is outside of it; "
            f"give a time from 0 to {recording.duration_s:.3f} s"
        )
    people = _people(recording, predictor)
    newest_ns = recording.arrival_ns[0]
    end_ns = newest_ns + round(time_s * 1e9)
    for scene, arrival_ns in zip(recording.scenes, recording.arrival_ns, strict=True):
        if arrival_ns > end_ns:
            break
        people.receive(scene, arrival_ns)
        newest_ns = arrival_ns
    return _forecast(recording, predictor, people.snapshot(newest_ns))


def _people(recording: Recording, predictor: Predictor) -> People:
    """Return the node's people stage for this recording, which stays in its own frame."""
    return People(
        settings=PeopleSettings(max_people=MOST_PEOPLE),
        joint_map=recording.joint_map,
        source_settings=SourceSettings(kind="recording", room_from_source=Pose()),
        rate_hz_source=recording.rate_hz,
        declares_noise=recording.declares_noise,
        history_steps=predictor.history_steps,
        rate_hz_predictor=predictor.rate_hz,
    )


def _forecast(
    recording: Recording,
    predictor: Predictor,
    snapshot: PeopleSnapshot,
    spread: Spread | None = None,
) -> RecordedForecast:
    steps, joints = predictor.horizon_steps, predictor.skeleton.joints
    if snapshot.ids:
        found = predictor.predict(snapshot.history, snapshot.observed)
        found = checked(found, len(snapshot.ids), predictor)
    else:
        found = Forecast(np.zeros((0, steps, len(joints), 3)), None)
    std = found.std if spread is None else spread.of(snapshot, found)
    if std is None:
        std = np.full(found.positions.shape[:3], np.inf)
    start_ns = recording.arrival_ns[0]
    capture_s: Floats = (snapshot.capture_ns - start_ns).astype(np.float64) * 1e-9
    return RecordedForecast(
        time_s=(snapshot.now_ns - start_ns) * 1e-9,
        ids=snapshot.ids,
        capture_s=capture_s,
        horizons_s=np.arange(1, steps + 1) / predictor.rate_hz,
        joints=joints,
        positions=found.positions,
        std=std,
        reasons=snapshot.reasons,
    )
