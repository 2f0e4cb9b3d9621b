"""Hooks that are exchanged while alerts come: nothing is lost without being counted."""

import threading
import time

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.operation.alerting.hook import Hook
from hri_predict.operation.alerting.hooks import Hooks
from hri_predict.operation.alerting.sender import Sender
from hri_predict.operation.alerting.webhook import WebhookHook
from tests.hri_predict.operation.alerting.servers import alert, place, silent_server, web_server
from tests.waiting import eventually


def settings(url, **changes):
    values = {"kind": "webhook", "debounce_s": 0, "rate_per_minute": 6000}
    return WebhookHook.model_validate({**values, "url": url, **changes})


def ended(hooks):
    begun_s = time.monotonic()
    hooks.stop()
    hooks.join(begun_s)
    return hooks.report()


def test_a_hook_with_the_same_settings_goes_on_with_what_waits(tmp_path):
    with web_server() as server, web_server() as other:
        slow = settings(server.url, debounce_s=3600)
        hooks = Hooks([slow], place(tmp_path))
        hooks.start()
        hooks.put(alert("stop"))
        eventually(lambda: len(server.got) == 1)
        hooks.put(alert("clear"))  # waits for the debounce
        hooks.exchange([settings(other.url), settings(server.url, debounce_s=3600)])()
        hooks.put(alert("slow"))
        eventually(lambda: len(other.got) == 1)
        assert len(server.got) == 1
        rows = {row["name"]: row for row in ended(hooks)}
    assert len(rows) == 2
    kept = rows[slow.label]
    assert (kept["delivered"], kept["left_out"], kept["dropped"]) == (2, 1, 0)


def test_one_that_is_left_out_sends_what_waits_and_its_counts_stay(tmp_path):
    with web_server() as server, web_server() as other:
        hooks = Hooks([settings(server.url, debounce_s=3600)], place(tmp_path))
        hooks.start()
        hooks.put(alert("stop"))
        eventually(lambda: len(server.got) == 1)
        hooks.put(alert("clear"))
        hooks.exchange([settings(other.url)])()
        eventually(lambda: len(server.got) == 2)
        hooks.put(alert("stop"))
        eventually(lambda: len(other.got) == 1)
        assert len(server.got) == 2
        hooks.exchange([settings(server.url)])()  # the same name again: counted together
        hooks.put(alert("slow"))
        rows = ended(hooks)
    delivered = {row["name"]: row["delivered"] for row in rows}
    assert sorted(delivered.values()) == [1, 3]
    assert len(rows) == 2


def test_one_that_cannot_be_used_changes_nothing(tmp_path):
    with web_server() as server:
        hooks = Hooks([settings(server.url)], place(tmp_path))
        hooks.start()
        with pytest.raises(ConfigError, match="alert hook webhook"):
            hooks.exchange([settings(server.url, token_file="missing")])
        hooks.put(alert())
        eventually(lambda: len(server.got) == 1)
        ended(hooks)


def test_failures_never_go_down(tmp_path):
    with silent_server() as port:
        url = f"http://127.0.0.1:{port}"
        hooks = Hooks([settings(url, timeout_s=0.1, retry_s=0)], place(tmp_path))
        hooks.start()
        hooks.put(alert())
        eventually(lambda: hooks.failures == 1)
        hooks.exchange([])()
        assert hooks.failures == 1
        assert hooks.report()[0]["dropped"] == 1
        eventually(lambda: not hooks._ending)
        assert hooks.failures == 1


def test_nobody_waits_for_one_that_is_left_out_and_hangs(tmp_path):
    with silent_server() as port, web_server() as server:
        hanging = settings(f"http://127.0.0.1:{port}", timeout_s=30)
        hooks = Hooks([hanging], place(tmp_path))
        hooks.start()
        hooks.put(alert())
        put_in_force = hooks.exchange([settings(server.url)])
        begun_s = time.monotonic()
        put_in_force()
        took_s = time.monotonic() - begun_s
        hooks.put(alert())
        eventually(lambda: len(server.got) == 1)
        ended(hooks)
        eventually(lambda: not hooks._ending)  # two waited for its end
        rows = {row["name"]: row for row in hooks.report()}
    assert took_s < 2.0  # its bound is 2.5 s
    assert rows[hanging.label]["dropped"] == 1


def test_after_the_end_nothing_starts(tmp_path):
    with web_server() as server:
        hooks = Hooks([], place(tmp_path))
        put_in_force = hooks.exchange([settings(server.url)])
        hooks.start()
        ended(hooks)
        put_in_force()
        hooks.put(alert())
        assert hooks.report() == []


def test_every_alert_is_counted_while_hooks_come_and_go(tmp_path):
    count = 0
    with web_server() as server:
        hooks = Hooks([settings(server.url)], place(tmp_path))
        hooks.start()
        putting, enough = threading.Event(), threading.Event()

        def put():
            nonlocal count
            while not enough.is_set():
                hooks.put(alert("stop", robot=f"arm{count % 3}"))
                count += 1
                putting.set()
                if count % 50 == 0:
                    time.sleep(0.002)

        thread = threading.Thread(target=put)
        thread.start()
        putting.wait(5)
        for exchange in range(10):
            changes = {"name": f"n{exchange % 2}", "retry_s": exchange}
            hooks.exchange([settings(server.url, **changes)])()
        enough.set()
        thread.join(20)
        rows = ended(hooks)
    assert sum(row["delivered"] + row["left_out"] + row["dropped"] for row in rows) == count
    assert sum(row["delivered"] for row in rows) == len(server.got)


def test_one_whose_end_two_wait_for_loses_its_alert_once(tmp_path):
    release = threading.Event()

    class Hanging(Sender):
        def send(self, alert, more_changes):
            release.wait(30)
            return ""

    hook = Hook(settings("http://127.0.0.1:1"), Hanging())
    hook.start()
    hook.put(alert())
    eventually(lambda: hook._under_way)
    hook.stop()
    hook.join(0.01)
    hook.join(0.01)
    assert hook.report()["dropped"] == 1
    release.set()
