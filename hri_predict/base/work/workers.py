"""Workers for offline work: this process, several processes, or a cluster's workers.

A task is a function of a module and plain arguments, such as one recording or one episode. Tasks
are independent, and each computes with one thread, so results do not depend on the worker or the
order.
"""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Self, TypeVar

from hri_predict.base.errors import ConfigError

log = logging.getLogger(__name__)

R = TypeVar("R")

MOST_DEATHS = 3
"""Number of crashed processes after which the work is abandoned, because a task may be the
cause.
"""
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_SAID_BEFORE = "hri_predict.recording.unused"  # its warnings: the starting process gave them


class Workers(ABC):
    """A worker for tasks. Use it in a ``with`` block, which stops everything it started.

    Attributes:
        count: number of tasks done at a time.
    """

    count: int = 1

    @abstractmethod
    def each(
        self, function: Callable[..., R], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, R]]:
        """Yield (index, result) of each task when it is done, in any order.

        Args:
            function: defined in a module, so that another process finds it by name.
            tasks: the arguments of each call.

        Raises:
            HriPredictError: the error of a task, or no worker is left.
        """

    def in_order(
        self,
        function: Callable[..., R],
        tasks: Sequence[tuple[Any, ...]],
        on_done: Callable[[], None] = lambda: None,
    ) -> list[R]:
        """Return the results in the tasks' order; ``on_done`` is called after each task.

        Raises:
            HriPredictError: see ``each``.
        """
        found: dict[int, R] = {}
        for place, result in self.each(function, tasks):
            found[place] = result
            on_done()
        return [found[place] for place in range(len(tasks))]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Stop everything that was started. Safe to call twice."""


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread in this context, because sums over several threads depend on their
    number.
    """
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class ThisProcess(Workers):
    """Runs the tasks in this process, one after the other."""

    def each(
        self, function: Callable[..., R], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, R]]:
        """See ``Workers``."""
        for place, arguments in enumerate(tasks):
            with one_thread():
                result = function(*arguments)
            yield place, result

    def close(self) -> None:
        """Do nothing: no process was started."""


class Processes(Workers):
    """Several processes on this machine, started when first needed.

    Tasks of a killed process (for example for lack of memory) are repeated in new processes.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: ProcessPoolExecutor | None = None

    def each(
        self, function: Callable[..., R], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, R]]:
        """See ``Workers``."""
        left = dict(enumerate(tasks))
        deaths = 0
        while left:
            try:
                yield from self._those_done(function, left)
            except BrokenProcessPool as error:
                self.close()
                deaths += 1
                if deaths == MOST_DEATHS:
                    raise ConfigError(
                        f"--jobs: a process exited early, {deaths} times, possibly for lack of "
                        "memory; run again with fewer jobs, and with --resume if you used --out"
                    ) from error
                log.warning("a process exited early; repeating %d tasks", len(left))

    def _those_done(
        self, function: Callable[..., R], left: dict[int, tuple[Any, ...]]
    ) -> Iterator[tuple[int, R]]:
        """Yield finished tasks, and remove them from ``left``."""
        pool = self._pool or self._started()
        with _interrupts_held():  # each call may start a process
            waiting = {pool.submit(function, *task): place for place, task in left.items()}
        try:
            while waiting:
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    place, result = waiting.pop(future), future.result()
                    del left[place]
                    yield place, result
        finally:
            for future in waiting:
                future.cancel()

    def _started(self) -> ProcessPoolExecutor:
        for variable in _ONE_THREAD:  # the processes inherit it; here the libraries have started
            os.environ.setdefault(variable, "1")
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(self.count, context, initializer=_begin)
        return self._pool

    def close(self) -> None:
        """Stop the processes; tasks not yet started are dropped."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back: a process started now inherits that until ``_begin``.

    Otherwise it would print a traceback for an interrupt while it still imports.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    """Set up a process: one thread, a quiet exit, and an exit together with the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(1)
    logging.getLogger(_SAID_BEFORE).setLevel(logging.ERROR)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
