"""Waiting for what other threads and processes do, and a port for them."""

import socket
import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 60.0  # a machine that is busy with other things


def eventually(condition: Callable[[], Any], seconds: float = PATIENCE_S) -> Any:
    """What ``condition`` gives once it is true; the limit only ends a test that fails."""
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, "did not happen"
        time.sleep(0.005)
    return found


def free_port() -> int:
    """A TCP port of 127.0.0.1 that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
