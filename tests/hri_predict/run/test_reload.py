"""What a reload takes, what it leaves, and that it never takes a half."""

import copy
import logging
import socket
from typing import Any

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.recording.folder.folder import Folder
from hri_predict.run import config as configuration
from hri_predict.run.serving import RECORD_LIMITS, Reload, Serving, _takes_limits, differences
from tests.hri_predict.operation.service.cells import cell, written
from tests.hri_predict.operation.service.test_metrics import figures
from tests.waiting import free_port


class Parts:
    """Takers that note what is put in force; ``refuse`` makes metrics refuse."""

    def __init__(self):
        self.in_force, self.refuse = [], False

    def log(self, node):
        return lambda: self.in_force.append(("log", node.log.level))

    def metrics(self, node):
        if self.refuse:
            raise ConfigError("metrics: port 1: in use; choose another port")
        return lambda: self.in_force.append(("metrics", node.metrics))


@pytest.fixture
def parts():
    return Parts()


@pytest.fixture
def reload(tmp_path, parts):
    path = written(tmp_path, cell())
    config = configuration.load(path)
    return Reload(
        config, lambda: configuration.load(path), {"log": parts.log, "metrics": parts.metrics}
    )


@pytest.fixture
def said(caplog):
    def lines():
        return [r.getMessage().removeprefix("reload: ") for r in caplog.records]

    caplog.set_level(logging.WARNING)
    return lines


def test_a_file_that_says_the_same_changes_nothing(reload, parts, said):
    reload.now()
    assert said() == ["nothing differs"]
    assert parts.in_force == []


def test_safe_keys_are_taken_and_the_others_named_one_a_line(tmp_path, reload, parts, said):
    data = cell(log={"level": "info"}, rate_hz=50)
    data["robots"][0]["max_speed_m_s"] = 0.5
    written(tmp_path, data)
    reload.now()
    assert parts.in_force == [("log", "info")]
    assert said() == [
        "log.level: changed",
        "rate_hz: needs a restart",
        "robots.0.max_speed_m_s: needs a restart",
    ]


def test_what_waits_for_a_restart_is_named_again_and_what_was_taken_is_not(
    tmp_path, reload, parts, said
):
    written(tmp_path, cell(log={"level": "info"}, rate_hz=50))
    reload.now()
    reload.now()
    assert said()[2:] == ["rate_hz: needs a restart"]
    assert len(parts.in_force) == 1


@pytest.mark.parametrize(
    "text", ["rate_hz: [", "rate_hz: 25\n", "nonsense: 1\n", "\x00", ""], ids=repr
)
def test_a_wrong_file_changes_nothing_and_is_told_in_one_line(tmp_path, reload, parts, said, text):
    (tmp_path / "cell.yaml").write_text(text, encoding="utf-8")
    reload.now()
    (line,) = said()
    assert line.startswith("nothing changed: ")
    assert "\n" not in line
    assert (reload.failures, parts.in_force) == (1, [])


def test_a_file_that_is_gone_changes_nothing(tmp_path, reload, said):
    (tmp_path / "cell.yaml").unlink()
    reload.now()
    assert said()[0].startswith("nothing changed: ")


def test_where_one_part_refuses_no_part_changes(tmp_path, reload, parts, said):
    written(tmp_path, cell(log={"level": "info"}, metrics={"port": 1}))
    parts.refuse = True
    reload.now()
    assert said() == ["nothing changed: metrics: port 1: in use; choose another port"]
    assert parts.in_force == []
    parts.refuse = False
    reload.now()  # it was not noted as taken
    assert [name for name, _ in parts.in_force] == ["log", "metrics"]


def test_receivers_of_alerts_are_exchanged_as_a_whole(tmp_path, said):
    """Entries of other kinds, and more of them, are in the place of old ones."""
    hook = {"kind": "webhook", "url": "http://127.0.0.1:1/"}
    path = written(tmp_path, cell(alerts={"to": [hook, hook]}))
    config, taken = configuration.load(path), list[Any]()

    def take(node):
        return lambda: taken.append(node.alerts)

    reload = Reload(config, lambda: configuration.load(path), {"alerts": take})
    syslog = {"kind": "syslog", "host": "127.0.0.1"}
    for to in ([hook, syslog], [syslog], [], [{**hook, "debounce_s": 7}]):
        written(tmp_path, cell(alerts={"to": to}))
        reload.now()
        reload.now()  # it knows what is in force
        assert said()[-1] == "nothing differs"
        assert [each.kind for each in taken[-1].to] == [each["kind"] for each in to]
    assert len(taken) == 4
    assert reload.failures == 0


def test_parts_are_asked_in_their_order_whatever_changed_first(tmp_path, parts, said):
    """Metrics open a socket to check it, so they come last."""
    path = written(tmp_path, cell())
    order = list[str]()
    names = ("log", "alerts", "metrics")

    def taker(name):
        def take(_):
            order.append(name)
            return lambda: None

        return take

    takers = {name: taker(name) for name in names}
    reload = Reload(configuration.load(path), lambda: configuration.load(path), takers)
    written(tmp_path, cell(alerts={"debounce_s": 3}, metrics={"port": 1}, log={"level": "info"}))
    reload.now()
    assert order == list(names)


def test_a_folder_of_recordings_keeps_to_new_limits_but_never_moves(tmp_path, said):
    record = {"folder": str(tmp_path / "recordings"), "keep_days": 9, "max_mb": 10}
    path = written(tmp_path, cell(record=record))
    config = configuration.load(path)
    assert config.node.record is not None
    folder = Folder(tmp_path / "recordings", "cell", config.node.record)
    parts = {f"record.{key}": _takes_limits(folder) for key in RECORD_LIMITS}
    reload = Reload(config, lambda: configuration.load(path), parts)
    written(tmp_path, cell(record={**record, "keep_days": 2, "zones_hz": 1}))
    reload.now()
    folder.close()
    assert said() == ["record.keep_days: changed", "record.zones_hz: needs a restart"]
    assert folder._settings.keep_days == 2


def test_metrics_move_to_all_addresses_at_the_same_port_or_stay(tmp_path, said):
    """The port is in use at all addresses while the old server has it at one."""
    port = free_port()
    path = written(tmp_path, cell(metrics={"port": port}))
    serving = Serving(configuration.load(path), None, lambda: configuration.load(path))
    serving._figures = figures()
    serving._take_metrics(configuration.load(path).node)()
    reload, serving._parts["metrics"] = serving._reload, serving._take_metrics
    assert reload is not None
    try:
        for host, line in (
            ("192.0.2.1", f"nothing changed: metrics: 192.0.2.1 port {port}: Cannot assign"),
            ("0.0.0.0", "metrics.host: changed"),
            ("127.0.0.1", "metrics.host: changed"),
        ):
            written(tmp_path, cell(metrics={"port": port, "host": host}))
            reload.now()
            assert said()[-1].startswith(line)
            with socket.create_connection(("127.0.0.1", port), 5.0) as client:
                client.sendall(b"GET /metrics HTTP/1.1\r\n\r\n")
                assert client.recv(12) == b"HTTP/1.1 200"
    finally:
        serving.close()


def test_differences_name_the_deepest_key():
    old: dict[str, Any] = {"a": {"b": [1, {"c": 2}]}, "d": [1], "e": None}
    new = copy.deepcopy(old)
    new["a"]["b"][1]["c"] = 3
    new["d"].append(2)
    new["e"] = {"f": 1}
    assert list(differences(old, new)) == ["a.b.1.c", "d", "e"]
    assert list(differences(old, copy.deepcopy(old))) == []
