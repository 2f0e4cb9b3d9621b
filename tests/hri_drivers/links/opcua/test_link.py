"""The server and a client in another process, by asyncua's client over TCP."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from hri_drivers.links.opcua.link import OpcUaLink, OpcUaLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import Acknowledge, Level, SetChoice
from tests.hri_drivers.links.plant.test_codec import STATUS
from tests.messages import make_advice
from tests.waiting import eventually

CLEAR = make_advice(Level.CLEAR, speed_limit_m_s=0.8, age_s=0.05, latch_id=77)
NAMES = ["Robots.0.LEVEL", "Robots.0.SPEED_LIMIT", "Robots.0.NEAREST", "Node.HEARTBEAT"]
WAIT_S = 60.0  # two processes start, on a machine that does other things
SILENCE_S = 0.06


class Plc:
    """``plc.py`` as a process."""

    def __init__(self, port: int, *secured: str) -> None:
        script = Path(__file__).with_name("plc.py")
        url = f"opc.tcp://127.0.0.1:{port}/"
        self.process = subprocess.Popen(
            [sys.executable, str(script), url, *secured],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.process.stdout is not None
        self.greeting = json.loads(self.process.stdout.readline())

    def ask(self, **asked: Any) -> Any:
        """Send one request."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(asked) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def kill(self) -> None:
        """End it."""
        self.process.kill()
        self.process.wait()


class Node:
    """A link, and a thread that posts as a node does."""

    def __init__(self, **changes: Any) -> None:
        data = {"name": "plant", "port": 0, "max_age_s": 0.4, "bases": [Pose()]} | changes
        self.link = OpcUaLink(OpcUaLinkSettings(**data), MonotonicClock())
        self.link.start()
        self.speaks, self.ends = threading.Event(), threading.Event()
        self.longest_s = 0.0
        self.speaks.set()
        self._thread = threading.Thread(target=self._post, daemon=True)
        self._thread.start()

    def _post(self) -> None:
        while not self.ends.wait(0.015):
            if self.speaks.is_set():
                before_s = time.monotonic()
                self.link.post(STATUS)
                self.link.post(CLEAR)
                self.longest_s = max(self.longest_s, time.monotonic() - before_s)

    @property
    def transport(self) -> Any:
        """The server's near end."""
        return self.link._transport

    def stop(self) -> None:
        """End both."""
        self.ends.set()
        self._thread.join(5.0)
        self.link.stop()


@pytest.fixture(scope="module")
def node() -> Iterator[Node]:
    pytest.importorskip("asyncua", reason="asyncua is not installed: the link cannot be used")
    made = Node()
    yield made
    made.stop()


@pytest.fixture(scope="module")
def plc(node) -> Iterator[Plc]:
    made = Plc(node.transport.port)
    assert made.greeting == "ready"
    yield made
    made.kill()


@pytest.fixture
def far(node, plc) -> Plc:
    """The client, after the node speaks and the first values are there."""
    node.speaks.set()
    eventually(lambda: plc.ask(read=NAMES)[0][0] == "Good", WAIT_S)
    return plc


slowly = [pytest.mark.realtime, pytest.mark.long, pytest.mark.timeout(300)]


def marked(test: Any) -> Any:
    for mark in slowly:
        test = mark(test)
    return test


@marked
def test_a_client_reads_the_advice(far):
    level, limit, nearest, heartbeat = far.ask(read=NAMES)
    assert (level[:2], limit[:2], nearest[:2]) == (["Good", 1], ["Good", 800], ["Good", 65534])
    assert heartbeat[0] == "Good"
    assert 0.05 <= time.time() - level[2] < 2.0  # dated by the capture
    later = far.ask(read=NAMES)
    assert later[0][2] > level[2] or later[3][1] >= heartbeat[1]
    (described,) = far.ask(read=["Robots.3.LEVEL"])  # of a robot that there is not
    assert described[0] == "BadNodeIdUnknown"


@marked
def test_silence_is_bad_and_the_heartbeat_stands_still(node, far):
    assert far.ask(subscribe=NAMES, ms=20) == "Good"
    assert [each for each in far.ask(changes=0.5) if each[:3] == ["Robots.0.LEVEL", "Good", 1]]
    node.speaks.clear()
    came = far.ask(changes=1.0)
    last = {name: (status, value) for name, status, value, _ in came}
    assert last["Robots.0.LEVEL"] == ("BadNoCommunication", None)
    assert last["Robots.0.SPEED_LIMIT"] == ("BadNoCommunication", None)
    assert last["Node.HEARTBEAT"][0] == "UncertainLastUsableValue"
    before = far.ask(read=NAMES)
    assert [each[0] for each in before[:3]] == ["BadNoCommunication"] * 3
    assert far.ask(read=NAMES)[3][1] == before[3][1]
    node.speaks.set()
    eventually(lambda: far.ask(read=NAMES)[0][:2] == ["Good", 1], 10.0)
    eventually(lambda: node.link.counters.advice_timeouts >= 1, 10.0)


@marked
def test_a_press_reaches_the_node_once_and_nothing_else_is_written(node, far):
    node.link.take()
    for _ in range(3):
        assert far.ask(call=[77, 9]) == "Good"
    eventually(lambda: far.ask(read=["Node.ACK_TAKEN"])[0][1] == 9, 10.0)
    assert [each.message for each in node.link.take()] == [Acknowledge(77, 9)]
    before = far.ask(read=["Node.WRITES_REFUSED"])[0][1]
    assert far.ask(call=[0, 9]) == "Good"  # the button is released
    assert far.ask(call=[0, 10]) == "BadInvalidArgument"  # of no press
    assert far.ask(call=[77, 0]) == "BadInvalidArgument"
    assert far.ask(write=["Robots.0.LEVEL", 1]) == "BadUserAccessDenied"
    assert far.ask(add=1) == "BadUserAccessDenied"
    eventually(lambda: far.ask(read=["Node.WRITES_REFUSED"])[0][1] == before + 4, 10.0)
    assert node.link.counters.malformed >= 4
    heard: list[Any] = []

    def released() -> bool:
        heard.extend(each.message for each in node.link.take())
        return bool(heard)

    eventually(released, 10.0)
    assert heard == [Acknowledge(0, 9)]


@marked
def test_a_client_chooses_a_set(node, far):
    node.link.take()
    for counter in (1, 1, 2, 3):  # the first says only where the counter stands
        assert far.ask(choose=[3, counter]) == "Good"
    heard: list[Any] = []

    def twice() -> bool:
        heard.extend(each.message for each in node.link.take())
        return len(heard) >= 2

    eventually(twice, 10.0)
    assert heard == [SetChoice(3), SetChoice(3)]
    shown = replace(STATUS, set_number=3, set_hash=77)

    def read() -> Any:
        node.link.post(shown)
        return far.ask(read=["Node.SET_IN_FORCE", "Node.SET_HASH"])

    eventually(lambda: [each[1] for each in read()] == [3, 77], 10.0)


@marked
def test_many_presses_are_refused_not_queued(node, far):
    node.link.take()
    answers = [far.ask(call=[77, 100 + k]) for k in range(60)]
    taken = [each for each in answers if each == "Good"]
    assert set(answers) <= {"Good", "BadTooManyOperations"}
    eventually(lambda: far.ask(read=["Node.ACK_TAKEN"])[0][1] >= 100, 10.0)
    assert len(node.link.take()) <= len(taken)


@marked
def test_a_flood_ends_and_the_node_does_not_wait_for_it(node, far):
    """Connections that say nothing, noise, and a client that asks and does not read."""
    node.longest_s = 0.0
    address = ("127.0.0.1", node.transport.port)
    opened = []
    try:
        for k in range(60):
            with_noise = socket.create_connection(address, 10.0)
            opened.append(with_noise)
            if k % 3 == 0:
                with_noise.sendall(b"\xff" * 4000)
            if k % 3 == 1:
                with_noise.sendall(b"MSGF" + (2**31).to_bytes(4, "little") + b"\0" * 8)
        eventually(lambda: far.ask(read=NAMES)[0][:2] == ["Good", 1], WAIT_S)
        eventually(lambda: "connections ended" in (node.link.last_error or ""), WAIT_S)
    finally:
        for each in opened:
            each.close()
    assert node.longest_s < 0.5  # of ``post``: no wait for the server; the machine may be busy
    assert node.link.connected


@marked
def test_a_server_that_ends_is_started_again(node, far):
    process = node.transport._process
    os.kill(process.pid, signal.SIGKILL)
    before = node.link.counters.reconnects
    eventually(lambda: node.link.counters.reconnects > before, WAIT_S)
    fresh = Plc(node.transport.port)
    try:
        eventually(lambda: fresh.ask(read=NAMES)[0][:2] == ["Good", 1], WAIT_S)
    finally:
        fresh.kill()
    node.stop()
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", node.transport.port), 1.0)


def made_certificate(folder: Path, name: str) -> tuple[str, str]:
    """A self-signed certificate and its key, as files."""
    from datetime import UTC, datetime, timedelta

    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import rsa

    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(
            x509.SubjectAlternativeName([x509.UniformResourceIdentifier("urn:example:plc")]), False
        )
        .sign(key, hashes.SHA256())
    )
    paths = folder / f"{name}.der", folder / f"{name}.pem"
    paths[0].write_bytes(made.public_bytes(serialization.Encoding.DER))
    paths[1].write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    return str(paths[0]), str(paths[1])


@marked
def test_with_certificates_only_known_clients_are_served(tmp_path):
    pytest.importorskip("asyncua", reason="asyncua is not installed: the link cannot be used")
    server, known, other = (made_certificate(tmp_path, n) for n in ("server", "known", "other"))
    made = Node(certificate=server[0], private_key=server[1], trusted=[known[0]])
    clients = []
    try:
        clients = [Plc(made.transport.port, *each) for each in ((), other, known)]
        assert "refused" in clients[0].greeting  # without security
        assert "refused" in clients[1].greeting
        assert clients[2].greeting == "ready"
        eventually(lambda: clients[2].ask(read=NAMES)[0][:2] == ["Good", 1], WAIT_S)
    finally:
        for each in clients:
            each.kill()
        made.stop()


# -- what needs no server --------------------------------------------------------------------------


def test_a_port_that_is_taken_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        made = OpcUaLink(
            OpcUaLinkSettings(name="plant", port=port, max_age_s=0.4), MonotonicClock()
        )
        said = rf"link 'plant': OPC UA server at 127.0.0.1:{port}: in use by another program"
        with pytest.raises(LinkError, match=said):
            made.start()


def test_an_address_of_another_machine_is_one_line():
    settings = OpcUaLinkSettings(
        name="plant", host="192.0.2.1", max_age_s=0.4, allow_unauthenticated=True
    )
    said = "OPC UA server at 192.0.2.1:4840: not an address of this machine; correct 'host'"
    with pytest.raises(LinkError, match=said):
        OpcUaLink(settings, MonotonicClock()).start()


def test_a_missing_package_is_one_line(monkeypatch):
    monkeypatch.setattr("hri_drivers.links.opcua.link.find_spec", lambda name: None)
    with pytest.raises(
        LinkError, match=r"asyncua; install it with: pip install 'hri-predict\[opcua\]'"
    ):
        OpcUaLink(OpcUaLinkSettings(name="plant"), MonotonicClock())


def test_the_node_imports_nothing_of_it():
    code = "import sys, hri_drivers.links.opcua.link as link; print('asyncua' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout == "False\n"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"host": "0.0.0.0"}, "OPC UA without certificates cannot identify senders"),
        ({"host": "plc.example"}, "must be an IP address of this machine"),
        ({"simulate": {}}, "no simulated controller"),
        ({"certificate": "a.der"}, "certificate, private_key and trusted go together"),
        ({"robot_state_rate_hz": 50}, "less than or equal to 0"),
    ],
)
def test_settings_that_cannot_be(wrong, said):
    with pytest.raises(ValidationError, match=said):
        OpcUaLinkSettings(name="plant", **wrong)


def test_certificates_open_the_network_and_are_found_beside_the_configuration(tmp_path):
    settings = OpcUaLinkSettings(
        name="plant", host="0.0.0.0", certificate="s.der", private_key="s.pem", trusted=["plc.der"]
    )
    found = settings.resolved(tmp_path)
    assert (found.certificate, found.trusted) == (tmp_path / "s.der", [tmp_path / "plc.der"])
