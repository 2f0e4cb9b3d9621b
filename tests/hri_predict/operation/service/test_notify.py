"""What systemd is told, and by whom."""

import threading
import time

import pytest

from hri_predict.node.listeners import Listener
from hri_predict.operation.service.notify import Notifier
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from tests.hri_predict.operation.service.cells import NotifySocket, cell, written


@pytest.fixture(params=["path", "abstract"])
def notify(request, tmp_path):
    address = str(tmp_path / "notify")
    one = NotifySocket(address if request.param == "path" else "@" + address[-80:])
    yield one
    one.close()


def test_a_notifier_speaks_to_the_socket_that_the_environment_names(notify):
    environ = {"NOTIFY_SOCKET": notify.address, "WATCHDOG_USEC": "3000000"}
    notifier = Notifier.from_environ(environ)
    assert notifier is not None
    assert notifier.watchdog_s == 3.0
    notifier.ready("two\nlines")
    notifier.alive()
    notifier.reloading()
    notifier.stopping()
    notify.listen(0.05)
    told = [lines for _, lines in notify.heard]
    assert told[:2] == [["READY=1", "STATUS=two lines"], ["WATCHDOG=1"]]
    assert told[2][0] == "RELOADING=1"
    assert abs(int(told[2][1].removeprefix("MONOTONIC_USEC=")) * 1e-6 - time.monotonic()) < 5.0
    assert told[3][0] == "STOPPING=1"
    assert environ == {}  # no command that the node runs can speak for it


@pytest.mark.parametrize(
    "environ", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "@"}, {"NOTIFY_SOCKET": "vsock:2:1"}]
)
def test_without_a_socket_that_we_know_nobody_is_told(environ):
    assert Notifier.from_environ(environ) is None


@pytest.mark.parametrize(
    "watched",
    [{}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_PID": "1"}]
    + [{"WATCHDOG_USEC": "9" * digits} for digits in (400, 5000)],  # beyond floats, beyond int()
)
def test_a_watchdog_of_others_or_of_no_time_is_none(watched):
    environ = {"NOTIFY_SOCKET": "/nowhere", "WATCHDOG_USEC": "5", **watched}
    if watched == {}:
        del environ["WATCHDOG_USEC"]
    notifier = Notifier.from_environ(environ)
    assert notifier is not None
    assert notifier.watchdog_s is None


def test_nobody_at_the_socket_costs_a_message_and_no_time(tmp_path):
    notifier = Notifier(str(tmp_path / "gone"))
    notifier.alive()
    assert notifier.lost == 1


def test_a_reader_that_never_reads_does_not_block_the_loop(notify):
    notifier = Notifier(notify.address)
    for _ in range(2000):  # far more than a socket's queue holds
        notifier.alive()
    assert notifier.lost > 0


class Hangs(View, Listener):
    """A listener that holds up the loop from its tenth tick on."""

    def __init__(self):
        self.ticks, self.go_on = 0, threading.Event()

    def on_tick(self, tick):
        self.ticks += 1
        if self.ticks == 10:
            self.go_on.wait(30.0)


@pytest.mark.realtime
def test_a_loop_that_hangs_is_not_pinged_by_any_other_thread(tmp_path):
    notify, view, stop = NotifySocket(str(tmp_path / "n")), Hangs(), threading.Event()
    config = configuration.load(written(tmp_path, cell()))
    options = Options(view=view, notifier=Notifier(notify.address, 0.2))
    thread = threading.Thread(target=run, args=(config, options, stop), daemon=True)
    thread.start()
    try:
        assert notify.listen(20.0, until="READY=1")
        end = time.monotonic() + 10.0
        while view.ticks < 10 and time.monotonic() < end:
            time.sleep(0.01)
        notify.drain()
        alive = threading.active_count()
        assert not notify.listen(0.6, until="WATCHDOG=1")
        assert alive > 2  # source and others go on all the time
        view.go_on.set()
        assert notify.listen(5.0, until="WATCHDOG=1")
    finally:
        view.go_on.set()
        stop.set()
        thread.join(10.0)
        notify.close()
    assert not thread.is_alive()
