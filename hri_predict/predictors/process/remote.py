"""The node's end of one worker: starts the process, asks it for forecasts, kills it."""

import contextlib
import json
import logging
import os
import select
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import PredictorError
from hri_predict.contracts.predictor import Forecast, PredictorSettings
from hri_predict.predictors.process import shared
from hri_predict.predictors.process.description import Description
from hri_predict.predictors.process.worker import ASKED, LOG, MAX_MESSAGE

# -- whether a process that starts gets on, as the kernel counts its work --------------------------
#
# The process need not help: while a library loads or a network is compiled, no thread of it can
# send a sign of life. What it computed and read counts, not the time: on a busy machine or a slow
# disk a start takes long and yet gets on, and one that is stopped or waits for ever does nothing
# at all.

# A core's share below which a process does nothing. One that waits wakes now and then; one that
# starts has a tenth of a core even beside ten others on one, and less only while it reads.
IDLE_SHARE = 0.01
MAX_STEP_S = 0.5  # of one look: where the node itself was stopped, the time is nobody's fault


@dataclass(frozen=True, slots=True)
class Work:
    """Work of a process since its start.

    Attributes:
        cpu_s: CPU time of all threads.
        read: number of bytes read from files, plus that of pages read.
        stopped: a signal or a debugger has stopped it.
    """

    cpu_s: float = 0.0
    read: int = 0
    stopped: bool = False


def work_of(pid: int) -> Work | None:
    """Return the work of the process ``pid`` and its children; ``None`` if not reported.

    Source: proc_pid_stat(5), proc_pid_io(5) and proc_tid_children(5).
    """
    try:
        own = _own_work(pid)
    except (OSError, ValueError, IndexError):
        return None
    cpu_s, read = own.cpu_s, own.read
    with contextlib.suppress(OSError, ValueError, IndexError):
        for tasks in Path(f"/proc/{pid}/task").glob("*/children"):
            for child in tasks.read_text(encoding="ascii").split():
                work = _own_work(int(child))
                cpu_s, read = cpu_s + work.cpu_s, read + work.read
    return Work(cpu_s, read, own.stopped)


def _own_work(pid: int) -> Work:
    stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    fields = stat.rpartition(")")[2].split()
    state, pages = fields[0], int(fields[9])
    ticks = sum(map(int, fields[11:15]))  # its own, and of children that have ended
    read = 0
    with contextlib.suppress(OSError):  # hidden in some containers
        io = Path(f"/proc/{pid}/io").read_text(encoding="ascii")
        read = int(io.split("rchar:")[1].split()[0])
    return Work(ticks / os.sysconf("SC_CLK_TCK"), read + pages, state in "Tt")


class Progress:
    """Watches a process while it starts."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._last = self._since = work_of(pid) or Work()
        self._looked = time.monotonic()
        self.idle_s = 0.0  # for how long it has done nothing

    @property
    def cpu_s(self) -> float:
        """Its CPU time at the last call of ``look``."""
        return self._last.cpu_s

    @property
    def stopped(self) -> bool:
        """Whether a signal had stopped it at the last call of ``look``."""
        return self._last.stopped

    def look(self) -> None:
        """Check its progress; call this a few times per second."""
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


# --------------------------------------------------------------------------------------------------

log = logging.getLogger(__name__)

LOOK_S = 0.2  # between two looks at a process that starts
TELL_S = 10.0  # between two lines of the log about it

_BEGIN = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from hri_predict.predictors.process.worker import main; sys.exit(main(sys.argv[2:]))"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Message to a worker at its start.

    Attributes:
        settings: settings of the predictor, with resolved paths.
        people: maximum number of people.
        cpus: cores that it may use; none: all.
        lock_memory: keep its memory from being swapped out.
    """

    settings: PredictorSettings
    people: int
    cpus: tuple[int, ...] = ()
    lock_memory: bool = False

    def text(self) -> bytes:
        """As JSON."""
        return json.dumps(
            {
                "settings": self.settings.model_dump(mode="json", exclude_unset=True)
                | {"name": self.settings.name},
                "people": self.people,
                "cpus": self.cpus,
                "lock_memory": self.lock_memory,
            }
        ).encode()


@dataclass(frozen=True, slots=True, kw_only=True)
class Patience:
    """Time limits of a process's start.

    Attributes:
        limit_s: total time.
        idle_s: time without progress.
        cpu_s: CPU time.
    """

    limit_s: float
    idle_s: float
    cpu_s: float

    def ended(self, took_s: float, progress: Progress) -> str | None:
        """Return why the patience has ended after ``took_s``; ``None`` if it has not."""
        if progress.idle_s > self.idle_s:
            why = " (a signal stopped it)" if progress.stopped else ""
            return f"it did nothing for {progress.idle_s:.1f} s while it started{why}"
        if progress.cpu_s > self.cpu_s:
            return f"it computed for {progress.cpu_s:.1f} s without becoming ready"
        if took_s > self.limit_s:
            return f"it took longer than {self.limit_s:g} s"
        return None


class WorkerEndedError(PredictorError):
    """The worker's process has exited."""


class Worker:
    """One process that predicts. The loop's thread asks; another thread starts it and waits."""

    def __init__(self, job: Job) -> None:
        """Start the process; ``begin`` waits until it is ready.

        Raises:
            OSError, AttributeError: the system lacks such processes, memory or sockets, or has too
                few.
        """
        self._job = job
        self._memory = shared.create()
        self._windows: shared.SharedWindows | None = None
        self._asked = 0
        self.start_cpu_s = 0.0  # what its start took on processors
        self._owed_since: float | None = None  # perf_counter; the oldest unanswered window, at most
        try:
            self._link, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with far:
                self.process = _started([far.fileno(), self._memory])
        except BaseException:
            os.close(self._memory)
            raise
        self._readable = select.poll()
        self._readable.register(self._link, select.POLLIN)

    def begin(self, patience: "Patience") -> Description:
        """Wait until the predictor is built, then let the worker start.

        Raises:
            PredictorError: it cannot be built, or ``patience`` ended.
            WorkerEndedError: the process exited before that.
        """
        try:
            self._link.send(self._job.text())
            told = json.loads(self._first_message(patience))
            if "error" in told:
                raise PredictorError(told["error"])
            described = Description.from_data(told["ready"])
            sizes = shared.Sizes(
                self._job.people,
                described.history_steps,
                described.horizon_steps,
                len(described.skeleton.joints),
            )
            shared.set_size(self._memory, sizes)
            self._windows = shared.SharedWindows(self._memory, sizes)
            self._link.send(b"begin")
        except OSError as error:
            raise WorkerEndedError(
                f"predictor '{self._job.settings.name}': its own process exited before it was "
                f"ready ({error.strerror}); see its output above, check that enough "
                f"memory is free, "
                f"or set predictor.process to false"
            ) from error
        finally:
            os.close(self._memory)
        self._link.setblocking(False)
        return described

    def _first_message(self, patience: "Patience") -> bytes:
        """Return the worker's first message, however long it takes while there is progress.

        Raises:
            PredictorError: ``patience`` ended.
            OSError: the process has exited.
        """
        began = time.perf_counter()
        told_s = 0.0
        progress = Progress(self.process.pid)
        while (message := self._message(LOOK_S)) is None:
            progress.look()
            took_s = time.perf_counter() - began
            problem = patience.ended(took_s, progress)
            if problem is not None:
                raise PredictorError(
                    f"predictor '{self._job.settings.name}' is not ready in its own process: "
                    f"{problem}; see what it waits for, or set predictor.process to false"
                )
            if took_s > told_s + TELL_S:
                told_s = took_s
                log.warning(
                    "predictor '%s': its own process is still starting after %.0f s (CPU time: "
                    "%.1f s)", self._job.settings.name, took_s, progress.cpu_s
                )  # fmt: skip
        self.start_cpu_s = progress.cpu_s
        return message

    def forecast(self, history: Floats, observed: Bools, wait_s: float) -> Forecast | None:
        """Ask for the forecast of a window; ``None``: it did not come within ``wait_s``.

        If more than one earlier window is still unanswered, the worker still gets this one, but
        this does not wait: an answer within the tick is unlikely.

        Raises:
            PredictorError: the predictor failed.
            WorkerEndedError: the process has exited.
        """
        assert self._windows is not None
        owed = self._asked - self._windows.given
        if owed > 1:
            wait_s = 0.0
        until = time.perf_counter() + wait_s
        self._windows.post(self._asked + 1, history, observed)  # fails for more people than planned
        self._asked += 1
        if owed == 0 or self._owed_since is None:
            self._owed_since = time.perf_counter()
        try:
            with contextlib.suppress(BlockingIOError):  # it has bytes enough that wake it
                self._link.send(ASKED)
            while (answer := self._windows.answer(self._asked)) is None:
                if self._message(until - time.perf_counter()) is None:
                    return None
                self._owed_since = time.perf_counter()  # it is slow, and does not hang
        except OSError as error:
            raise WorkerEndedError("its process has exited") from error
        self._owed_since = None
        if isinstance(answer, PredictorError):
            raise answer
        return answer

    @property
    def silent_s(self) -> float:
        """Seconds for which an answer has been outstanding."""
        return 0.0 if self._owed_since is None else time.perf_counter() - self._owed_since

    def end(self) -> None:
        """Close the node's end of the socket, which lets the process exit by itself."""
        with contextlib.suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)

    def wait(self) -> int:
        """Wait until the process has exited; return its exit status."""
        return self.process.wait()

    def kill(self) -> None:
        """Kill the process if it still runs."""
        self.process.kill()

    def _message(self, wait_s: float) -> bytes | None:
        """Return the next message that is not a line of the log; ``None``: none came in time.

        Raises:
            OSError: the process has exited.
        """
        until = time.perf_counter() + wait_s
        while self._readable.poll(max(0.0, 1e3 * (until - time.perf_counter()))):
            message = self._link.recv(MAX_MESSAGE)
            if not message:
                raise ConnectionResetError(0, "it ended")
            if not message.startswith(LOG):
                return message
            _log(message[len(LOG) :])
        return None


def _started(own: list[int]) -> subprocess.Popen[bytes]:
    """Start the process, which inherits the descriptors ``own``."""
    path = json.dumps(sys.path)  # third parties' predictors lie where the node finds them
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _BEGIN, path, *map(str, own), str(os.getpid())],
        pass_fds=own,
        stdin=subprocess.DEVNULL,
        stdout=sys.__stderr__ or subprocess.DEVNULL,  # the node's output is its own
    )


def _log(line: bytes) -> None:
    with contextlib.suppress(ValueError, TypeError):
        name, level, text = json.loads(line)
        logging.getLogger(str(name)).log(int(level), "%s", text)
