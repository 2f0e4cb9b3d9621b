"""Whatever the node connects to may accept and then say nothing; real processes, real time.

It neither holds up the node nor keeps a signal from it, and one line names it.
"""

import contextlib
import os
import pty
import select
import signal
import time
import tty

import pytest
import yaml

from tests.silent_server import SilentServer, cell_with, started
from tests.waiting import eventually

pytestmark = pytest.mark.realtime

START_S = 90.0
"""A start on a busy machine that compiles."""
END_S = 10.0
"""A command may take 6 s at the end; the rest is a busy machine."""
LIVE = {
    "room_from_source": {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]},
    "rate_hz": 30,
}


@pytest.fixture
def server():
    server = SilentServer()
    yield server
    server.close()


@pytest.fixture
def deaf_line():
    """A serial line whose other end never reads; it holds a few kilobytes, then blocks."""
    other_end, line = pty.openpty()
    tty.setraw(line)
    yield os.ttyname(line)
    os.close(other_end)
    os.close(line)


def sources(port):
    return {
        "websocket": {"kind": "websocket", "url": f"ws://127.0.0.1:{port}/scenes"},
        "wss": {"kind": "websocket", "url": f"wss://127.0.0.1:{port}/scenes"},
        "rfc2217": {"kind": "serial_skeleton", "port": f"rfc2217://127.0.0.1:{port}"},
        "zenoh": {"kind": "zenoh", "cell": "a", "connect": [f"tcp/127.0.0.1:{port}"]},
    }


def hooks(port):
    mail = {"kind": "email", "host": "127.0.0.1", "sender": "a@b.example",
            "recipients": ["c@b.example"], "port": port, "timeout_s": 2}  # fmt: skip
    return [
        {"name": "collector", "kind": "syslog", "protocol": "tcp", "host": "127.0.0.1",
         "port": port},
        {"name": "collector by TLS", "kind": "syslog", "protocol": "tls", "host": "127.0.0.1",
         "port": port, "timeout_s": 2},
        mail | {"name": "mail", "security": "none"},
        mail | {"name": "mail by TLS", "security": "tls"},
        {"name": "hook", "kind": "webhook", "url": f"http://127.0.0.1:{port}/", "timeout_s": 2},
        {"name": "program", "kind": "command", "command": ["sleep", "600"], "timeout_s": 600},
    ]  # fmt: skip


@contextlib.contextmanager
def running(*arguments):
    process = started(*arguments)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def error_lines(said):
    return [line for line in said.splitlines() if line.startswith("error: ")]


KINDS = ("websocket", "wss", "rfc2217", "zenoh")


@pytest.fixture(scope="module")
def starts(tmp_path_factory):
    """Nodes whose sources are silent, all started at once: kind -> (server, node)."""
    with contextlib.ExitStack() as stack:
        found = {}
        for kind in KINDS:
            server = SilentServer()
            stack.callback(server.close)
            source = LIVE | sources(server.port)[kind]
            cell = cell_with(tmp_path_factory.mktemp(kind), source=source)
            found[kind] = server, stack.enter_context(running("run", str(cell)))
        yield found


@pytest.mark.parametrize("kind", KINDS)
def test_a_silent_source_ends_the_start_with_one_line(starts, kind):
    server, process = starts[kind]
    _, said = process.communicate(timeout=START_S)
    assert process.returncode == 2, said
    assert len(error_lines(said)) == 1
    assert f"127.0.0.1:{server.port}" in error_lines(said)[0]
    assert "answer" in error_lines(said)[0]
    assert "Traceback" not in said


def test_a_silent_source_that_is_waited_for_holds_up_no_link(tmp_path, server):
    source = LIVE | sources(server.port)["websocket"] | {"wait_for_device": True}
    with running("run", str(cell_with(tmp_path, source=source))) as process:
        eventually(lambda: len(server.accepted) >= 2, START_S)  # it is tried again
        ends_soon(process)


def test_a_line_that_nobody_reads_holds_up_no_other(tmp_path, deaf_line):
    monitor = {"name": "monitor", "kind": "serial", "port": deaf_line, "baudrate": 921600}
    drive = yaml.safe_load(cell_with(tmp_path).read_text())["links"][0]
    cell = cell_with(tmp_path, links=[drive, monitor])
    with running("run", str(cell), "--duration", "6") as process:
        _, said = process.communicate(timeout=START_S)
    assert process.returncode == 0, said
    told = [
        line for line in said.splitlines() if f"link 'monitor': serial port {deaf_line}" in line
    ]
    assert told
    assert "check that the other end reads" in told[0]
    assert len(told) < 4  # not one a write


def test_silent_receivers_of_alerts_are_named_and_end_with_the_node(tmp_path, server):
    cell = cell_with(tmp_path, alerts={"to": hooks(server.port)})
    with running("run", str(cell)) as process:
        eventually(lambda: len(server.accepted) >= 5, START_S)
        names = ("collector by TLS", "mail", "mail by TLS", "hook")
        hear(process, [f"alert hook {name}: no answer in time" for name in names])
        ends_soon(process)


def test_silent_receivers_are_named_by_a_trial(tmp_path, server):
    *network, program = hooks(server.port)
    cell = cell_with(tmp_path, alerts={"to": [*network, program | {"timeout_s": 2}]})
    with running("alerts", str(cell), "--test") as process:
        out, _ = process.communicate(timeout=START_S)
    assert process.returncode == 1
    lines = out.splitlines()
    assert len(lines) == 6
    assert lines[0] == "collector: ok: sent; syslog does not acknowledge messages"
    for line in lines[1:5]:
        assert ": FAILED: no answer in time" in line, out
    assert "took longer than 2 s and was killed" in lines[5]


def hear(process, texts):
    """Read what a process says, until it has said each of the texts."""
    said = ""
    while not all(text in said for text in texts):
        ready, _, _ = select.select([process.stderr], [], [], START_S)
        more = os.read(process.stderr.fileno(), 65536) if ready else b""
        assert more, said
        said += more.decode()


def ends_soon(process):
    """SIGTERM ends it with status 0 and no traceback; what it said."""
    began = time.monotonic()
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=END_S)
    assert time.monotonic() - began < END_S
    assert process.returncode == 0, said
    assert "Traceback" not in said
    return said
