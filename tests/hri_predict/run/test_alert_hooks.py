"""A running node with alert hooks: delivered, counted, and no secret anywhere."""

import json
import time
from dataclasses import replace

import pytest

from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.engine import RiskEngine
from hri_predict.run.session import Options, run
from tests.hri_predict.commissioning.cells import cell_data, load_cell
from tests.hri_predict.operation.alerting.servers import silent_server, web_server


def cell(folder, *hooks, **alerts):
    data = cell_data(alerts={"terminal": False, "to": list(hooks), **alerts}, links=[])
    data["robots"][0]["motion"] = {"kind": "standing", "positions": [0.0, -1.5, 1.5, 0.0, 0.0, 0.0]}
    return load_cell(folder, data)


@pytest.mark.realtime
def test_alerts_are_delivered_and_counted_and_no_secret_is_kept(tmp_path, caplog):
    (tmp_path / "token").write_text("hunter2")
    with web_server() as server:
        hook = {"kind": "webhook", "url": server.url, "token_file": "token", "debounce_s": 0}
        config = cell(tmp_path, hook)
        summary = run(config, Options(duration_s=1.5, record=tmp_path / "a.mcap"))
    got = [json.loads(body) for _, _, body in server.got]
    assert {each["cell"] for each in got} == {"cell"}
    assert got[-1]["reason"] == "the node is stopping"
    (row,) = summary.alerts
    assert row["delivered"] == len(got) > 0
    assert row["delivered"] + row["left_out"] >= 2
    assert row["dropped"] == row["failures"] == 0
    everything = (tmp_path / "a.mcap").read_bytes() + json.dumps(summary.as_dict()).encode()
    assert b"hunter2" not in everything + caplog.text.encode()


@pytest.mark.realtime
def test_three_hooks_that_never_answer_hold_up_neither_ticks_nor_the_end(tmp_path):
    with silent_server() as silent, silent_server(b"x") as dripping:
        hooks = [
            {"kind": "webhook", "url": f"http://127.0.0.1:{dripping}"},
            {"kind": "email", "host": "127.0.0.1", "port": silent, "security": "none",
             "sender": "a@b.example", "recipients": ["c@d.example"]},
            {"kind": "syslog", "protocol": "tls", "host": "127.0.0.1", "port": silent},
        ]  # fmt: skip
        config = cell(tmp_path, *hooks)
        begun = time.monotonic()
        summary = run(config, Options(duration_s=1.5))
        took_s = time.monotonic() - begun
    assert summary.ticks >= 30  # of 37: a busy machine may miss some
    assert [row["delivered"] for row in summary.alerts] == [0, 0, 0]
    assert all(row["dropped"] >= 1 for row in summary.alerts)
    assert took_s < 1.5 + 10  # the hooks' 2.5 s, and the assembly


def test_a_replay_has_no_hooks(tmp_path):
    config = cell(tmp_path, {"kind": "webhook", "url": "http://127.0.0.1:1/"})
    assert config.node.alerts.hooks
    assert config.aside().node.alerts.hooks == []


def test_a_named_zone_is_occupied_while_ticks_fail(tmp_path, monkeypatch):
    """An "empty" from before the fault would stand at receivers that keep the newest alert."""
    config = cell(tmp_path, file="a.jsonl")
    square = [[25.0, 25.0], [26.0, 25.0], [26.0, 26.0], [25.0, 26.0]]
    zone = NamedZoneSettings.model_validate({"name": "far", "polygon": square})
    config = replace(config, node=config.node.model_copy(update={"zones": [zone]}))
    assess, begun = RiskEngine.assess, list[int]()

    def fails(self, snapshot, *rest):
        begun.append(snapshot.now_ns)
        if 2.0 < (begun[-1] - begun[0]) * 1e-9 < 3.0:
            raise RuntimeError("a bug")
        return assess(self, snapshot, *rest)

    monkeypatch.setattr(RiskEngine, "assess", fails)
    run(config, Options(factor=None, duration_s=4.0))
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    states = [each["state"] for each in lines if "zone" in each]
    # occupied: before the first scene, in the fault, and when the node stops
    assert states == ["occupied", "empty", "occupied", "empty", "occupied"]
