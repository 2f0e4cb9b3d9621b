"""Real processes: predictors that hang, die and talk nonsense, and nodes that are killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import HriPredictError
from hri_predict.predictors.building import predictor_of
from hri_predict.predictors.process import runner as module
from hri_predict.predictors.process.remote import Job
from hri_predict.predictors.process.runner import ProcessRunner
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.predictors.process.conftest import settings_of, snapshot

pytestmark = pytest.mark.realtime
SOON_S = 20.0  # for a process to start on a busy machine


def pid_of(runner):
    return runner._started.process.pid


def until(true, limit_s=SOON_S):
    end = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)


def recovers(runner):
    until(lambda: runner.run(snapshot(1))[1] is None)


def is_gone(pid):
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def test_forecasts_are_those_of_the_predictor_itself(started):
    runner = started(name="constant_velocity", people=3)
    predictor = predictor_of(settings_of("constant_velocity"))
    assert runner.predictor.skeleton is predictor.skeleton
    assert runner.predictor.horizon_steps == predictor.horizon_steps
    for people in (1, 3, 2, 1):
        now = snapshot(people, seed=people, steps=predictor.history_steps)
        forecast, reason = runner.run(now)
        assert reason is None
        expected = predictor.predict(now.history, now.observed)
        np.testing.assert_array_equal(forecast.positions, expected.positions)
        if expected.std is not None:
            np.testing.assert_array_equal(forecast.std, expected.std)


def test_std_comes_with_it(started):
    forecast, _ = started(does="std").run(snapshot(2))
    assert (forecast.std == 0.5).all()


def test_nobody_here_needs_no_predictor(started):
    forecast, reason = started(does="die").run(snapshot(0))
    assert reason is None
    assert forecast.positions.shape == (0, 4, 21, 3)


@pytest.mark.parametrize("does", ["raise", "nan", "wrong shape", "exit", "cancel"])
def test_whatever_breaks_the_contract_becomes_a_reason_and_the_worker_lives(
    started, does, tmp_path, caplog
):
    runner = started(does=does, once=str(tmp_path / "once"))
    worker = pid_of(runner)
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    assert runner.counters["predictor_failures"] == 1
    assert runner.run(snapshot(1))[1] is None
    assert pid_of(runner) == worker
    said = {"raise": "RuntimeError: out of memory", "nan": "not finite"}
    said |= {"exit": "SystemExit", "cancel": "CancelledError"}
    assert said.get(does, "shape") in caplog.text


def test_a_predictor_that_dies_is_started_anew(started, tmp_path, caplog):
    runner = started(does="die", once=str(tmp_path / "once"))
    worker = pid_of(runner)
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    recovers(runner)
    assert pid_of(runner) != worker
    assert runner.counters["predictor_restarts"] == 1
    assert "exited with status 3" in caplog.text


def test_a_predictor_that_always_dies_is_started_ever_more_seldom(started, monkeypatch):
    pauses: list[float] = []
    runner = started(does="die")
    monkeypatch.setattr(runner._stopping, "wait", pauses.append)
    for _ in range(4):
        until(lambda: runner._worker is not None)
        runner.run(snapshot(1))
        until(lambda: runner._worker is None)
    assert pauses[:3] == [0.2, 0.4, 0.8]


@pytest.mark.parametrize("does", ["hang", pytest.param("spin", marks=pytest.mark.long)])
def test_a_predictor_that_hangs_delays_one_tick_and_is_killed(started, does, tmp_path):
    runner = started(does=does, once=str(tmp_path / "once"), deadline_s=0.02)
    worker = pid_of(runner)
    taken = []
    while runner._worker is not None:
        began = time.monotonic()
        assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_LATE)
        taken.append(time.monotonic() - began)
        time.sleep(0.02)
    assert 0.019 < taken[0] < 0.5
    assert np.median(taken[2:]) < 0.01  # it asks without waiting: far below the deadline
    assert runner.late == len(taken)
    until(lambda: is_gone(worker))
    recovers(runner)
    assert runner.restarts == 1


def test_a_late_answer_is_discarded_and_the_newest_window_wins(started, tmp_path):
    runner = started(does="slow", deadline_s=0.02)
    assert runner.run(snapshot(1, seed=1)) == (None, Reason.PREDICTOR_LATE)
    time.sleep(0.2)
    runner._deadline_s = 1.0
    newest = snapshot(1, seed=2)
    forecast, _ = runner.run(newest)
    np.testing.assert_array_equal(forecast.positions[:, 0], newest.history[:, -1] + 1)
    assert runner.restarts == 0


def test_a_worker_that_is_killed_between_ticks_is_started_anew(started):
    runner = started()
    os.kill(pid_of(runner), signal.SIGKILL)
    until(lambda: runner._worker is None)
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    recovers(runner)
    assert runner.restarts == 1


@pytest.mark.parametrize(
    ("does", "said"),
    [("start hangs", "did nothing for"), ("start spins", "without becoming ready")],
)
def test_a_new_worker_that_freezes_while_it_starts_is_given_up_in_seconds(
    started, does, said, tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr(module, "IDLE_S", 1.0)
    monkeypatch.setattr(module, "CPU_FACTOR", 0.0)
    monkeypatch.setattr(module, "CPU_MORE_S", 3.0)
    once = tmp_path / "once"
    runner = started(does=does, once=str(once))
    once.touch()
    os.kill(pid_of(runner), signal.SIGKILL)
    until(lambda: said in caplog.text)
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    once.unlink()
    recovers(runner)
    assert "forecasts resume" in caplog.text


def test_a_new_worker_that_a_signal_stops_is_given_up_and_said_to_be_stopped(
    started, monkeypatch, caplog
):
    monkeypatch.setattr(module, "IDLE_S", 1.0)
    runner = started()
    first = pid_of(runner)
    os.kill(first, signal.SIGKILL)
    until(lambda: runner._started is not None and pid_of(runner) != first)
    os.kill(pid_of(runner), signal.SIGSTOP)
    until(lambda: "a signal stopped it" in caplog.text)
    recovers(runner)


def test_a_new_worker_that_works_slowly_may_take_its_time(started, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "IDLE_S", 1.0)
    once = tmp_path / "once"
    runner = started(does="start works", once=str(once))
    once.touch()
    os.kill(pid_of(runner), signal.SIGKILL)
    until(lambda: runner._worker is None)
    began = time.monotonic()
    recovers(runner)
    assert time.monotonic() - began > 4.0  # as long as its start works
    assert runner.restarts == 1


def test_more_people_than_there_can_be_are_a_failure_not_a_crash(started):
    runner = started(people=2)
    worker = pid_of(runner)
    assert runner.run(snapshot(3)) == (None, Reason.PREDICTOR_FAILED)
    time.sleep(1.2 * runner._hang_s)  # nothing is owed for a window that was not sent
    assert runner.run(snapshot(2))[1] is None
    assert (pid_of(runner), runner.restarts) == (worker, 0)


def test_a_supervisor_that_fails_says_so_instead_of_waiting_for_ever(odd, monkeypatch, caplog):
    def fails(*_):
        raise ZeroDivisionError("injected")

    monkeypatch.setattr(module.Worker, "begin", fails)
    runner = ProcessRunner(Job(settings=settings_of(), people=1), 0.1)
    with pytest.raises(HriPredictError, match=r"could not be supervised.*injected"):
        runner.wait_until_ready()
    runner.stop()
    assert runner._started is None


def test_what_the_predictor_logs_and_prints_does_not_get_lost_or_in_the_way(started, caplog, capfd):
    assert started(does="print").run(snapshot(1))[1] is None
    assert "the sky is near" in caplog.text
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize(
    ("does", "said"),
    [
        ("no start", "there is no sky"),
        ("no start, at length", "there is no sky"),
        ("no process", "set predictor.process to false"),
    ],
)
def test_a_predictor_that_cannot_be_built_is_one_line(odd, does, said):
    runner = ProcessRunner(Job(settings=settings_of(does=does), people=1), 0.1)
    with pytest.raises(HriPredictError, match=said) as caught:
        runner.wait_until_ready()
    assert "\n" not in str(caught.value)
    runner.stop()
    assert runner._started is None


def test_a_worker_with_other_weights_does_not_take_its_place(started, tmp_path, caplog):
    weights = tmp_path / "weights"
    weights.write_bytes(b"1")
    runner = started(reads=str(weights))
    weights.write_bytes(b"2")
    os.kill(pid_of(runner), signal.SIGKILL)
    until(lambda: "files have changed" in caplog.text)
    assert runner.run(snapshot(1)) == (None, Reason.PREDICTOR_FAILED)
    weights.write_bytes(b"1")
    recovers(runner)


@pytest.mark.parametrize("does", ["good", "spin"])
def test_stop_ends_the_worker(started, does):
    runner = started(does=does, deadline_s=0.02)
    worker = pid_of(runner)
    runner.run(snapshot(1))
    runner.stop()
    assert is_gone(worker)
    assert runner.restarts == 0
    runner.stop()


NODE = """
import sys
sys.path[:] = {path!r}
from hri_predict.predictors.process import runner as module
from hri_predict.predictors.process.remote import Job
from hri_predict.predictors.process.runner import ProcessRunner
from tests.hri_predict.predictors.process.conftest import settings_of, snapshot
runner = ProcessRunner(Job(settings=settings_of(does={does!r}), people=1), 0.05)
runner.wait_until_ready()
runner.run(snapshot(1))
print(runner._started.process.pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("does", [pytest.param("good", marks=pytest.mark.long), "spin"])
def test_the_worker_ends_with_a_node_that_is_killed_and_leaves_nothing(odd, does):
    script = NODE.format(path=sys.path, does=does)
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as node:
        assert node.stdout is not None
        worker = int(node.stdout.readline())
        assert not is_gone(worker)
        for pid in (node.pid, worker):  # memory without a name cannot be left behind
            maps = Path(f"/proc/{pid}/maps").read_text(encoding="utf-8")
            assert "memfd:hri-predict" in maps
            assert "/dev/shm" not in maps
        node.kill()
        node.wait()
        until(lambda: is_gone(worker))
