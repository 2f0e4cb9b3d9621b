"""Discovery over real multicast DNS on the loopback interface."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from zeroconf import DNSOutgoing, DNSPointer, ServiceInfo, Zeroconf, const

from hri_predict.base.errors import ConfigError, DiscoveryError
from hri_predict.base.settings import validated
from hri_predict.cli.discover import discover as command
from hri_predict.protocol.discovery import browser
from hri_predict.protocol.discovery.announcer import Announcer
from hri_predict.protocol.discovery.browser import discover, resolve
from hri_predict.protocol.discovery.services import (
    CONTROLLERS,
    MAX_LABEL,
    NODE,
    SOURCES,
    DiscoverySettings,
    Service,
    ServiceSettings,
    instance,
    printable,
    txt,
)
from hri_predict.run import config as configuration
from hri_predict.run import session
from hri_predict.run.session import Options

TAG = f"test{os.getpid()}"  # what other programs of this machine announce is not ours to judge
TCP = SOURCES[0]


def properties(name: str, pid: int | None = None) -> dict[str, str]:
    return {"node": name, "host": socket.gethostname(), "pid": str(pid or os.getpid())}


def mine(services: list[Service]) -> list[Service]:
    return [s for s in services if TAG in s.name]


@pytest.fixture(autouse=True)
def others() -> Iterator[None]:
    """Other programs that share port 5353: a unicast answer to it reaches one of them, or us."""
    with contextlib.ExitStack() as opened:
        for _ in range(8):
            other = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            other.bind(("127.0.0.1", 5353))
        yield


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


@pytest.fixture
def announced(server: socket.socket) -> Iterator[Zeroconf]:
    """A source and a controller whose port is open, a source whose port is closed, a datagram's."""
    port = server.getsockname()[1]
    with socket.create_server(("127.0.0.1", 0)) as gone:
        closed = gone.getsockname()[1]
    zeroconf = Zeroconf(interfaces=["127.0.0.1"])
    infos = [
        _info(TCP, f"{TAG} camera", port),
        _info(TCP, f"{TAG} shut", closed),
        _info(SOURCES[1], f"{TAG} mocap", port),
        _info(CONTROLLERS[0], f"{TAG} plc", port),
    ]
    threads = [threading.Thread(target=zeroconf.register_service, args=(i,)) for i in infos]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    yield zeroconf
    zeroconf.close()


def _info(service_type: str, name: str, port: int) -> ServiceInfo:
    address = socket.inet_aton("127.0.0.1")
    said = {"units": "m", "odd": b"\xff\x1b[31m"}
    return ServiceInfo(
        service_type, f"{name}.{service_type}", port, 0, 0, said, "x.local.", addresses=[address]
    )


@pytest.mark.realtime
def test_sources_and_controllers_are_found_looked_at_and_resolved(
    announced: Zeroconf, server: socket.socket, capsys: pytest.CaptureFixture[str]
) -> None:
    found = {s.name.removeprefix(f"{TAG} "): s for s in mine(discover(0.5))}
    assert {name: (s.kind, s.liveness) for name, s in found.items()} == {
        "camera": ("source", "answers"),
        "shut": ("source", "port closed"),
        "mocap": ("source", "answers"),
        "plc": ("controller", "answers"),
    }
    assert found["camera"].properties["units"] == "m"
    command(0.5, ["127.0.0.1"], as_json=True)
    told = [s for s in json.loads(capsys.readouterr().out) if TAG in s["name"]]
    assert [s["liveness"] for s in told] == ["answers", "answers", "port closed", "answers"]
    assert found["camera"].properties["odd"].isprintable()
    assert resolve(TCP, f"{TAG} camera", 5.0) == server.getsockname()
    with pytest.raises(DiscoveryError, match=rf"'{TAG} kamera' .*did you mean '{TAG} camera'"):
        resolve(TCP, f"{TAG} kamera", 0.5)


@pytest.mark.realtime
def test_who_is_there_is_never_called_vanished(announced: Zeroconf) -> None:
    """However often it is asked: the same record is multicast once in a second (RFC 6762, 6)."""
    for _ in range(5):
        found = [s.liveness for s in mine(discover(0.3))]
        assert sorted(found) == ["answers", "answers", "answers", "port closed"]


@pytest.mark.long
@pytest.mark.realtime
def test_multicast_answers_are_enough(
    announced: Zeroconf, server: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As behind a firewall that lets only port 5353 in."""
    monkeypatch.setattr(browser, "OWN_PORT_S", 0.0)
    for _ in range(2):
        found = [s.liveness for s in mine(discover(0.3))]
        assert sorted(found) == ["answers", "answers", "answers", "port closed"]
        assert resolve(TCP, f"{TAG} camera", browser.ANSWER_S) == server.getsockname()


@pytest.mark.long
@pytest.mark.realtime
def test_names_that_no_service_can_have_hide_no_other(announced: Zeroconf) -> None:
    """Whoever is on the network can send such an answer, unasked."""
    over = threading.Event()

    def send() -> None:
        while not over.wait(0.05):
            for bad in (f"{TAG} \x01\x1b[31m.{TCP}", f"{TAG} elsewhere.local."):
                out = DNSOutgoing(const._FLAGS_QR_RESPONSE | const._FLAGS_AA)
                pointer = DNSPointer(TCP, const._TYPE_PTR, const._CLASS_IN, 2, bad)
                out.add_answer_at_time(pointer, 0)
                announced.send(out)

    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    try:
        found = {s.name.removeprefix(f"{TAG} "): s.liveness for s in mine(discover(0.5))}
    finally:
        over.set()
        sender.join()
    assert found.pop("??[31m") == "vanished"
    assert found.pop("elsewhere.local.") == "vanished"
    assert len(found) == 4


@pytest.mark.realtime
@pytest.mark.long
def test_two_nodes_of_one_name_are_told_apart_and_withdraw() -> None:
    other = subprocess.Popen(["sleep", "60"])  # the other node's process
    announcers = [
        Announcer(DiscoverySettings(), properties(TAG)),
        Announcer(DiscoverySettings(), properties(TAG, other.pid)),
        Announcer(DiscoverySettings(), properties(TAG)),  # as in another container: same host, pid
    ]
    try:
        for announcer in announcers[:2]:
            announcer.start()
            assert not announcer.announced.is_set()  # off the way: it takes its time
        assert all(announcer.announced.wait(20) for announcer in announcers[:2])
        announcers[2].start()
        assert announcers[2].announced.wait(20)
        found = mine(discover(0.5))
        assert len({s.name for s in found}) == 3
        assert [s.properties["node"] for s in found] == [TAG] * 3
        assert [s.liveness for s in found] == ["answers"] * 3
    finally:
        other.kill()
        other.wait()
    assert sorted(s.liveness for s in mine(discover(0.5))) == ["answers", "answers", "no process"]
    for announcer in announcers:
        announcer.stop()
    assert mine(discover(0.5)) == []


_NODE = """
import sys
from hri_predict.cli.discover import discover as command
from hri_predict.protocol.discovery.announcer import Announcer
from hri_predict.protocol.discovery.services import DiscoverySettings
announcer = Announcer(DiscoverySettings(), {"node": sys.argv[1], "host": "elsewhere", "pid": "1"})
announcer.start()
print(announcer.announced.wait(20), flush=True)
sys.stdin.read()
"""


@pytest.mark.realtime
@pytest.mark.long
def test_a_node_that_dies_without_a_word_shows_as_vanished() -> None:
    node = subprocess.Popen(
        [sys.executable, "-c", _NODE, TAG], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert node.stdout is not None
    assert node.stdout.readline() == b"True\n"
    killer = threading.Timer(1.0, node.kill)
    killer.start()
    (service,) = mine(discover(2.0))
    node.wait()
    assert service.liveness == "vanished"
    assert service.properties["node"] == TAG  # what it had said


@pytest.mark.realtime
def test_a_running_node_announces_itself(tmp_path: Path) -> None:
    text = configuration.shipped("demo.yaml").read_text(encoding="utf-8")
    text = text.replace("name: average", "name: constant_velocity")
    file = tmp_path / "cell.yaml"
    file.write_text(f"{text}\ndiscovery: {{name: {TAG}}}\n", encoding="utf-8")
    config = configuration.load(file).without_links()
    stop = threading.Event()
    running = threading.Thread(target=session.run, args=(config, Options(), stop))
    running.start()
    try:
        found: list[Service] = []
        deadline = time.monotonic() + 60
        while not found:
            assert time.monotonic() < deadline
            found = mine(discover(0.5))
    finally:
        stop.set()
        running.join(30)
    said = found[0].properties
    assert (found[0].kind, found[0].type, found[0].port) == ("node", NODE, 0)
    assert (said["node"], said["predictor"], said["rate"]) == (TAG, "constant_velocity", "25")
    assert said["schema"].startswith("0x")
    assert mine(discover(0.3)) == []


def test_an_interface_that_is_not_there_is_retried_and_told() -> None:
    announcer = Announcer(DiscoverySettings(interfaces=["203.0.113.1"]), properties(TAG))
    announcer.start()
    deadline = time.monotonic() + 20
    while announcer.last_error is None:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    announcer.stop()
    assert not announcer.announced.is_set()
    with pytest.raises(DiscoveryError, match=r"203\.0\.113\.1: .*; name addresses"):
        discover(0.1, ["203.0.113.1"])


def test_without_the_key_nothing_is_announced() -> None:
    assert configuration.NodeSettings.model_fields["discovery"].get_default() is None


def test_wrong_settings_are_refused() -> None:
    wrong: list[dict[str, Any]] = [{"interfaces": ["eth0"]}, {"interfaces": []}]
    for data in (*wrong, {"name": "a\nb"}, {"nam": "x"}):
        with pytest.raises(ConfigError, match="discovery"):
            validated(DiscoverySettings, data, "discovery")
    assert ServiceSettings.model_validate("camera 1").name == "camera 1"


def test_names_and_texts_fit_their_records() -> None:
    name = instance("é" * 99, "h" * 99, 123456)
    assert len(name.encode()) <= MAX_LABEL
    assert name.endswith(" 123456")
    assert all(len(k) + 1 + len(v) <= 255 for k, v in txt({"links": "x" * 999}).items())
    assert printable(b"a\x00\xff\n") == "a?\ufffd?"
