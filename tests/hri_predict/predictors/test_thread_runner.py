import asyncio
import threading
import time

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.predictors.thread_runner import PredictionRunner
from hri_predict.protocol.reasons import Reason

T, H, J = 5, 4, len(CANONICAL.joints)


def snapshot(people):
    return PeopleSnapshot(
        now_ns=0,
        ids=tuple(range(people)),
        history=np.zeros((people, T, J, 3)),
        observed=np.ones((people, T, J), bool),
        capture_ns=np.zeros(people, np.int64),
        last_positions=np.zeros((people, J, 3)),
        joint_age_s=np.zeros((people, J)),
        lost=(),
        reasons=(),
        newest_capture_ns=0,
        captures=1,
        counters={},
    )


class Scripted:
    skeleton, history_steps, horizon_steps, rate_hz = CANONICAL, T, H, 25.0

    def __init__(self, answer):
        self.answer = answer

    def predict(self, history, observed):
        return self.answer(history)


def good(history):
    return Forecast(np.zeros((len(history), H, J, 3)), None)


def fails(history):
    raise RuntimeError("out of memory")


def gives_nan(history):
    return Forecast(np.full((len(history), H, J, 3), np.nan), None)


def wrong_shape(history):
    return Forecast(np.zeros((len(history), H, J)), None)


def nan_std(history):
    return Forecast(np.zeros((len(history), H, J, 3)), np.full((len(history), H, J), np.nan))


@pytest.mark.parametrize("deadline", [None, 5.0])
def test_a_good_forecast_comes_back(deadline):
    runner = PredictionRunner(Scripted(good), deadline)
    runner.start()
    forecast, reason = runner.run(snapshot(2))
    runner.stop()
    assert reason is None
    assert forecast is not None
    assert forecast.positions.shape == (2, H, J, 3)


@pytest.mark.parametrize("deadline", [None, 5.0])
@pytest.mark.parametrize("answer", [fails, gives_nan, wrong_shape, nan_std])
def test_whatever_breaks_the_contract_becomes_a_reason(answer, deadline):
    runner = PredictionRunner(Scripted(answer), deadline)
    runner.start()
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    assert runner.failures == 1
    runner.stop()


def test_nobody_here_needs_no_predictor():
    forecast, reason = PredictionRunner(Scripted(fails), None).run(snapshot(0))
    assert reason is None
    assert forecast is not None
    assert forecast.positions.shape == (0, H, J, 3)


def test_a_hanging_predictor_delays_no_tick_and_recovers():
    asked, release = threading.Event(), threading.Event()
    calls = []

    def hangs_once(history):
        calls.append(1)
        asked.set()
        if len(calls) == 1:
            release.wait()
        return good(history)

    runner = PredictionRunner(Scripted(hangs_once), 0.02)
    runner.start()
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_LATE)
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_LATE)  # still busy: not asked again
    assert runner.late == 2
    assert asked.wait(60)  # its thread may begin later than both are late
    assert len(calls) == 1
    release.set()
    forecast, deadline = None, time.monotonic() + 60
    while forecast is None and time.monotonic() < deadline:
        time.sleep(0.005)
        forecast, _reason = runner.run(snapshot(1))
    assert forecast is not None
    runner.stop()


@pytest.mark.parametrize("deadline", [None, 5.0])
@pytest.mark.parametrize("error", [SystemExit(0), asyncio.CancelledError(), BaseException("odd")])
def test_whatever_a_predictor_raises_does_not_end_the_node(error, deadline, caplog):
    def leaves(history):
        raise error

    runner = PredictionRunner(Scripted(leaves), deadline)
    runner.start()
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    runner.stop()
    assert type(error).__name__ in caplog.text


def test_ctrl_c_while_a_predictor_works_ends_the_run():
    def leaves(history):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        PredictionRunner(Scripted(leaves), None).run(snapshot(1))


@pytest.mark.parametrize("kind", [complex, object, int])
def test_a_forecast_of_no_real_numbers_has_failed(kind):
    runner = PredictionRunner(
        Scripted(lambda h: Forecast(good(h).positions.astype(kind), None)), None
    )
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
