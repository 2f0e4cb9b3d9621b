"""Whether a process that starts gets on, as the kernel counts its work.

The process need not help: while a library loads or a network is compiled, no thread of it can send
a sign of life. What it computed and read counts, not the time: on a busy machine or a slow disk a
start takes long and yet gets on, and one that is stopped or waits for ever does nothing at all.
"""

import contextlib
import os
import time
from dataclasses import dataclass
from pathlib import Path

# A core's share below which a process does nothing. One that waits wakes now and then; one that
# starts has a tenth of a core even beside ten others on one, and less only while it reads.
IDLE_SHARE = 0.01
MAX_STEP_S = 0.5  # of one look: where the node itself was stopped, the time is nobody's fault


@dataclass(frozen=True, slots=True)
class Work:
    """Work of a process since it began.

    Attributes:
        cpu_s: time on processors, all threads.
        read: bytes that it read from files, and pages of them.
        stopped: a signal or a debugger stops it at the moment.
    """

    cpu_s: float = 0.0
    read: int = 0
    stopped: bool = False


def work_of(pid: int) -> Work | None:
    """Return the work of the process ``pid``; ``None``: this system does not report it.

    Source: proc_pid_stat(5) and proc_pid_io(5).
    """
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
        fields = stat.rpartition(")")[2].split()
        state, pages = fields[0], int(fields[9])
        ticks = int(fields[11]) + int(fields[12])
        read = 0
        with contextlib.suppress(OSError):  # hidden in some containers
            io = Path(f"/proc/{pid}/io").read_text(encoding="ascii")
            read = int(io.split("rchar:")[1].split()[0])
        return Work(ticks / os.sysconf("SC_CLK_TCK"), read + pages, state in "Tt")
    except (OSError, ValueError, IndexError):
        return None


class Progress:
    """Watches one process that starts."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._last = self._since = work_of(pid) or Work()
        self._looked = time.monotonic()
        self.idle_s = 0.0  # for how long it has done nothing

    @property
    def cpu_s(self) -> float:
        """Its time on processors when ``look`` looked last."""
        return self._last.cpu_s

    @property
    def stopped(self) -> bool:
        """Whether it was stopped by a signal when ``look`` looked last."""
        return self._last.stopped

    def look(self) -> None:
        """See what it did; call this a few times a second."""
        now = time.monotonic()
        self.idle_s += min(now - self._looked, MAX_STEP_S)
        self._looked = now
        work = work_of(self._pid)
        if work is None:  # the time limit alone judges it
            self.idle_s = 0.0
            return
        self._last = work
        done_s = work.cpu_s - self._since.cpu_s
        if done_s > IDLE_SHARE * max(1.0, self.idle_s) or work.read > self._since.read:
            self._since, self.idle_s = work, 0.0
