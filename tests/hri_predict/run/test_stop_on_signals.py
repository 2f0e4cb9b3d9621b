"""Signals that end a run."""

import os
import signal
import threading

import pytest

from hri_predict.run.runtime import stop_on_signals


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
