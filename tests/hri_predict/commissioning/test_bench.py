"""A bench runs the node; a signal ends it as any run of the node."""

import os
import signal
import threading

import pytest

from hri_predict.base.clock import MonotonicClock
from hri_predict.commissioning import bench
from tests.hri_predict.commissioning.cells import cell_data, load_cell


@pytest.fixture
def end(tmp_path, monkeypatch):
    """A bench without links; nothing is run."""
    monkeypatch.setattr(bench.assemble, "build", lambda *_, **__: None)
    config = load_cell(tmp_path, cell_data(links=[]))
    return bench.Bench(config=config, clock=MonotonicClock(), cell=None, transports={})


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_run_and_then_the_step(end, monkeypatch, number):
    announced = []

    def run(*, stop, **_):
        os.kill(os.getpid(), number)
        announced.append(stop.wait(5.0))  # what follows is the regular end of a run

    inherited = signal.signal(number, signal.default_int_handler)  # nohup ignores SIGHUP
    try:
        monkeypatch.setattr(bench, "run_real_time", run)
        with pytest.raises(KeyboardInterrupt):
            end.run(seconds=1.0, listeners=())
        assert announced == [True]
        assert signal.getsignal(number) == signal.default_int_handler
    finally:
        signal.signal(number, inherited)


def test_a_signal_during_the_start_does_not_look_like_success(end, monkeypatch):
    def run(**_):
        raise SystemExit(0)

    monkeypatch.setattr(bench, "run_real_time", run)
    with pytest.raises(KeyboardInterrupt):
        end.run(seconds=1.0, listeners=())


def test_the_end_of_a_run_is_no_signal(end, monkeypatch):
    over = threading.Event()
    monkeypatch.setattr(bench, "run_real_time", lambda *, stop, **_: stop.set())
    end.run(seconds=1.0, listeners=(), stop=over)
    assert over.is_set()
