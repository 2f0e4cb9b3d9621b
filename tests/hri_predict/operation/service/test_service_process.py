"""A real node, as systemd would start, watch, reload and stop it."""

import itertools
import json
import signal
import time
import urllib.request

import pytest

from hri_predict.node.memory import VERSION
from tests.hri_predict.operation.alerting.servers import web_server
from tests.hri_predict.operation.service.cells import (
    WATCHDOG_S,
    NotifySocket,
    Service,
    cell,
    written,
)
from tests.waiting import eventually, free_port

pytestmark = pytest.mark.realtime
START_S = 30.0  # on a busy machine the imports alone take many seconds


def test_a_node_says_ready_then_pings_at_half_the_watchdog_then_stopping(tmp_path):
    notify = NotifySocket("@" + str(tmp_path)[-80:])
    service = Service(written(tmp_path, cell()), notify)
    try:
        assert notify.listen(START_S, until="READY=1"), service.says()
        notify.listen(4 * WATCHDOG_S)
        service.send(signal.SIGTERM)
        assert notify.listen(10.0, until="STOPPING=1")
        assert service.process.wait(15.0) == 0
    finally:
        service.end()
        notify.close()
    pings = notify.times("WATCHDOG=1")
    gaps = [b - a for a, b in itertools.pairwise(pings)]
    assert len(pings) >= 6
    # half the time, and one tick of 40 ms at most; what is above is the machine's own delay
    assert sorted(gaps)[len(gaps) // 2] == pytest.approx(WATCHDOG_S / 2, abs=0.06)
    assert max(gaps) < WATCHDOG_S
    statuses = [x for _, lines in notify.heard for x in lines if x.startswith("STATUS=")]
    assert "arm" in statuses[0]
    assert len(statuses) <= 10  # not one a tick


def test_a_node_that_stands_still_is_killed_and_started_anew_by_its_watchdog(tmp_path):
    """The supervisor here does what systemd does with ``WatchdogSec`` and ``Restart``."""
    notify = NotifySocket(str(tmp_path / "notify"))
    config = written(tmp_path, cell(state=str(tmp_path / "state.json")))
    service = Service(config, notify)
    starts = 1
    try:
        assert notify.listen(START_S, until="READY=1"), service.says()
        assert notify.listen(2 * WATCHDOG_S, until="WATCHDOG=1")
        service.send(signal.SIGSTOP)
        notify.drain()
        while notify.listen(WATCHDOG_S, until="WATCHDOG=1"):
            pass  # none comes: a stopped node does not ping
        service.end()
        service, starts = Service(config, notify), starts + 1
        assert notify.listen(START_S, until="READY=1"), service.says()
        assert notify.listen(2 * WATCHDOG_S, until="WATCHDOG=1")
        end = time.monotonic() + 10.0
        while not (tmp_path / "state.json").exists() and time.monotonic() < end:
            time.sleep(0.02)  # a thread of its own writes it
    finally:
        service.end()
        notify.close()
    assert starts == 2
    assert json.loads((tmp_path / "state.json").read_bytes())["version"] == VERSION


def get(port, path):
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=5) as answer:
        return answer.read().decode()


def test_hangup_reloads_a_service_and_names_what_needs_a_restart(tmp_path):
    first, second = free_port(), free_port()
    notify = NotifySocket(str(tmp_path / "notify"))
    config = written(tmp_path, cell(metrics={"port": first}))
    service = Service(config, notify)
    try:
        assert notify.listen(START_S, until="READY=1"), service.says()
        assert json.loads(get(first, "/healthz"))["ok"]
        written(tmp_path, cell(metrics={"port": second}, log={"format": "json"}, rate_hz=50))
        service.send(signal.SIGHUP)
        service.waits_for("rate_hz: needs a restart")
        assert 'hri_robot_level{robot="arm"' in get(second, "/metrics")
        with pytest.raises(OSError):
            get(first, "/healthz")
        config.write_text("rate_hz: [", encoding="utf-8")
        service.send(signal.SIGHUP)
        service.waits_for("nothing changed")
        assert 'hri_events_total{event="reload_failures"}' in get(second, "/metrics")
        assert service.process.poll() is None
        notify.listen(WATCHDOG_S)
    finally:
        service.end()
        notify.close()
    reloads = [lines for _, lines in notify.heard if "RELOADING=1" in lines]
    assert len(reloads) == 2
    assert all(lines[1].startswith("MONOTONIC_USEC=") for lines in reloads)
    last = json.loads(service.says().splitlines()[-1])  # the format changed, too
    assert last["severity"] == "warning"
    assert "cell.yaml" in last["message"]


def test_hangup_exchanges_the_receivers_of_alerts_and_a_wrong_file_keeps_them(tmp_path):
    def alerts(server, **changes):
        hook = {"kind": "webhook", "url": server.url, "debounce_s": 0} | changes
        return cell(alerts={"terminal": False, "to": [hook]})

    notify = NotifySocket(str(tmp_path / "notify"))
    with web_server() as first, web_server() as second:
        service = Service(written(tmp_path, alerts(first)), notify)
        try:
            assert notify.listen(START_S, until="READY=1"), service.says()
            eventually(lambda: first.got)
            written(tmp_path, alerts(second))
            service.send(signal.SIGHUP)
            service.waits_for("alerts.to.0.url: changed")
            written(tmp_path, alerts(first, token_file="missing"))
            service.send(signal.SIGHUP)
            service.waits_for("nothing changed: alert hook webhook")
            notify.listen(WATCHDOG_S)
            before = len(first.got)
            service.send(signal.SIGTERM)
            assert service.process.wait(15.0) == 0
        finally:
            service.end()
            notify.close()
        assert len(first.got) == before
        assert json.loads(second.got[-1][2])["reason"] == "the node is stopping"
