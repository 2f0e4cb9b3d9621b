import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from hri_predict.errors import ConfigError
from hri_predict.viewing import feed as feeds
from hri_predict.viewing.feed import Feed, Screen, ScreenSettings, check_port, check_viser
from hri_predict.viewing.picture import Picture, empty_shapes, pack
from tests.browser import wait_for
from tests.hri_predict.viewing.staged import cell

LARGE = pack(Picture({"text": 200_000 * "x"}, **empty_shapes()))  # a pipe takes 64 KiB


def settings(tmp_path, monkeypatch, code: str) -> ScreenSettings:
    (tmp_path / "own_screen.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return ScreenSettings("viewer", "own_screen", 0)


@pytest.fixture
def screen(tmp_path, monkeypatch, request):
    made = Screen(settings(tmp_path, monkeypatch, request.param))
    yield made
    made.process.kill()
    made.end()


READS_ALL = "import sys\nprint(len(sys.stdin.buffer.read()), flush=True)"
HANGS = "import time\ntime.sleep(60)"


@pytest.mark.parametrize("screen", [HANGS], indirect=True)
def test_a_screen_that_hangs_costs_pictures_and_no_time(screen):
    before_s = time.perf_counter()
    for _ in range(200):
        screen.show(LARGE)
    assert time.perf_counter() - before_s < 1.0  # 5 ms each, on a busy machine
    assert screen.dropped == 199
    assert screen.is_waiting


@pytest.mark.parametrize("screen", ["pass"], indirect=True)
def test_a_screen_that_died_costs_pictures_and_no_error(screen):
    screen.process.wait(20)
    screen.show(LARGE)
    screen.show(LARGE)
    assert screen.dropped >= 1
    assert not screen.is_waiting


@pytest.mark.parametrize("screen", [READS_ALL], indirect=True)
def test_a_picture_is_written_whole_as_the_screen_reads(screen, capfd):
    screen.show(LARGE)
    wait_for(lambda: (screen.go_on(), not screen.is_waiting)[1])
    screen.end()
    wait_for(lambda: f"viewer: {len(LARGE)}" in capfd.readouterr().err)


@pytest.mark.parametrize("screen", ["import sys\nfor line in sys.stdin: pass"], indirect=True)
def test_a_screen_ends_with_its_pipe(screen):
    screen.end()
    assert screen.process.returncode == 0


def test_a_screen_that_will_not_end_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(feeds, "END_S", 0.2)
    screen = Screen(settings(tmp_path, monkeypatch, HANGS))
    screen.end()
    assert screen.process.returncode == -signal.SIGKILL


def test_a_feed_shows_that_a_picture_could_not_be_made_and_goes_on(caplog):
    with Feed([]) as feed:
        feed._assembly = object()  # type: ignore[assignment]
        for _ in range(3):
            feed._newest = object()  # type: ignore[assignment]
            time.sleep(0.1)
    assert feed.dropped >= 2
    assert caplog.text.count("could not be made") == 1


def test_a_taken_port_is_one_line_with_the_remedy():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=rf"--viewer {port}: .*name another port"):
            check_port(ScreenSettings("viewer", feeds.VIEWER, port))


def test_an_absurd_port_is_one_line():
    with pytest.raises(ConfigError, match="from 0 to 65535"):
        check_port(ScreenSettings("operator", feeds.OPERATOR, 70000))


def test_without_viser_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(feeds.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'hri-predict\[viewer\]'"):
        check_viser()


def test_the_node_imports_no_viser():
    code = "import sys, hri_predict.cli.commands; print('viser' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"


@pytest.mark.realtime
def test_screens_end_with_a_node_that_is_killed(tmp_path):
    """kill -9 of the node: its operator page ends, too."""
    command = [sys.executable, "-m", "hri_predict", "demo", "--operator", "0", "--json"]
    node = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    assert node.stderr is not None
    try:
        line = next(line for line in node.stderr if line.startswith("operator: http"))
        port = int(line.rsplit(":", 1)[1])
        children = subprocess.run(
            ["ps", "--ppid", str(node.pid), "-o", "pid=,args="], capture_output=True, text=True
        ).stdout
        (page,) = [each for each in children.splitlines() if feeds.OPERATOR in each]
        pid = int(page.split()[0])
        os.kill(node.pid, signal.SIGKILL)
        wait_for(lambda: not os.path.exists(f"/proc/{pid}/exe") or _is_zombie(pid), 15)
        with pytest.raises(OSError):
            socket.create_connection(("127.0.0.1", port), 1.0)
    finally:
        node.kill()
        node.wait()
        node.stderr.close()


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
