"""A real scheduler and workers of Dask on loopback, for tests; each ends with its block."""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[4]
DASK = "from distributed.cli.dask_{0} import main; main()"
LOCAL = ("--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0")


@contextlib.contextmanager
def started(kind: str, *arguments: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A process of Dask, which ends with the block."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, "-c", DASK.format(kind), *arguments, *LOCAL],
        env=os.environ | {"PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    """Its address."""
    file = folder / "scheduler.json"
    with started("scheduler", "--port", "0", "--scheduler-file", str(file)):
        deadline = time.monotonic() + 60
        while not file.exists() or not file.read_text():
            assert time.monotonic() < deadline, "the scheduler did not start"
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"]


def worker(
    address: str, folder: Path
) -> "contextlib.AbstractContextManager[subprocess.Popen[bytes]]":
    """A worker without a nanny: killed, it stays away."""
    return started(
        "worker", address, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder)
    )
