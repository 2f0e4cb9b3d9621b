"""``bench faults``: one signal ends the command, though each row runs a node of its own."""

import signal
import threading

import pytest

from hri_predict.run.runtime import stop_on_signals
from hri_sim.fault_table import table
from hri_sim.fault_table.outcome import FaultOutcome


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_row_ends_the_command_without_that_row(cli, monkeypatch, number):
    def rows(_only):
        for name in ("first", "second", "third"):
            with stop_on_signals(threading.Event()):
                if name == "second":
                    signal.raise_signal(number)
            yield FaultOutcome(fault=name, expected="stop", acts="node", reason="", fine=True)

    monkeypatch.setattr(table, "run_table", rows)
    before = signal.getsignal(number)
    status, out, err = cli("bench", "faults")
    told = "warning: stopped by a signal in second; faults measured before: 1"
    assert (status, out, err) == (130, "", f"ok   first\n{told}\n")
    assert signal.getsignal(number) is before
