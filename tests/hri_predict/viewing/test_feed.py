import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from typing import Any
from unittest.mock import Mock

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.messages import Level
from hri_predict.viewing import feed as feeds
from hri_predict.viewing.feed import Feed, check_viser
from tests.browser import wait_for
from tests.hri_predict.viewing.staged import cell
from tests.silent_server import cell_with


def test_a_feed_shows_that_a_picture_could_not_be_made_and_goes_on(caplog):
    with Feed([]) as feed:
        feed._assembly = object()  # type: ignore[assignment]
        for _ in range(3):
            feed._newest = object()  # type: ignore[assignment]
            time.sleep(0.1)
    assert feed.dropped >= 2
    assert caplog.text.count("could not be created") == 1


def test_a_picture_that_two_screens_miss_is_dropped_once(monkeypatch):
    shown = [Mock(side_effect=[False, True, False]), Mock(side_effect=[False, True, True])]
    screens: list[Any] = [Mock(is_waiting=False, show=show) for show in shown]
    monkeypatch.setattr(Feed, "_pack", lambda *_: b"")
    with Feed([]) as feed:
        feed._assembly = object()  # type: ignore[assignment]
        feed.screens = screens
        for number, dropped in enumerate([1, 1, 2], 1):
            feed._newest = object()  # type: ignore[assignment]
            wait_for(lambda number=number: shown[1].call_count == number)
            wait_for(lambda dropped=dropped: feed.dropped == dropped)


def test_a_level_that_stays_is_no_change(monkeypatch):
    monkeypatch.setattr(feeds, "said_of", lambda advice, _: {"level": advice.level})
    feed = Feed([])
    for level in (Level.CLEAR, Level.CLEAR, Level.STOP, Level.STOP, Level.CLEAR):
        feed.on_tick(Mock(advices=[Mock(robot=0, level=level)]))
    assert [change["level"] for change in feed._changes] == [Level.CLEAR, Level.STOP, Level.CLEAR]


def test_without_viser_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(feeds.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'hri-predict\[viewer\]'"):
        check_viser()


def test_the_node_imports_no_viser():
    code = "import sys, hri_predict.cli.commands; print('viser' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"


@pytest.fixture
def node_with_page(tmp_path):
    """A running node, the address's port and the process id of its operator's page."""
    words = ["run", str(cell_with(tmp_path)), "--operator", "0", "--json"]
    command = [sys.executable, "-m", "hri_predict", *words]
    node = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    assert node.stderr is not None
    try:
        line = next(line for line in node.stderr if line.startswith("operator: http"))
        port = int(line.rsplit(":", 1)[1])
        (pid,) = _pages_of(node)
        yield node, port, pid
    finally:
        node.kill()
        node.wait()
        node.stderr.close()


def _pages_of(node) -> list[int]:
    children = subprocess.run(
        ["ps", "-ww", "--ppid", str(node.pid), "-o", "pid=,args="], capture_output=True, text=True
    ).stdout
    return [int(each.split()[0]) for each in children.splitlines() if feeds.OPERATOR in each]


@pytest.mark.realtime
def test_screens_end_with_a_node_that_is_killed(node_with_page):
    """kill -9 of the node: its operator page ends, too."""
    node, port, pid = node_with_page
    os.kill(node.pid, signal.SIGKILL)
    wait_for(lambda: not os.path.exists(f"/proc/{pid}/exe") or _is_zombie(pid), 15)
    # again: a connection to a free port may, by chance, leave from that very port
    wait_for(lambda: _refuses(port), 5)


@pytest.mark.realtime
def test_a_page_that_is_killed_comes_back_at_its_address(node_with_page):
    """kill -9 of the operator's page: its node starts another, and browsers find it."""
    node, port, pid = node_with_page
    os.kill(pid, signal.SIGKILL)
    wait_for(lambda: pid not in _pages_of(node) and _answers(port), 20)


def _answers(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=1.0) as page:
            return page.status == 200
    except (OSError, http.client.HTTPException):
        return False


def _refuses(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 1.0).close()
    except OSError:
        return True
    return False


def _is_zombie(pid: int) -> bool:
    with open(f"/proc/{pid}/stat") as stat:
        return stat.read().rsplit(")", 1)[1].split()[0] == "Z"


@pytest.mark.realtime
def test_a_run_with_a_page_says_how_many_pictures_were_dropped(tmp_path):
    config = str(cell(tmp_path).path)
    command = [sys.executable, "-m", "hri_predict", "run", config, "--duration", "1", "--json"]
    said = subprocess.run([*command, "--operator", "0"], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert "pictures_dropped" in json.dumps(json.loads(said.stdout))
    assert "operator: http://127.0.0.1:" in said.stderr
