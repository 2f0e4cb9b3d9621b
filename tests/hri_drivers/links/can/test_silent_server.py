"""A CAN server that accepts connections and says nothing holds up neither start nor end."""

import signal
import threading
import time

import pytest
import yaml

from hri_drivers.links.can import opening
from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import CanTransport
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.run import config as configuration
from tests.silent_server import SilentServer, started
from tests.waiting import eventually

SHORT_S = 0.3
"""Longer than a local connection takes, by a factor of a hundred."""


@pytest.fixture
def server():
    server = SilentServer()
    yield server
    server.close()


def link(port, **more):
    return {
        "name": "drive", "kind": "can", "interface": "socketcand", "channel": "can0",
        "options": {"host": "127.0.0.1", "port": port},
    } | more  # fmt: skip


def threads():
    return {t.name for t in threading.enumerate() if t.name.startswith("drive")}


def test_the_opening_ends_with_one_line(server, monkeypatch):
    monkeypatch.setattr(opening, "OPEN_S", SHORT_S)
    wire = CanTransport(
        interface="socketcand", channel="can0", options={"host": "127.0.0.1", "port": server.port}
    )
    with pytest.raises(LinkError, match=r"does not open .no answer within 0.3 s.: it accepts"):
        wire.open()


def test_a_server_that_refuses_is_refused_at_once(server):
    server.close()
    wire = CanTransport(
        interface="socketcand", channel="can0", options={"host": "127.0.0.1", "port": server.port}
    )
    began = time.monotonic()
    with pytest.raises(LinkError, match="connection refused; start the server there"):
        wire.open()
    assert time.monotonic() - began < opening.REACH_S  # python-can alone: ten seconds


def test_a_link_that_waits_goes_on_and_ends(server, monkeypatch):
    monkeypatch.setattr(opening, "OPEN_S", SHORT_S)
    settings = CanLinkSettings(**link(server.port, wait_for_device=True))
    drive = CanLink(settings, MonotonicClock())
    drive.start()
    assert not drive.connected
    eventually(lambda: len(server.accepted) >= 4)  # two tries, each after a first connection
    assert "no answer" in str(drive.last_error)
    drive.stop()
    eventually(lambda: not threads())


def test_a_link_that_does_not_wait_fails(server, monkeypatch):
    monkeypatch.setattr(opening, "OPEN_S", SHORT_S)
    drive = CanLink(CanLinkSettings(**link(server.port)), MonotonicClock())
    with pytest.raises(LinkError, match="link 'drive': CAN interface socketcand"):
        drive.start()
    eventually(lambda: not threads())


def config_with(tmp_path, *links):
    config = yaml.safe_load(configuration.shipped("demo.yaml").read_text())
    config["links"] = [config["links"][0], *links]
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(config))
    return path


@pytest.mark.realtime
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)]
)
def test_a_signal_ends_a_start_that_hangs(tmp_path, server, number):
    process = started("run", str(config_with(tmp_path, link(server.port, name="monitor"))))
    try:
        eventually(lambda: len(server.accepted) >= 2, 60.0)
        began = time.monotonic()
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == {signal.SIGTERM: 0, signal.SIGINT: 130}[number], said
    assert "Traceback" not in said
    assert time.monotonic() - began < opening.OPEN_S  # it does not wait for the server


@pytest.mark.long
@pytest.mark.realtime
def test_a_start_ends_with_one_line_and_status_2(tmp_path, server):
    process = started("run", str(config_with(tmp_path, link(server.port, name="monitor"))))
    try:
        _, said = process.communicate(timeout=90)
    finally:
        process.kill()
    errors = [line for line in said.splitlines() if line.startswith("error: ")]
    assert process.returncode == 2
    assert len(errors) == 1
    assert "link 'monitor': CAN interface socketcand" in errors[0]
    assert "Traceback" not in said


@pytest.mark.long
@pytest.mark.realtime
def test_the_other_links_go_on(tmp_path, server):
    waits = link(server.port, name="monitor", wait_for_device=True)
    process = started("run", str(config_with(tmp_path, waits)), "--duration", "6", "--json")
    try:
        out, said = process.communicate(timeout=90)
    finally:
        process.kill()
    assert process.returncode == 0, said
    summary = yaml.safe_load(out)
    sent = {each["name"]: each["messages"] for each in summary["links"]}
    assert sent["drive"] > 100
    assert sent["monitor"] == 0
    assert "Failed to connect" not in said
