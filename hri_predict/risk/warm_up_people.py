"""An artificial person, used to call every compiled loop once before the first tick."""

from collections.abc import Iterator

import numpy as np

from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import PeopleSnapshot

TICKS = 4
"""Number of ticks in which earlier forecasts are compared with captures."""
_STEPS = 6  # of the history: enough to measure speeds


def made_up_ticks(
    joints: int, horizon_steps: int, rate_hz: float
) -> Iterator[tuple[PeopleSnapshot, Forecast | None]]:
    """Yield a standing person with a forecast, and in the last tick without one."""
    tick_ns = round(1e9 / rate_hz)
    place = np.zeros((1, joints, 3))
    for tick in range(TICKS):
        now_ns = (1 + tick) * tick_ns
        snapshot = PeopleSnapshot(
            now_ns=now_ns,
            ids=(0,),
            history=np.zeros((1, _STEPS, joints, 3)),
            observed=np.ones((1, _STEPS, joints), np.bool_),
            capture_ns=np.array([now_ns], np.int64),
            last_positions=place,
            joint_age_s=np.zeros((1, joints)),
            lost=(),
            reasons=(),
            newest_capture_ns=now_ns,
            captures=tick,
            counters={},
        )
        shape = 1, horizon_steps, joints
        # with a std: a calibration that reads it evaluates nothing without
        forecast = Forecast(np.zeros((*shape, 3)), np.zeros(shape))
        yield snapshot, forecast if tick < TICKS - 1 else None
