"""Forecasts ahead of the node: the same advice as tick by tick, whatever happens on the way."""

import threading

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.predictor import Forecast, PredictorSettings
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.reasons import Reason
from hri_predict.run import config as configuration
from hri_predict.run import foreseeing, session
from hri_predict.run.foreseeing import BATCH, Foreseeing
from hri_predict.run.session import Options, run

T, H, J = 5, 4, len(CANONICAL.joints)


def snapshot(k, people=1, shift=0.0):
    """The k-th tick's people, who stand at places of their own."""
    return PeopleSnapshot(
        now_ns=k * 40_000_000,
        ids=tuple(range(people)),
        history=np.full((people, T, J, 3), float(k) + shift),
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


class Counting:
    """Forecasts that everybody stays; counts the histories of each call."""

    skeleton, history_steps, horizon_steps, rate_hz = CANONICAL, T, H, 25.0

    def __init__(self, breaks=()):
        self.calls, self.breaks = [], breaks

    def predict(self, history, observed):
        self.calls.append(len(history))
        if len(self.calls) in self.breaks:
            raise RuntimeError("out of memory")
        return Forecast(np.repeat(history[:, -1:], H, axis=1), np.ones((len(history), H, J)))


def asked(runner, snapshots):
    """Each tick's forecast: the place in which its people stay, or a reason."""
    try:
        found = [runner.run(each) for each in snapshots]
    finally:
        runner.stop()
    return [reason if forecast is None else forecast.positions for forecast, reason in found]


@pytest.mark.parametrize("people", [1, 3])
def test_many_ticks_share_a_call_and_each_gets_its_own(people):
    ticks = [snapshot(k, people) for k in range(100)]
    predictor = Counting()
    runner = Foreseeing(predictor, iter(ticks))
    found = asked(runner, ticks)
    assert runner.used == 100
    assert sum(predictor.calls) == 100 * people
    assert all(call >= BATCH for call in predictor.calls[:-1])
    for k, positions in enumerate(found):
        assert positions.shape == (people, H, J, 3)
        assert np.all(positions == float(k))


def test_what_was_not_foreseen_is_asked_for():
    """A person was forgotten, a place differs, a tick is missing, and more come after the end."""
    foreseen = [snapshot(k, 2) for k in range(80)]
    ticks = list(foreseen)
    ticks[3] = snapshot(3, 1)
    ticks[50] = snapshot(50, 2, shift=1e-9)
    ticks[60:61] = []
    ticks += [snapshot(k, 2) for k in range(80, 90)]
    runner = Foreseeing(Counting(), iter(foreseen))
    found = asked(runner, ticks)
    assert runner.used == 77
    for tick, positions in zip(ticks, found, strict=True):
        assert np.all(positions == tick.history[0, 0, 0, 0])
        assert len(positions) == len(tick.ids)


def test_a_batch_that_fails_is_asked_for_tick_by_tick_and_a_tick_that_fails_says_so():
    ticks = [snapshot(k) for k in range(BATCH)]
    runner = Foreseeing(Counting(breaks=(1, 3)), iter(ticks))
    found = asked(runner, ticks)
    assert runner.used == 0
    assert found[1] is Reason.PREDICTOR_FAILED
    assert all(
        positions is not Reason.PREDICTOR_FAILED for k, positions in enumerate(found) if k != 1
    )
    assert runner.counters["predictor_failures"] == 1


def test_a_people_stage_that_fails_ahead_leaves_the_rest_to_the_node():
    def ahead():
        for k in range(40):
            yield snapshot(k)
        raise RuntimeError("a scene broke it")

    runner = Foreseeing(Counting(), ahead())
    found = asked(runner, [snapshot(k) for k in range(60)])
    assert len(found) == 60
    assert not any(each is Reason.PREDICTOR_FAILED for each in found)
    assert runner.used == BATCH


def test_an_empty_room_holds_nobody_up():
    ticks = [snapshot(k, people=0) for k in range(5000)]
    runner = Foreseeing(Counting(), iter(ticks))
    forecast, reason = runner.run(ticks[0])
    runner.stop()
    assert reason is None
    assert forecast is not None
    assert forecast.positions.shape == (0, H, J, 3)


def test_stopping_ends_the_thread_while_batches_wait():
    before = threading.active_count()
    runner = Foreseeing(Counting(), iter([snapshot(k) for k in range(10_000)]))
    runner.run(snapshot(0))
    runner.stop()
    runner.stop()
    assert threading.active_count() == before


@pytest.mark.timeout(30)
def test_after_its_end_it_asks_tick_by_tick():
    ticks = [snapshot(k) for k in range(200)]
    runner = Foreseeing(Counting(), iter(ticks))
    runner.run(ticks[0])
    runner.stop()
    forecast, reason = runner.run(ticks[150])
    assert reason is None
    assert forecast is not None
    assert np.all(forecast.positions == 150.0)


@pytest.mark.timeout(30)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_dies_leaves_the_node_waiting_for_nothing():
    def ahead():
        yield snapshot(0)
        raise GeneratorExit  # one of the errors that are no failure of the part

    runner = Foreseeing(Counting(), ahead())
    found = asked(runner, [snapshot(k) for k in range(5)])
    assert not any(each is Reason.PREDICTOR_FAILED for each in found)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "a.mcap"
    run(demo(), Options(factor=None, duration_s=7.0, record=path))
    return path


def demo():
    loaded = configuration.load(configuration.shipped("demo.yaml")).quiet()
    return loaded.with_predictor("constant_velocity")


@pytest.mark.parametrize("ticks", [pytest.param("fixed", marks=pytest.mark.long), "capture"])
def test_a_replay_is_the_same_bytes_ahead_and_tick_by_tick(ticks, recorded, tmp_path, monkeypatch):
    made = []

    def kept(*arguments):
        made.append(foreseeing.foreseeing(*arguments))
        return made[-1]

    monkeypatch.setattr(session, "foreseeing", kept)
    played = demo().with_source({
        "kind": "recording", "path": str(recorded),
        "room_from_source": demo().source.room_from_source.model_dump(),
    }).with_node(ticks=ticks)  # fmt: skip
    files = []
    for long in (True, False):
        monkeypatch.setattr(PredictorSettings, "takes_long", long)
        files.append(tmp_path / f"{long}.mcap")
        run(played, Options(factor=None, until_exhausted=True, record=files[-1]))
    ahead, plainly = made
    assert plainly is None
    assert ahead is not None
    assert ahead.used > 60
    assert files[0].read_bytes() == files[1].read_bytes()
