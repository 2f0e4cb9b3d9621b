"""The far end of a wire, as a separate process: it takes bytes at the rate of the wire.

    python -m hri_sim.wires.far_end serial FD BYTES_PER_S
    python -m hri_sim.wires.far_end slcan FD

FD is the master side of a pseudo-terminal. A pseudo-terminal takes everything that fits at once; a
serial line takes one bit at a time. ``drain`` makes a pseudo-terminal behave like a serial line: a
byte leaves the buffer when its last bit would have left the sender. ``slcan`` answers like a CAN
adapter, whose USB side takes bytes at once. Both end when standard input ends, and print one JSON
line.
"""

import array
import contextlib
import fcntl
import json
import os
import select
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from hri_sim.wires.pty import open_pty

STEP_S = 0.001  # time between two reads while the buffer holds bytes


@dataclass
class Drained:
    """The traffic on a paced wire.

    Attributes:
        received: number of bytes.
        busy_s: time from the first byte's arrival until the last one had left.
        backlog_bytes: number of waiting bytes, at each read while there were any.
    """

    received: int = 0
    busy_s: float = 0.0
    backlog_bytes: list[int] = field(default_factory=list)


def drain(fd: int, bytes_per_s: float, until: Callable[[float | None], bool]) -> Drained:
    """Take the bytes that arrive at ``fd``, no faster than the wire would deliver them.

    ``until`` waits for the end or for bytes at ``fd``, at most for the given seconds (``None``:
    without limit); it returns whether the end has come.
    """
    drained, began = Drained(), time.monotonic()
    last, credit = began, 0.0  # bytes may be there before the first look
    ended = False
    while True:
        waiting = _waiting(fd)
        if not waiting:  # the line is idle: time that passes now carries no bytes
            if ended:
                return drained
            ended = until(None)
            last, credit = time.monotonic(), 0.0
            began = began if drained.received else last
            continue
        time.sleep(STEP_S)
        now = time.monotonic()
        credit, last = credit + (now - last) * bytes_per_s, now
        waiting = _waiting(fd)
        taken = len(os.read(fd, int(credit))) if credit >= 1 else 0
        credit -= taken
        drained.received += taken
        drained.busy_s = now - began
        drained.backlog_bytes.append(waiting - taken)


def _waiting(fd: int) -> int:
    """Return the number of bytes that can be read (a terminal reports 4095 at most)."""
    count = array.array("i", [0])
    try:
        fcntl.ioctl(fd, termios.FIONREAD, count)
    except OSError:  # the other side is closed, and all was read
        return 0
    return count[0]


@contextlib.contextmanager
def far_end(*arguments: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Start a far end; ``arguments`` are those of its command line, without FD.

    Yields the path of the serial port, and a list that receives the report at the end.
    """
    master, path = open_pty()
    kind, *more = arguments
    child = subprocess.Popen(
        [sys.executable, "-m", "hri_sim.wires.far_end", kind, str(master), *more],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=[master],
    )
    os.close(master)
    assert child.stdin is not None
    assert child.stdout is not None
    reports: list[dict[str, Any]] = []
    try:
        child.stdout.readline()  # it is ready
        yield path, reports
        child.stdin.close()
        reports.append(json.loads(child.stdout.readline()))
        child.wait(10.0)
    finally:
        child.kill()
        child.wait()
        child.stdout.close()


def _until_end_or_bytes(fd: int) -> Callable[[float | None], bool]:
    def until(timeout_s: float | None) -> bool:
        ready, _, _ = select.select([fd, sys.stdin], [], [], timeout_s)
        return sys.stdin in ready

    return until


def _answer(fd: int) -> int:
    """Act as an slcan adapter until standard input ends; return the number of frames."""
    from hri_sim.wires.slcan_adapter import SlcanAdapter

    adapter, frames = SlcanAdapter(fd), 0
    adapter.open()
    until = _until_end_or_bytes(fd)
    while not until(None):
        frames += len(adapter.read(0.0))
    return frames


def main(arguments: Sequence[str]) -> int:
    """Run one far end; return the exit status."""
    kind, fd = arguments[0], int(arguments[1])
    print(json.dumps({"ready": True}), flush=True)
    if kind == "slcan":
        print(json.dumps({"frames": _answer(fd)}), flush=True)
        return 0
    print(json.dumps(asdict(drain(fd, float(arguments[2]), _until_end_or_bytes(fd)))), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
