"""Resources of a process and its descendants, as the kernel reports them (Linux, ``/proc``)."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

GROUPS = ("loop", "busiest other thread", "other threads", "helper processes")


def processor_time(pid: int) -> dict[str, float]:
    """Return the processor seconds since start: ``all``, and by group.

    ``loop`` is the first thread, in which the node's loop runs; helper processes are all
    descendants.
    """
    threads = dict(_threads(pid))
    loop = threads.pop(pid, 0.0)
    busiest = max(threads.values(), default=0.0)
    helpers = sum(seconds for child in descendants(pid) for _, seconds in _threads(child))
    others = sum(threads.values()) - busiest
    groups = dict(zip(GROUPS, (loop, busiest, others, helpers), strict=True))
    return {"all": sum(groups.values())} | groups


def resident_mib(pid: int) -> float:
    """Return the resident memory of a process and its descendants, MiB."""
    total = 0
    for each in (pid, *descendants(pid)):
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{each}/status").read_text().splitlines():
                if line.startswith("VmRSS:"):
                    total += int(line.split()[1])
    return total / 1024


def cores_busy() -> list[tuple[float, float]]:
    """Return (busy, all) of each core since boot, in kernel ticks."""
    found = []
    for line in Path("/proc/stat").read_text().splitlines():
        if line.startswith("cpu") and line[3].isdigit():
            ticks = [float(word) for word in line.split()[1:9]]
            found.append((sum(ticks) - ticks[3] - ticks[4], sum(ticks)))  # without idle, iowait
    return found


def descendants(pid: int) -> list[int]:
    """Return all descendants of this process."""
    parents: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            # the name in brackets may hold spaces; state and parent follow it
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            parents.setdefault(parent, []).append(int(stat.parent.name))
    found, waiting = list[int](), [pid]
    while waiting:
        children = parents.get(waiting.pop(), [])
        found += children
        waiting += children
    return found


def _threads(pid: int) -> Iterator[tuple[int, float]]:
    """Yield each thread's id and processor seconds; threads that have exited are left out."""
    for task in Path(f"/proc/{pid}/task").glob("*"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            yield int(task.name), int((task / "schedstat").read_text().split()[0]) * 1e-9
