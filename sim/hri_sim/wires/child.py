"""Another process that a bench needs, and the pipe to it."""

import contextlib
import multiprocessing
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from typing import Any

from hri_predict.base.errors import LinkError

START_S = 60.0  # long enough for a loaded machine
Run = Callable[..., Any]
"""A function of a pipe and more arguments; it returns a report once the pipe has data to read."""


class Child:
    """A running process.

    Args:
        pid: process id.
        pipe: this end of its pipe.
    """

    def __init__(self, pid: int, pipe: Connection) -> None:
        self.pid = pid
        self._pipe = pipe

    def send(self, what: Any) -> None:
        """Send an object to the process."""
        with contextlib.suppress(OSError):  # it ended; the next ``receive`` says why
            self._pipe.send(what)

    def receive(
        self, timeout_s: float = START_S, awaited: "subprocess.Popen[str] | None" = None
    ) -> Any:
        """Return the next object that the process sends.

        Args:
            timeout_s: maximum time to wait.
            awaited: another process that must run for the object to be sent.

        Raises:
            LinkError: one of the two processes exited, or nothing arrived in time.
        """
        give_up_s = time.monotonic() + timeout_s
        while not self._pipe.poll(0.1):
            if awaited is not None and awaited.poll() is not None:
                assert awaited.stderr is not None
                said = awaited.stderr.read().strip().splitlines()[-1:]
                raise LinkError(f"a process of the bench exited: {''.join(said) or 'nothing'}")
            if time.monotonic() > give_up_s:
                raise LinkError(f"a process of the bench sent nothing in {timeout_s:g} s")
        try:
            told = self._pipe.recv()
        except EOFError:
            raise LinkError("a process of the bench exited without a report") from None
        if isinstance(told, LinkError):
            raise told
        return told

    def report(self) -> Any:
        """Stop the process; return its report."""
        self.send("end")
        return self.receive()


@contextlib.contextmanager
def child(run: Run, *arguments: Any) -> Iterator[Child]:
    """Run a function in a separate process, which stops when the context exits.

    Args:
        run: the function; it must be importable.
        arguments: arguments of the function, after its pipe.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_run, args=(run, theirs, arguments), daemon=True)
    process.start()
    theirs.close()
    assert process.pid is not None
    try:
        yield Child(process.pid, ours)
    finally:
        process.kill()
        process.join()
        ours.close()


def _run(run: Run, pipe: Connection, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with its pipe
    try:
        told = run(pipe, *arguments)
    except Exception as error:
        told = LinkError(f"a process of the bench exited: {type(error).__name__}: {error}")
    with contextlib.suppress(OSError):
        pipe.send(told)
