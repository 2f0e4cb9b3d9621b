"""The far end of a serial line, as a separate process that reads bytes at the rate of the wire.

A pseudo-terminal accepts everything that fits immediately; a serial line takes one bit at a time.
``drain`` makes a pseudo-terminal behave like a serial line: a byte leaves the buffer when its last
bit would have left the sender. The USB side of a CAN adapter takes bytes immediately.
"""

import array
import fcntl
import os
import select
import termios
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

from hri_sim.wires.pty import open_pty
from hri_sim.wires.slcan_adapter import SlcanAdapter

STEP_S = 0.001  # time between two reads while the buffer holds bytes


@dataclass
class Drained:
    """The traffic on a paced wire.

    Attributes:
        received: number of bytes.
        busy_s: time from the arrival of the first byte to the departure of the last one.
        backlog_bytes: number of waiting bytes at each read, if not zero.
    """

    received: int = 0
    busy_s: float = 0.0
    backlog_bytes: list[int] = field(default_factory=list)


def drain(fd: int, bytes_per_s: float, until: Callable[[float | None], bool]) -> Drained:
    """Read the bytes that arrive at ``fd``, no faster than the wire would deliver them.

    ``until`` waits for the end or for bytes at ``fd``, at most for the given seconds (``None``:
    without limit); it returns whether the end was reached.
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


def serial_line(pipe: Connection, bytes_per_s: float) -> Drained:
    """Act as the far end of a serial line; for ``child``. First sends the path of its port."""
    master, path = open_pty()
    pipe.send(path)
    return drain(master, bytes_per_s, _until_end_or_bytes(master, pipe))


def can_adapter(pipe: Connection) -> int:
    """Act as an slcan adapter; for ``child``. Sends its port's path; reports the frame count."""
    master, path = open_pty()
    adapter, frames = SlcanAdapter(master), 0
    adapter.open()
    pipe.send(path)
    until = _until_end_or_bytes(master, pipe)
    while not until(None):
        frames += len(adapter.read(0.0))
    return frames


def _until_end_or_bytes(fd: int, pipe: Connection) -> Callable[[float | None], bool]:
    def until(timeout_s: float | None) -> bool:
        waited: list[int] = [fd, pipe.fileno()]
        return pipe.fileno() in select.select(waited, [], [], timeout_s)[0]

    return until
