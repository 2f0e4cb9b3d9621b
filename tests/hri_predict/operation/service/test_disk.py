"""A full disk, files that are moved away, and a node that is killed: what can be read after."""

import json
import random
import resource
import signal
import time
import urllib.request

import pytest
import yaml

from hri_predict.node.memory import VERSION
from hri_predict.recording import read_messages
from tests.hri_predict.operation.service.cells import NotifySocket, Service, cell, written
from tests.waiting import eventually, free_port

pytestmark = [pytest.mark.realtime, pytest.mark.long]
START_S = 60.0
PATIENCE_S = 60.0  # a machine that is busy with other things
RUN = 1.5  # seconds within which the cell's level changes after the start


@pytest.fixture
def notify(tmp_path):
    one = NotifySocket("@" + str(tmp_path)[-80:])
    yield one
    one.close()


def everything(folder, **more):
    """A cell that writes all that a node can write, into ``folder``."""
    return cell(
        alerts={"terminal": False, "file": "alerts.jsonl"},
        state={"path": "state.json", "max_age_s": 60},
        record={"folder": "recordings", "min_free_gb": 0},
        log={"format": "json"},
        **more,
    )


def events(port):
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=PATIENCE_S) as answer:
        lines = answer.read().decode().splitlines()
    return {
        line.split('"')[1]: float(line.split()[-1])
        for line in lines
        if line.startswith("hri_events_total{")
    }


def lines_of(path):
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_alerts_go_on_in_a_new_file_after_logrotate_moved_the_old_one(tmp_path, notify):
    service = Service(written(tmp_path, everything(tmp_path)), notify)
    alerts, moved = tmp_path / "alerts.jsonl", tmp_path / "alerts.jsonl.1"
    try:
        assert notify.listen(START_S, until="READY=1"), service.says()
        eventually(lambda: alerts.exists() and alerts.stat().st_size)
        alerts.rename(moved)
        service.send(signal.SIGTERM)
        assert service.process.wait(PATIENCE_S) == 0
    finally:
        service.end()
    assert lines_of(moved)[0]["reason"]
    assert "stop" in lines_of(alerts)[-1]["reason"]  # the node's last words


def test_a_full_disk_is_counted_and_the_loop_goes_on_and_writes_again_later(tmp_path, notify):
    """No file of the process may grow for a time: every write fails, as on a full disk."""
    port = free_port()
    config = written(tmp_path, everything(tmp_path, metrics={"port": port}))
    service = Service(config, notify, watchdog_s=2.0)
    state = tmp_path / "state.json"
    try:
        assert notify.listen(START_S, until="READY=1"), service.says()
        eventually(state.exists)
        pid = service.process.pid
        _, most = resource.prlimit(pid, resource.RLIMIT_FSIZE)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, most))
        eventually(lambda: events(port).get("state_write_failures", 0) >= 1)
        # not even its mark can be written: an old file would pass for the last word
        eventually(lambda: not state.exists())
        notify.drain()
        assert notify.listen(PATIENCE_S, until="WATCHDOG=1")
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, most))
        eventually(state.exists)
        assert json.loads(state.read_bytes())["version"] == VERSION
        service.send(signal.SIGTERM)
        assert service.process.wait(PATIENCE_S) in (0, 1)  # 1: it says that the recording has a gap
    finally:
        service.end()


def test_after_kill_9_at_random_moments_everything_is_readable(tmp_path, notify):
    draw = random.Random(17)
    config = written(tmp_path, everything(tmp_path))
    text = config.read_bytes()
    for _ in range(4):
        service = Service(config, notify)
        try:
            assert notify.listen(START_S, until="READY=1"), service.says()
            eventually((tmp_path / "alerts.jsonl").exists)
            time.sleep(draw.uniform(0.0, RUN))
        finally:
            service.end()  # SIGKILL
        assert config.read_bytes() == text
        assert yaml.safe_load(text)["rate_hz"] == 25
        if (tmp_path / "state.json").exists():  # else it was killed before the first write
            assert json.loads((tmp_path / "state.json").read_bytes())["version"] == VERSION
        assert all(line["level"] for line in lines_of(tmp_path / "alerts.jsonl"))
        assert all(line["severity"] for line in lines_of(service.log))
    recordings = sorted((tmp_path / "recordings").glob("*.mcap"))
    assert len(recordings) == 4
    for path in recordings:
        assert sum(1 for _ in read_messages(path)) > 0, path
