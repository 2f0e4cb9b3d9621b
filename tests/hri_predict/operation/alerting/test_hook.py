"""A hook's thread: it never holds up whoever hands it alerts, nor the end of the node."""

import logging
import threading
import time
from asyncio import CancelledError
from functools import partial

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.operation.alerting.command import CommandHook
from hri_predict.operation.alerting.hook import TELL_EVERY_S, Hook
from hri_predict.operation.alerting.kinds import hooks_of
from hri_predict.operation.alerting.sender import Sender, SendError
from hri_predict.operation.alerting.webhook import WebhookHook
from hri_predict.operation.monitoring.alerts import Alerts, AlertSettings
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.operation.alerting.servers import alert, place, silent_server, web_server
from tests.waiting import eventually


def settings(**changes):
    whole = {"kind": "webhook", "url": "http://localhost/", "debounce_s": 0} | changes
    return WebhookHook(**whole)


class Stuck(Sender):
    """A receiver that never answers, until it is freed."""

    def __init__(self):
        self.begun, self.free = threading.Event(), threading.Event()

    def send(self, _alert, _more_changes):
        self.begun.set()
        assert self.free.wait(60)
        return ""


class Failing(Sender):
    """A receiver that fails at once, and repeats the secret."""

    secrets = ("hunter2",)

    def __init__(self, *errors):
        self.errors, self.got = list(errors), []

    def send(self, alert, more_changes):
        if self.errors:
            raise self.errors.pop(0)
        self.got.append((alert.level, more_changes))
        return ""


def test_a_stuck_receiver_holds_up_nobody_and_what_it_missed_is_counted(tmp_path):
    stuck = Stuck()
    hook = Hook(settings(timeout_s=0.2), stuck)
    hook.start()
    hook.put(alert("slow"))
    assert stuck.begun.wait(10)
    for level in 50 * ["stop", "clear"]:
        hook.put(alert(level))
    begun = time.monotonic()
    hook.stop()
    hook.join(0.1)
    assert time.monotonic() - begun < 5  # 0.1 s, on a busy machine
    stuck.free.set()
    eventually(lambda: not hook._thread.is_alive())
    report = hook.report()
    assert (report["delivered"], report["left_out"], report["dropped"]) == (0, 99, 2)


def test_the_others_deliver_while_one_is_stuck(tmp_path):
    with silent_server() as port, web_server() as server:
        urls = [f"http://127.0.0.1:{port}", server.url]
        hooks = hooks_of([settings(url=url, timeout_s=30) for url in urls], place(tmp_path))
        for hook in hooks:
            hook.start()
            hook.put(alert())
        eventually(lambda: server.got)
        assert hooks[0].report()["delivered"] == 0
        for hook in hooks:
            hook.stop()
        hooks[0].join(0.1)
        hooks[1].join(10)
    assert [hook.report()["dropped"] for hook in hooks] == [1, 0]


def test_whatever_a_receiver_raises_the_thread_goes_on():
    sender = Failing(CancelledError("oops"), SendError("for good", permanent=True))
    hook = Hook(settings(retry_s=0), sender)
    hook.start()
    for level in ("slow", "stop"):
        before = hook.report()["dropped"]
        hook.put(alert(level))
        eventually(partial(has_dropped, hook, before + 1))
    hook.put(alert("clear"))
    hook.stop()
    hook.join(10)
    assert sender.got == [("clear", 2)]
    assert hook.report() == {
        "name": "webhook localhost",
        "delivered": 1,
        "left_out": 0,
        "dropped": 2,
        "retried": 0,
        "failures": 2,
        "last_error": "for good",
    }


def test_failures_are_told_once_a_minute_with_their_number_and_no_secret(caplog):
    clock = VirtualClock(0)
    sender = Failing(*(SendError(f"{i}: hunter2\nis wrong", permanent=True) for i in range(12)))
    hook = Hook(settings(), sender, clock)
    hook.start()

    def fail(number):
        hook.put(alert())
        eventually(lambda: hook.report()["failures"] == number)
        eventually(lambda: hook.last_error.startswith(f"{number - 1}:"))

    for number in range(1, 11):
        fail(number)
    clock.advance_to(int((TELL_EVERY_S + 1) * 1e9))
    fail(11)
    hook.stop()
    hook.join(10)
    lines = [record.getMessage() for record in caplog.records]
    assert lines == [
        "alert hook webhook localhost: 0: *** is wrong",
        "alert hook webhook localhost: 10: *** is wrong (10 failures)",
    ]
    assert all(record.levelno == logging.WARNING for record in caplog.records)


def test_the_debounce_of_a_hook_runs_on_its_clock():
    clock, sender = VirtualClock(0), Failing()
    hook = Hook(settings(debounce_s=0.3), sender, clock)
    hook.start()
    hook.put(alert("slow"))
    eventually(lambda: sender.got)
    hook.put(alert("stop"))
    time.sleep(0.5)
    assert sender.got == [("slow", 0)]
    clock.advance_to(300_000_000)
    eventually(lambda: len(sender.got) == 2)
    hook.stop()
    hook.join(10)


def test_what_waits_at_the_end_is_tried_once_more(tmp_path):
    with web_server() as server:
        server.statuses = [503, 200]
        (hook,) = hooks_of([settings(url=server.url)], place(tmp_path))
        hook.start()
        hook.put(alert())
        eventually(lambda: hook.report()["failures"] == 1)
        hook.stop()
        hook.join(10)
        report = hook.report()
    assert (report["delivered"], report["retried"], report["dropped"]) == (1, 1, 0)


def test_a_program_and_what_it_started_are_ended_with_the_node(tmp_path):
    mark = tmp_path / "pid"
    script = f"sleep 60 & echo $! > {mark}; wait"
    command = CommandHook(kind="command", command=["sh", "-c", script], timeout_s=60)
    (hook,) = hooks_of([command], place(tmp_path))
    hook.start()
    hook.put(alert())
    child = int(eventually(lambda: mark.exists() and mark.read_text()))
    hook.stop()
    hook.join(0.1)
    eventually(lambda: not is_running(child))
    assert hook.report()["dropped"] == 1


def has_dropped(hook, count):
    return hook.report()["dropped"] == count


def is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("threaded", [True, False])
def test_on_the_virtual_clock_no_hook_sends(threaded, tmp_path):
    with web_server() as server:
        alerts = Alerts(
            settings=AlertSettings(terminal=False, to=[settings(url=server.url)]),
            robots=["arm"],
            clock=VirtualClock(0),
            base_dir=tmp_path,
            threaded=threaded,
        )
        if threaded:
            alerts.start()
        alerts.observe((Advice(robot=0, level=Level.STOP, reason=Reason.PERSON_NEAR),))
        alerts.stop()
        assert len(server.got) == int(threaded)
        assert len(alerts.report()) == int(threaded)
