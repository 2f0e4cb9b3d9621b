"""A start that takes long ends with the first signal, and the handlers are left as they were."""

import signal
import threading

import pytest

from hri_predict.run.runtime import stop_on_signals
from hri_predict.run.starting import ended_by_signals


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


def test_a_hangup_that_asks_for_something_else_ends_no_start():
    asked = []
    stop = threading.Event()
    with stop_on_signals(stop, lambda: asked.append(True)), ended_by_signals(stop):
        signal.raise_signal(signal.SIGHUP)
    assert asked == [True]
    assert not stop.is_set()
