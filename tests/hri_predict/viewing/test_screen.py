import errno
import signal
import socket
import subprocess
import time

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.viewing import screen as screens
from hri_predict.viewing.feed import OPERATOR, VIEWER, Feed
from hri_predict.viewing.picture import Picture, empty_shapes, pack
from hri_predict.viewing.screen import Screen, ScreenSettings, check_port
from tests.browser import wait_for

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
    taken = [screen.show(LARGE) for _ in range(200)]
    assert taken == [True] + 199 * [False]
    assert time.perf_counter() - before_s < 30.0  # the first that waited would take 60 s
    assert screen.dropped == 199
    assert screen.is_waiting


@pytest.mark.parametrize("screen", ["pass"], indirect=True)
def test_a_screen_that_died_costs_pictures_and_no_error(screen):
    screen.process.wait(20)
    screen.show(LARGE)
    screen.show(LARGE)
    assert screen.dropped >= 1
    assert not screen.is_waiting


SAYS_PORT = """
import sys
print("http://127.0.0.1:" + (sys.argv[4] if sys.argv[4] != "0" else "4711"), flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("screen", [SAYS_PORT], indirect=True)
def test_a_screen_that_died_starts_again_at_the_same_address(screen, monkeypatch, capfd, caplog):
    monkeypatch.setattr(screens, "PAUSE_S", 0.01)
    said = ""

    def says_its_address() -> bool:
        nonlocal said
        said += capfd.readouterr().err
        return said.count("viewer: http://127.0.0.1:4711\n") == screen.starts

    wait_for(says_its_address)
    screen.process.kill()
    screen.process.wait()
    screen.show(LARGE)  # finds out
    assert "the viewer exited; it restarts in 0.02 s" in caplog.text
    wait_for(lambda: (screen.keep_alive(), screen.starts == 2)[1])
    wait_for(says_its_address)
    assert screen.show(LARGE)


@pytest.mark.parametrize("screen", ["pass"], indirect=True)
def test_a_screen_that_ends_again_and_again_is_given_up(screen, monkeypatch, caplog):
    monkeypatch.setattr(screens, "PAUSE_S", 0.0)
    monkeypatch.setattr(screens, "MOST_STARTS", 3)

    def given_up() -> bool:
        screen.process.wait(20)
        screen.keep_alive()
        screen.show(LARGE)
        return "given up" in caplog.text

    wait_for(given_up)
    assert screen.starts == 3
    screen.keep_alive()
    assert screen.starts == 3


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
    monkeypatch.setattr(screens, "END_S", 0.2)
    screen = Screen(settings(tmp_path, monkeypatch, HANGS))
    screen.end()
    assert screen.process.returncode == -signal.SIGKILL


def test_a_taken_port_is_one_line_with_the_remedy():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=rf"--viewer {port}: .*name another port"):
            check_port(ScreenSettings("viewer", VIEWER, port))


def test_an_absurd_port_is_one_line():
    with pytest.raises(ConfigError, match="from 0 to 65535"):
        check_port(ScreenSettings("operator", OPERATOR, 70000))


@pytest.mark.parametrize("host", ["", " "])
def test_an_empty_host_is_not_every_address(host):
    """``--viewer-host "$HOST"`` without HOST would open the page to the whole network."""
    with pytest.raises(ConfigError, match="--viewer-host: empty; give an address"):
        check_port(ScreenSettings("operator", OPERATOR, 0, host))


@pytest.mark.parametrize(
    "host", ["192.0.2.1", "256.1.1.1", "2001:db8::1", "a..b", "a\0", "a\udcff"]
)
def test_a_host_that_is_not_of_this_machine_is_one_line(host):
    """No other port would help. The last two are not names at all."""
    with pytest.raises(ConfigError, match=r"--viewer-host '.*': .*give an address of this machine"):
        check_port(ScreenSettings("operator", OPERATOR, 0, host))


def test_two_screens_on_one_port_are_refused():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    both = [ScreenSettings("viewer", VIEWER, port), ScreenSettings("operator", OPERATOR, port)]
    with pytest.raises(ConfigError, match=f"{port}: give each its own port"), Feed(both):
        pass


def test_without_room_for_a_process_there_is_one_line(monkeypatch):
    def full(*_args, **_options):
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(subprocess, "Popen", full)
    with pytest.raises(ConfigError, match="--operator: its process cannot be started: Resource"):
        Screen(ScreenSettings("operator", OPERATOR, 0))
