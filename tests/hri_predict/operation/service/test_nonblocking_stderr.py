"""Standard error whose reader stops, or whose disk is full."""

import io
import logging
import os
import subprocess
import sys
import threading
import time
from contextlib import nullcontext

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli import run
from hri_predict.operation.service import logs
from hri_predict.operation.service.logs import MOST_BYTES, Unhurried
from hri_predict.run import config as configuration
from hri_predict.run.session import Options


@pytest.fixture
def pipe():
    """The reading end, and a text stream at the writing one."""
    reads, writes = os.pipe()
    stream = os.fdopen(writes, "w", encoding="utf-8")
    yield reads, stream
    os.close(reads)
    os.set_blocking(writes, False)
    stream.close()


def fill(descriptor):
    os.set_blocking(descriptor, False)
    try:
        while True:
            os.write(descriptor, b"x" * 4096)
    except BlockingIOError:
        os.set_blocking(descriptor, True)


def quickly(call):
    """Run ``call`` in a thread; it must not wait for a reader."""
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(5.0)
    return not thread.is_alive()


def test_lines_come_out_in_their_order(pipe):
    reads, stream = pipe
    out = Unhurried(stream)
    for i in range(100):
        print("line", i, file=out)
    assert out.end()
    assert os.read(reads, 65536).decode() == "".join(f"line {i}\n" for i in range(100))
    assert out.lost == 0


def test_nobody_waits_for_a_reader_that_stopped_and_what_does_not_fit_is_counted(pipe):
    reads, stream = pipe
    fill(stream.fileno())
    out = Unhurried(stream)
    line, lines = "y" * 999 + "\n", MOST_BYTES // 1000 + 500
    assert quickly(lambda: [out.write(line) for _ in range(lines)])
    assert not out.end(0.05)
    assert lines - MOST_BYTES // 1000 <= out.lost <= lines
    while b"lines were lost" not in (data := os.read(reads, 1 << 20)):
        assert data  # who reads again is told


def test_a_full_disk_costs_lines_and_they_are_counted():
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full")
    with open("/dev/full", "w", encoding="utf-8") as full:
        out = Unhurried(full)
        out.write("one\ntwo\n")
        assert out.end()
    assert out.lost == 2


@pytest.fixture
def no_log(monkeypatch):
    monkeypatch.setattr(logs, "_current", [])
    monkeypatch.setattr(logs, "_waiting_for_nobody", [])


def test_log_and_standard_error_go_there_and_come_back(pipe, monkeypatch, no_log):
    reads, stream = pipe
    monkeypatch.setattr(sys, "stderr", stream)
    log = logs.Log(stream)
    logs._current.append(log)
    logger = logging.Logger("hri_predict.test")
    logger.addHandler(log)
    with logs.unhurried():
        fill(stream.fileno())
        assert quickly(lambda: logger.warning("stands"))
        assert quickly(lambda: print("printed", file=sys.stderr))
        while not os.read(reads, 1 << 20).endswith(b"printed\n"):
            time.sleep(0.01)
    assert sys.stderr is stream
    assert log.stream is stream


def test_a_reader_that_never_comes_back_does_not_hold_up_the_end(pipe, monkeypatch, no_log):
    _, stream = pipe
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("hri_predict.operation.service.logs.FAREWELL_S", 0.05)
    fill(stream.fileno())

    def run():
        with logs.unhurried():
            print("lost", file=sys.stderr)
        print("this, too", file=sys.stderr)

    assert quickly(run)


def test_a_stream_without_a_file_stays_as_it_is(monkeypatch, no_log):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with logs.unhurried():
        assert sys.stderr is stream


@pytest.mark.parametrize(("factor", "waits"), [(1.0, False), (None, True)])
def test_a_run_in_real_time_waits_for_no_reader(pipe, monkeypatch, no_log, factor, waits):
    """At ``--speed max`` nothing is late, and every line counts."""
    _, stream = pipe
    monkeypatch.setattr(sys, "stderr", stream)
    seen = []

    def session(*_):
        seen.append(sys.stderr is stream)
        raise ConfigError("enough")

    monkeypatch.setattr(run, "run_session", session)
    config = configuration.load(configuration.shipped("demo.yaml"))
    with pytest.raises(ConfigError):
        run.go(config, Options(factor=factor), True, nullcontext())
    assert seen == [waits]


def test_a_program_with_closed_standard_files_opens_nothing_in_their_place(tmp_path):
    """Or a library's words would go to whatever is opened next: a robot's serial port, say."""
    code = (
        "import os, sys; from hri_predict import cli;"
        "cli._run = lambda: print('to nobody', file=sys.stderr) or os.open(sys.argv[1], os.O_RDWR |"
        "os.O_CREAT) + 10; cli.main()"
    )
    closed = 'exec 0<&- 1>&- 2>&-; exec "$@"'
    run = [sys.executable, "-c", code, str(tmp_path / "port")]
    status = subprocess.run(["/bin/sh", "-c", closed, "sh", *run], check=False).returncode
    assert status >= 13  # its number is not 0, 1 or 2
    assert (tmp_path / "port").read_bytes() == b""
