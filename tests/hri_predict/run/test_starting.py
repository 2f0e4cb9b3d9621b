"""A start that takes long ends with the first signal, and the handlers are left as they were."""

import contextlib
import ctypes
import os
import signal
import sys
import threading
from asyncio import CancelledError
from typing import Any

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.contracts import registry
from hri_predict.protocol.messages import Level
from hri_predict.run.runtime import stop_on_signals
from hri_predict.run.starting import SlowStart, ended_by_signals
from tests.hri_predict.operation.monitoring.test_summary import tick_of


@pytest.mark.parametrize(
    ("number", "ends"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_a_signal_ends_a_long_start(number, ends):
    stop = threading.Event()
    with stop_on_signals(stop):
        before = signal.getsignal(number)
        with pytest.raises(ends), ended_by_signals(stop):
            signal.raise_signal(number)
        assert signal.getsignal(number) is before
    assert stop.is_set()


def test_a_signal_that_a_compiler_swallows_ends_the_start_when_it_has_compiled():
    stop = threading.Event()
    with (
        stop_on_signals(stop),
        pytest.raises(KeyboardInterrupt),
        ended_by_signals(stop),
        contextlib.suppress(KeyboardInterrupt),  # as ctypes does with a callback's exceptions
    ):
        signal.raise_signal(signal.SIGINT)


def test_a_signal_in_a_callback_of_the_compiler_prints_no_traceback(monkeypatch):
    stop = threading.Event()
    printed: list[Any] = []
    monkeypatch.setattr(sys, "unraisablehook", printed.append)
    interrupted = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))
    with stop_on_signals(stop), pytest.raises(KeyboardInterrupt), ended_by_signals(stop):
        interrupted()
    assert printed == []
    failing = ctypes.CFUNCTYPE(None)(lambda: print(1 / 0))
    with ended_by_signals(stop):
        failing()
    assert [type(each.exc_value) for each in printed] == [ZeroDivisionError]


def test_a_signal_that_a_part_takes_for_its_own_failure_ends_the_start():
    stop = threading.Event()
    part = registry.building("predictor 'theirs'")
    with stop_on_signals(stop), pytest.raises(SystemExit), ended_by_signals(stop), part:
        signal.raise_signal(signal.SIGTERM)


def test_a_part_that_cannot_be_built_is_said_where_nothing_asked_for_the_end():
    stop = threading.Event()
    part = registry.building("predictor 'theirs'")
    with pytest.raises(ConfigError, match="cannot be built"), ended_by_signals(stop), part:
        raise CancelledError


def test_a_hangup_that_asks_for_something_else_ends_no_start():
    asked = []
    stop = threading.Event()
    with stop_on_signals(stop, lambda: asked.append(True)), ended_by_signals(stop):
        signal.raise_signal(signal.SIGHUP)
    assert asked == [True]
    assert not stop.is_set()


def said(caplog):
    return [record for record in caplog.records if "still starting" in record.message]


def test_a_start_that_takes_long_is_said_once(caplog):
    start = SlowStart(after_s=0.0)
    start._timer.join(30.0)
    start.over()
    assert len(said(caplog)) == 1


def test_a_start_that_is_long_every_time_says_why_and_the_remedy(caplog, monkeypatch, tmp_path):
    monkeypatch.setenv("HRI_PREDICT_CACHE", "")
    SlowStart(after_s=0.0)._timer.join(30.0)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HRI_PREDICT_CACHE", str(tmp_path / "file"))
    SlowStart(after_s=0.0)._timer.join(30.0)
    off, damaged = (record.message for record in said(caplog))
    assert "every start takes this long, because the cache is off; set HRI_PREDICT_CACHE" in off
    assert f"{tmp_path / 'file'} cannot be written" in damaged


def test_a_start_that_is_over_is_not_said(caplog):
    start = SlowStart(after_s=3600.0)
    start.on_tick(tick_of(Level.CLEAR))
    start._timer.join(30.0)
    assert not start._timer.is_alive()
    assert not said(caplog)


def test_a_command_that_is_done_is_not_said_to_start(caplog):
    with SlowStart(after_s=3600.0) as start:
        assert start._timer.is_alive()
    start._timer.join(30.0)
    assert not start._timer.is_alive()
    assert not said(caplog)


def test_a_hangup_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_on_signals(threading.Event()):
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_set_the_event_and_are_put_back(number):
    stop, at_start = threading.Event(), signal.getsignal(number)
    signal.signal(number, signal.default_int_handler)  # under nohup SIGHUP is ignored
    try:
        with stop_on_signals(stop):
            os.kill(os.getpid(), number)
            assert stop.wait(5)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, at_start)
