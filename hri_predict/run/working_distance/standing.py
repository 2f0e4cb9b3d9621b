"""A standing person as observed by a source, computed without a recording."""

from math import ceil

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.predictor import Predictor
from hri_predict.people.body.body_model import body_model
from hri_predict.people.body.inferred import Inference
from hri_predict.people.body.standing import standing_body
from hri_predict.people.inferring import with_inferred
from hri_predict.people.snapshot import PeopleSnapshot, RecentCaptures
from hri_predict.run.session import VIRTUAL_START_NS
from hri_predict.run.working_distance.measure import WARM_S
from hri_predict.run.working_distance.seen import Seen

TICK_S = 0.4
"""Interval between two ticks; between them a standing person does not change, and a robot changes
little.
"""
_SETTLE = 2  # ticks before those that count
_CAPTURES = 12  # of a source at 30 Hz in that time
_FACING = np.array([-1.0, -1.0, 1.0])  # the robot, which is on the side of -x


def standing_snapshot(
    delivered: Bools,
    history_steps: int,
    rate_hz: float,
    *,
    now_ns: int,
    age_s: float = 0.0,
    captures: int = 1,
    infers: bool = True,
    body: Floats | None = None,
) -> PeopleSnapshot:
    """Return a standing body as observed by a source that delivers only some joints (J,).

    Args:
        delivered: (J,) whether each joint is delivered.
        history_steps: T of the history, at ``rate_hz``.
        rate_hz: rate of the history.
        now_ns, age_s: the tick's time, and the capture's age at that time.
        captures: number of captures so far.
        infers: whether other joints are inferred where possible.
        body: (J, 3) the body; by default ``standing_body``.
    """
    whole = standing_body() if body is None else body
    capture_ns = now_ns - round(age_s * 1e9)
    shape = (1, history_steps, len(JOINTS))
    history = np.broadcast_to(np.where(delivered[:, None], whole, 0.0), (*shape, 3))
    observed = np.broadcast_to(delivered, shape)
    snapshot = PeopleSnapshot(
        now_ns=now_ns,
        ids=(1,),
        history=history,
        observed=observed,
        capture_ns=np.array([capture_ns]),
        last_positions=np.where(delivered[:, None], history[:, -1], np.nan),
        joint_age_s=np.where(delivered, 0.0, np.inf)[None],
        lost=(),
        reasons=(),
        newest_capture_ns=capture_ns,
        captures=captures,
        counters={},
        recent=RecentCaptures.of_history(history, observed, rate_hz),
    )
    return with_inferred(snapshot, Inference(body_model()), rate_hz) if infers else snapshot


def standing(predictor: Predictor, delivered: Bools, *, age_s: float, seconds: float) -> Seen:
    """Return a person who stands at the origin and faces -x.

    Args:
        predictor: computes the forecasts.
        delivered: (J,) the joints that the source delivers.
        age_s: age of each capture at its tick.
        seconds: measured time, after ``WARM_S``.
    """
    found, body = Seen(), standing_body() * _FACING
    for tick in range(_SETTLE + ceil(seconds / TICK_S)):
        later_s = WARM_S if tick >= _SETTLE else 0.0
        snapshot = standing_snapshot(
            delivered,
            predictor.history_steps,
            predictor.rate_hz,
            now_ns=VIRTUAL_START_NS + round((later_s + tick * TICK_S) * 1e9),
            age_s=age_s,
            captures=1 + tick * _CAPTURES,
            body=body,
        )
        if not found.forecasts:
            forecast = predictor.predict(snapshot.history, snapshot.observed)
        found.snapshots.append(snapshot)
        found.forecasts.append(forecast)
        found.reasons.append(())
    return found
