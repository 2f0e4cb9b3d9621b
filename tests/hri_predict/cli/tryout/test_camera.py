"""The camera's process: when it is ready, why it ended, and that nothing of it stays."""

import os
import socket
import stat
import sys
import threading

import pytest

from hri_predict.base.errors import SourceError
from hri_predict.cli.tryout import command as cameras
from hri_predict.cli.tryout.command import Camera

SENDS = """
import socket, sys
print("camera: 640 x 480", file=sys.stderr, flush=True)
port = int(sys.argv[sys.argv.index("--port") + 1])
socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"scene", ("127.0.0.1", port))
"""
UNTIL_INPUT_ENDS = "\nsys.stdin.read()\n"
FAILS = (
    "import sys; print('looking'); print('error: camera 0: none found', file=sys.stderr); exit(2)"
)
KILLED = (
    "import os, sys; print('INFO: a start', file=sys.stderr, flush=True); os.kill(os.getpid(), 9)"
)
FAULTY = "raise ValueError('a fault of ours')"
HANGS = "\nimport time\nwhile True: time.sleep(60)\n"
AT_ONCE_S, PATIENT_S = 0.1, 60.0
"""A process that never ends by itself is not waited for; any other one has the time that a busy
machine needs."""


class Started(Camera):
    """A camera's process, with the event that it ended."""

    def __init__(self, ended: threading.Event) -> None:
        self.ended = ended
        super().__init__(["0"], ended.set)


@pytest.fixture
def process(monkeypatch, request):
    monkeypatch.setattr(cameras, "COMMAND", [sys.executable, "-c", request.param])
    monkeypatch.setattr(cameras, "END_S", AT_ONCE_S if HANGS in request.param else PATIENT_S)
    with Started(threading.Event()) as made:
        yield made


@pytest.mark.parametrize("process", [SENDS + UNTIL_INPUT_ENDS], indirect=True)
def test_after_the_first_scene_the_port_is_the_nodes(process, capfd):
    process.wait()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        node.bind(("127.0.0.1", process.port))
    assert process.process.poll() is None
    assert not process.ended.is_set()
    process.__exit__(None, None, None)
    assert process.process.returncode == 0
    assert not process.ended.is_set()  # it was asked to end
    assert not process.key_file.exists()
    assert "camera: 640 x 480" in capfd.readouterr().err


@pytest.mark.parametrize("process", [FAILS], indirect=True)
def test_a_camera_that_fails_says_why_in_one_line(process, capfd):
    with pytest.raises(SourceError, match=r"^camera 0: none found$"):
        process.wait()
    assert process.ended.wait(PATIENT_S)
    assert "none found" not in capfd.readouterr().err  # it is the caller's to say


@pytest.mark.parametrize(
    ("process", "said"),
    [
        (KILLED, r"^the camera's process ended \(status -9\) without a reason$"),
        (FAULTY, r"^the camera's process ended \(status 1\): ValueError: a fault of ours$"),
    ],
    indirect=["process"],
)
def test_a_process_that_names_no_error_is_one_line(process, said):
    with pytest.raises(SourceError, match=said):
        process.wait()


@pytest.mark.parametrize("process", [SENDS], indirect=True)
def test_a_camera_that_ends_later_ends_the_run(process):
    process.wait()
    assert process.ended.wait(PATIENT_S)


@pytest.mark.parametrize("process", [HANGS], indirect=True)
def test_a_camera_that_sends_nothing_is_not_waited_for_for_ever(process, monkeypatch):
    monkeypatch.setattr(cameras, "START_S", 0.0)
    with pytest.raises(SourceError, match="sent nothing in 0 s"):
        process.wait()


@pytest.mark.parametrize("process", [SENDS + HANGS], indirect=True)
def test_a_process_that_does_not_end_is_killed(process):
    process.wait()
    process.__exit__(None, None, None)
    assert process.process.returncode == -9


@pytest.mark.parametrize("process", [HANGS], indirect=True)
def test_only_the_user_can_read_the_key(process):
    mode = process.key_file.stat().st_mode
    assert stat.S_IMODE(mode) == 0o600
    assert len(process.key_file.read_bytes()) >= 32
    assert os.getpgid(process.process.pid) != os.getpgid(0)  # Ctrl-C is not for it
