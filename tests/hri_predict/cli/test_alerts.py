"""``alerts``, and what ``check`` says of hooks."""

import json
import sys

import pytest

from tests.hri_predict.commissioning.cells import cell_data, write_cell
from tests.hri_predict.operation.alerting.servers import silent_server, web_server
from tests.waiting import free_port


def cell(folder, *hooks):
    return write_cell(folder, cell_data(alerts={"terminal": False, "to": list(hooks)}))


def webhook(port, **settings):
    return {"kind": "webhook", "url": f"http://127.0.0.1:{port}/", "timeout_s": 1} | settings


def test_a_test_alert_goes_through_each_hook(cli, tmp_path):
    with web_server() as server:
        path = cell(tmp_path, webhook(server.server_address[1]))
        status, out, err = cli("alerts", path, "--test")
    assert (status, err) == (0, "")
    assert out == f"webhook 127.0.0.1:{server.server_address[1]}: ok: HTTP status 200\n"
    got = json.loads(server.got[0][2])
    assert got["test"] is True
    assert got["cell"] == "cell"
    assert "robot" not in got


def test_one_that_fails_is_status_1_and_the_others_are_tried(cli, tmp_path):
    with web_server() as server, silent_server() as stuck:
        hooks = [
            webhook(stuck),
            webhook(free_port(), name="nobody"),
            webhook(server.server_address[1]),
        ]
        status, out, _ = cli("alerts", cell(tmp_path, *hooks), "--test", "--json")
    assert status == 1
    found = json.loads(out)
    assert [hook["ok"] for hook in found] == [False, False, True]
    assert found[1] == {
        "name": "nobody",
        "kind": "webhook",
        "notes": [],
        "ok": False,
        "answer": "Connection refused",
    }


def test_without_test_it_only_shows_them(cli, tmp_path):
    with web_server() as server:
        url = f"http://host.example:{server.server_address[1]}/path"
        status, out, _ = cli("alerts", cell(tmp_path, webhook(0, url=url)))
        assert server.got == []
    assert status == 0
    assert out.startswith("webhook host.example:")
    assert "use https" in out


@pytest.mark.parametrize("command", ["check", "alerts"])
def test_a_secret_that_is_missing_is_one_line(command, cli, tmp_path):
    status, _, err = cli(command, cell(tmp_path, webhook(1, token_file="no.token")))
    assert status == 2
    assert "alert hook webhook 127.0.0.1:1: token_file" in err
    assert len(err.splitlines()) == 1


def test_a_cell_without_hooks_is_told(cli, tmp_path):
    status, _, err = cli("alerts", cell(tmp_path))
    assert status == 2
    assert "no hooks; add one under alerts.to" in err


def test_a_missing_package_is_told_with_its_extra(cli, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "paho.mqtt", None)
    status, _, err = cli("alerts", cell(tmp_path, {"kind": "mqtt", "host": "localhost"}))
    assert status == 2
    assert "pip install" in err
    assert "[mqtt]'" in err


def test_check_shows_hooks_and_warns_of_what_goes_out_in_clear(cli, tmp_path):
    hooks = [webhook(0, url="http://hooks.example/"), {"kind": "syslog", "host": "127.0.0.1"}]
    status, out, _ = cli("check", cell(tmp_path, *hooks))
    assert status == 0
    assert "alert hooks: webhook hooks.example, syslog 127.0.0.1:514" in out
    assert out.count("alerts: http without TLS to hooks.example") == 1


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"robots": ["amr"]}, "alerts.to.0.robots: no robot 'amr'; did you mean 'arm'?"),
        ({"zones": ["hatch"]}, "alerts.to.0.zones: no zone 'hatch'; available: none"),
    ],
)
def test_a_robot_or_zone_that_is_not_there_is_told(settings, words, cli, tmp_path):
    status, _, err = cli("check", cell(tmp_path, webhook(1, **settings)))
    assert status == 2
    assert words in err
