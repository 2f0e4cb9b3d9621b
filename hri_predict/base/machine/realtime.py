"""System support for a real-time loop: priority, dedicated cores, locked memory.

All of it is optional. A request that the system refuses gives one warning with the remedy, because
a less steady node is better than none. Only the loop's thread gets the priority: threads and
processes that it starts later do not inherit it.

Linux: sched(7), sched_setscheduler(2), mlockall(2).
"""

import contextlib
import ctypes
import gc
import logging
import os
from collections.abc import Iterator
from typing import Annotated, Self

from pydantic import Field, model_validator

from hri_predict.base.settings import Settings

log = logging.getLogger(__name__)

Core = Annotated[int, Field(ge=0, le=1023)]
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
GUIDE = "docs/guides/realtime.md"


class RealtimeSettings(Settings):
    """Real-time options of the loop (``realtime:`` in the configuration); by default none."""

    priority: int | None = Field(
        None, ge=1, le=98, description="SCHED_FIFO priority of the loop's thread"
    )
    cpus: tuple[Core, ...] = Field((), description="cores that the loop's thread may use")
    inference_cpus: tuple[Core, ...] = Field(
        (), description="cores that the predictor's process may use"
    )
    lock_memory: bool = Field(
        False, description="keep the memory of the node and of its predictor from being swapped out"
    )

    @model_validator(mode="after")
    def _apart(self) -> Self:
        shared = sorted(set(self.cpus) & set(self.inference_cpus))
        if shared:
            raise ValueError(
                f"core {shared[0]} is in cpus and in inference_cpus: the loop would wait for the "
                "predictor; use different cores"
            )
        return self


def can_have_process() -> bool:
    """Whether a separate predictor process would have a core besides the loop's."""
    return hasattr(os, "memfd_create") and len(usable_cores()) > 1


def usable_cores() -> set[int]:
    """Return the cores that this process may use."""
    if not hasattr(os, "sched_getaffinity"):
        return set(range(os.cpu_count() or 1))
    return os.sched_getaffinity(0)


@contextlib.contextmanager
def steady(settings: RealtimeSettings) -> Iterator[None]:
    """Apply ``settings`` to the calling thread, and revert them at the end.

    Call it last, when all other threads are running. Refused requests are logged.
    """
    if settings.lock_memory:
        _warn("lock_memory", lock_memory())
    cores = usable_cores()
    if settings.cpus:
        _warn("cpus", _pin(set(settings.cpus)))
    if settings.priority is not None:
        _warn("priority", set_fifo(settings.priority))
    try:
        yield
    finally:
        if settings.priority is not None:
            with contextlib.suppress(OSError, AttributeError):
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        if settings.cpus:
            _pin(cores)


def set_fifo(priority: int) -> str:
    """Run the calling thread under SCHED_FIFO; return the obstacle with its remedy, or ""."""
    try:
        # reset on fork: whatever this thread starts begins without the priority
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        return (
            f"the system does not permit SCHED_FIFO {priority}; give LimitRTPRIO={priority} in the "
            f"service's unit, or rtprio in /etc/security/limits.conf"
        )
    except (OSError, AttributeError) as error:
        return f"SCHED_FIFO is not available: {error}; remove realtime.priority"
    return ""


def lock_memory() -> str:
    """Lock this process's memory; return the obstacle with its remedy, or "".

    Memory allocated later is locked at its first use: locking entire thread stacks and unused
    reserves of libraries would take gigabytes.
    """
    try:
        library = ctypes.CDLL(None, use_errno=True)
        done = library.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)
    except (OSError, AttributeError) as error:
        return f"memory cannot be locked: {error}; remove realtime.lock_memory"
    if done == 0:
        return ""
    return (
        f"memory cannot be locked: {os.strerror(ctypes.get_errno())}; set LimitMEMLOCK=infinity "
        "in the service's unit, or memlock in /etc/security/limits.conf"
    )


def settle() -> None:
    """End a start: collect garbage, exclude the rest from collections, and return free memory.

    Loading a network frees several copies of its weights, which the C library would keep.
    """
    gc.collect()
    gc.freeze()
    with contextlib.suppress(OSError, AttributeError):  # other libraries than glibc lack it
        ctypes.CDLL(None).malloc_trim(0)


def _pin(cores: set[int]) -> str:
    try:
        os.sched_setaffinity(0, cores)
    except (OSError, AttributeError) as error:
        there = ", ".join(map(str, sorted(usable_cores())))
        return f"cores {sorted(cores)} are not available ({error}); this process may use: {there}"
    return ""


def _warn(key: str, problem: str) -> None:
    if problem:
        log.warning("realtime.%s: %s (%s)", key, problem, GUIDE)
