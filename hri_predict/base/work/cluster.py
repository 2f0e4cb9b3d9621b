"""Offline work on several machines, using the workers of a Dask scheduler started by the user.

Tasks name files by path, and each worker reads its own copy. So each task first checks that its
worker has the same software and files, and fails otherwise: a table must not depend on which worker
computed a part of it.

Dask's messages are pickles, which can run any code: a program that reaches
the scheduler controls its workers and all clients. This class connects only to the address given by
the user, and never listens.
"""

import asyncio
import concurrent.futures
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.work.identity import digests, software
from hri_predict.base.work.workers import R, Workers, one_thread

log = logging.getLogger(__name__)

CONNECT_S = 5.0
WORKER_S = 10.0
_TOLD_S = 30.0
_ONE_AT_A_TIME = threading.Lock()  # a worker may have several threads

_READ: dict[str, str] = {}
"""Path -> digest at this worker's first read, because motions and configurations stay in memory."""

Expected = tuple[tuple[str, str], ...]


class Cluster(Workers):
    """The workers of a Dask scheduler. Tasks of a lost worker are repeated on others."""

    def __init__(self, address: str, reads: Sequence[Path] = ()) -> None:
        """Connect.

        Args:
            address: address of the scheduler, such as ``tcp://127.0.0.1:8786``.
            reads: files that the tasks read.

        Raises:
            ConfigError: the extra is missing, there is no answer, or there is no worker.
        """
        try:
            import distributed
        except ImportError as error:
            raise ConfigError(
                "--cluster: needs Dask; install it with: pip install 'hri-predict[cluster]'"
            ) from error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors come as exceptions
        self._address = address
        try:
            self._client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError, TypeError, ImportError) as error:
            raise ConfigError(
                f"--cluster {address}: no Dask scheduler answers there; start one with "
                f"'dask scheduler --host 127.0.0.1', or correct the address"
            ) from error
        try:
            self._client.wait_for_workers(1, timeout=WORKER_S)
        except TimeoutError as error:
            self.close()
            raise ConfigError(
                f"--cluster {address}: the scheduler has no worker; start some with "
                f"'dask worker {address} --nthreads 1'"
            ) from error
        self.count = len(self._client.scheduler_info(n_workers=-1)["workers"])
        self._software: Expected = tuple(software().items())
        self._files: Expected = tuple(digests(reads).items())

    def each(
        self, function: Callable[..., R], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, R]]:
        """See ``Workers``."""
        waiting = {
            self._client.submit(
                _done, function, task, self._software, self._files, pure=False
            ): place
            for place, task in enumerate(tasks)
        }
        try:
            while waiting:
                for future in self._finished(list(waiting)):
                    yield waiting.pop(future), self._result(future)
                    future.release()
        finally:
            if waiting and self._client.status == "running":
                self._client.cancel(list(waiting))

    def _finished(self, futures: Sequence[Any]) -> list[Any]:
        """Wait until some tasks are done; log a warning if no worker is left."""
        import distributed

        while True:
            try:
                with self._client.as_current():
                    found = distributed.wait(
                        futures, timeout=_TOLD_S, return_when="FIRST_COMPLETED"
                    )
            except TimeoutError:
                if self._client.status != "running":
                    raise self._gone() from None
                if not self._client.scheduler_info(n_workers=-1)["workers"]:
                    log.warning("--cluster %s: no worker is left; waiting for one", self._address)
            except (OSError, concurrent.futures.CancelledError, asyncio.CancelledError) as error:
                raise self._gone() from error
            else:
                return list(found.done)

    def _result(self, future: Any) -> Any:
        import distributed

        try:
            return future.result()
        except distributed.KilledWorker as error:
            raise ConfigError(
                f"--cluster {self._address}: the same task crashed several workers, possibly for "
                "lack of memory; give the workers more, and use --resume if you used --out"
            ) from error
        except (ModuleNotFoundError, AttributeError) as error:
            if "hri_" not in str(error):
                raise
            raise ConfigError(
                f"--cluster {self._address}: a worker has no hri-predict of this version ({error});"
                f" install the same there"
            ) from error
        except (concurrent.futures.CancelledError, asyncio.CancelledError) as error:
            raise self._gone() from error

    def _gone(self) -> ConfigError:
        return ConfigError(
            f"--cluster {self._address}: the scheduler exited before the work was complete; start "
            "it and run again, with --resume if you used --out"
        )

    def close(self) -> None:
        """Disconnect; the scheduler and its workers keep running."""
        self._client.close(timeout=CONNECT_S)


def _done(
    function: Callable[..., R], arguments: tuple[Any, ...], expected: Expected, files: Expected
) -> R:
    """Run a task on a worker, one at a time, if the worker's software and files match."""
    with _ONE_AT_A_TIME:
        _demand_same(expected, files)
        with one_thread():
            return function(*arguments)


@lru_cache(maxsize=4)
def _demand_same(expected: Expected, files: Expected) -> None:
    """Check this worker.

    Raises:
        ConfigError: it has other software or other files than the command.
    """
    own = software()
    for name, wanted in expected:
        if own.get(name) != wanted:
            raise ConfigError(
                f"--cluster: {_here()} has {name} {own.get(name, 'none')}, this command {wanted}; "
                f"install the same on both"
            )
    for (path, wanted), found in zip(
        files, digests(Path(p) for p, _ in files).values(), strict=True
    ):
        if found != wanted:
            what = "is missing" if found == "missing" else "is another file"
            raise ConfigError(
                f"--cluster: {path} {what} for {_here()}; share the folder, or copy it to the same "
                f"path"
            )
        if _READ.setdefault(path, wanted) != wanted:
            raise ConfigError(
                f"--cluster: {_here()} has already read an older {path}, and may have cached it; "
                "restart the worker"
            )


def _here() -> str:
    try:
        from distributed import get_worker

        return f"worker {get_worker().address}"
    except (ImportError, ValueError):
        return "a worker"
