"""The 3D view's port under garbage, odd values and browsers that never read."""

import base64
import random
import resource
import socket
import subprocess
import time
from typing import Any

import pytest

from hri_predict.viewing.feed import VIEWER
from hri_predict.viewing.scene3d import live
from tests.hri_predict.viewing.scene3d.test_kept import told
from tests.hri_predict.viewing.shown import Shown
from tests.hri_predict.viewing.staged import pictures

viser = pytest.importorskip("viser", reason="the extra viewer is not installed")

PROTOCOL: Any = f"viser-v{viser.__version__}"


def upgraded(port: int) -> socket.socket:
    """A browser's connection, as far as the server can tell."""
    key = base64.b64encode(bytes(range(16))).decode()
    lines = ["GET / HTTP/1.1", "Host: x", "Upgrade: websocket", "Connection: Upgrade"]
    lines += [f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
    lines += [f"Sec-WebSocket-Protocol: {PROTOCOL}", "", ""]
    made = socket.create_connection(("127.0.0.1", port), 5.0)
    made.sendall("\r\n".join(lines).encode())
    return made


def memory_mb(process: subprocess.Popen[bytes]) -> float:
    with open(f"/proc/{process.pid}/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6


@pytest.mark.long
@pytest.mark.realtime
def test_garbage_and_fifty_browsers_that_never_read_cost_neither_memory_nor_the_view(capfd):
    from websockets.sync.client import connect

    one, other = pictures([5.2, 6.5])
    drawn = random.Random(1)
    with Shown(VIEWER) as view:
        port = int(view.url.rsplit(":", 1)[1])
        view.show(one)
        for k in range(60):
            with socket.create_connection(("127.0.0.1", port), 5.0) as made:
                made.sendall(drawn.randbytes(drawn.randrange(1, 3000)))
            if k % 2:
                with connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], proxy=None) as web:
                    web.send(drawn.randbytes(drawn.randrange(1, 300)))
        time.sleep(2.0)
        before_mb = memory_mb(view.process)
        deaf = [upgraded(port) for _ in range(50)]
        for k in range(20):
            view.show(one if k % 2 else other)
            time.sleep(0.5)
        # each connection has buffers of some 100 kB; a queue for each would take 0.3 MB a second
        # and connection: 150 MB
        assert memory_mb(view.process) - before_mb < 60
        with connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], proxy=None) as web:
            assert len(web.recv(timeout=5.0)) > 1000
        for made in deaf:
            made.close()
        assert view.process.poll() is None
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.long
@pytest.mark.realtime
def test_more_connections_than_files_fill_no_log(capfd):
    """asyncio has a traceback for each try; the node's log, or its journal, gets all of them."""
    with Shown(VIEWER) as view:
        port = int(view.url.rsplit(":", 1)[1])
        resource.prlimit(view.process.pid, resource.RLIMIT_NOFILE, (40, 40))
        made = [socket.create_connection(("127.0.0.1", port), 5.0) for _ in range(60)]
        time.sleep(2.0)
        for each in made:
            each.close()
        time.sleep(1.5)  # it accepts again after a second
        with upgraded(port) as browser:
            browser.settimeout(5.0)
            assert browser.recv(100).startswith(b"HTTP/1.1 101")
        assert view.process.poll() is None
    said = capfd.readouterr().err
    assert "Too many open files" not in said
    assert len(said) < 1000


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), 1e300])
def test_any_value_of_a_slider_is_a_picture(value):
    kept = live.Kept()
    kept.add(told("STOP"), 100.0)
    view = live.LiveView("127.0.0.1", 0, kept)
    try:
        view._back._impl.value = view._ahead._impl.value = value  # as a browser may set it
        view.draw(100.0)
        assert "because of STOP" in view._head.content
    finally:
        view.server.stop()
