"""Missing real-time settings of a machine, and how to set them.

Supports Linux; little is checked elsewhere. Everything is read from the system or tried briefly;
nothing is changed.
"""

import ctypes
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hri_predict.base.machine.realtime import RealtimeSettings, lock_memory, set_fifo, usable_cores

_GOOD_CLOCKS = ("tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter", "xen")
SLACK_NS = 5_000  # a thread may be woken so much later, to save energy


@dataclass(frozen=True, slots=True)
class MachineProperty:
    """One property of the machine.

    Attributes:
        name: the inspected setting.
        found: its state.
        remedy: command that sets it; "" if nothing is missing.
        refused: the key under ``realtime:`` whose request the system refuses; or "".
    """

    name: str
    found: str
    remedy: str = ""
    refused: str = ""


def survey(settings: RealtimeSettings, root: Path = Path("/")) -> list[MachineProperty]:
    """Inspect the machine for the requests in ``settings``.

    Args:
        root: the folder in which ``proc`` and ``sys`` are.
    """
    return [
        _priority(settings),
        _locked(settings),
        *_cores(settings),
        _quota(root),
        _isolated(settings, root),
        _kernel(root),
        _throttled(root),
        _governor(root),
        _swap(settings, root),
        _pages(root),
        _slack(settings, root),
        _clock(root),
    ]


def _priority(settings: RealtimeSettings) -> MachineProperty:
    wanted = settings.priority or 1
    problem = _in_thread(lambda: set_fifo(wanted))
    name = f"SCHED_FIFO {wanted}"
    if not problem:
        unused = "" if settings.priority else "to use it, set realtime.priority"
        return MachineProperty(name, "permitted", unused)
    return MachineProperty(name, "not permitted", problem, "priority" if settings.priority else "")


def _locked(settings: RealtimeSettings) -> MachineProperty:
    problem = lock_memory()
    if not problem:
        ctypes.CDLL(None).munlockall()
        unused = "" if settings.lock_memory else "to use it, set realtime.lock_memory"
        return MachineProperty("locked memory", "permitted", unused)
    refused = "lock_memory" if settings.lock_memory else ""
    return MachineProperty("locked memory", "not permitted", problem, refused)


def _cores(settings: RealtimeSettings) -> list[MachineProperty]:
    usable, there = usable_cores(), os.cpu_count() or 1
    few = "" if len(usable) > 1 else "give the node a second core, for parallel inference"
    found = [MachineProperty("cores", f"{len(usable)} of {there} may be used", few)]
    for key in ("cpus", "inference_cpus"):
        missing = sorted(set(getattr(settings, key)) - usable)
        if missing:
            named = ", ".join(map(str, missing))
            may = ", ".join(map(str, sorted(usable)))
            remedy = f"this process may use {may}; name some of these, or widen its cpuset"
            found.append(MachineProperty(f"realtime.{key}", f"not available: {named}", remedy, key))
    return found


def _quota(root: Path) -> MachineProperty:
    """Check the share of processor time that the container or service may use."""
    lines = _read(root / "proc/self/cgroup").splitlines()
    own = next((line.removeprefix("0::/") for line in lines if line.startswith("0::/")), "")
    base, least = root / "sys/fs/cgroup", None
    folders = [base / own, *(base / own).parents]
    for folder in folders[: folders.index(base) + 1]:
        quota, _, period = _read(folder / "cpu.max").partition(" ")
        if quota.isdigit() and period.isdigit():
            share = int(quota) / int(period)
            least = share if least is None else min(least, share)
    old = _read(base / "cpu/cpu.cfs_quota_us"), _read(base / "cpu/cpu.cfs_period_us")
    if least is None and all(text.isdigit() for text in old):
        least = int(old[0]) / int(old[1])
    if least is None:
        return MachineProperty("processor quota", "none")
    return MachineProperty(
        "processor quota",
        f"{least:g} cores",
        "a node that has used it up pauses until the next period; remove CPUQuota from the "
        "service, or --cpus from the container",
    )


def _isolated(settings: RealtimeSettings, root: Path) -> MachineProperty:
    isolated = _read(root / "sys/devices/system/cpu/isolated")
    if isolated:
        unused = "" if settings.cpus else f"to use them, set realtime.cpus: [{isolated}]"
        return MachineProperty("isolated cores", isolated, unused)
    remedy = "boot with isolcpus=N nohz_full=N and set realtime.cpus: [N]" * bool(settings.cpus)
    return MachineProperty("isolated cores", "none", remedy)


def _kernel(root: Path) -> MachineProperty:
    version = _read(root / "proc/version")
    if _read(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in version:
        return MachineProperty("kernel", "PREEMPT_RT")
    return MachineProperty(
        "kernel",
        "not PREEMPT_RT",
        "for wake-ups within 0.1 ms under load, install a kernel with PREEMPT_RT (Debian: "
        "linux-image-rt-amd64)",
    )


def _throttled(root: Path) -> MachineProperty:
    """Check the share of time after which the kernel halts real-time threads."""
    runtime = _read(root / "proc/sys/kernel/sched_rt_runtime_us")
    period = _read(root / "proc/sys/kernel/sched_rt_period_us")
    if not (runtime.isdigit() and period.isdigit()):  # -1: no limit
        return MachineProperty("limit of SCHED_FIFO", "none" if runtime == "-1" else "not known")
    return MachineProperty(
        "limit of SCHED_FIFO", f"{100 * int(runtime) / int(period):.0f} % of the time"
    )


def _governor(root: Path) -> MachineProperty:
    pattern = "sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor"
    found = sorted({_read(path) for path in root.glob(pattern)})
    if not found:
        return MachineProperty("frequency governor", "none is visible")
    said = ", ".join(found)
    if found == ["performance"]:
        return MachineProperty("frequency governor", said)
    return MachineProperty("frequency governor", said, "cpupower frequency-set -g performance")


def _swap(settings: RealtimeSettings, root: Path) -> MachineProperty:
    swaps = len(_read(root / "proc/swaps").splitlines()) - 1
    if swaps < 1:
        return MachineProperty("swap", "none")
    remedy = "swapoff -a, or set realtime.lock_memory" * (not settings.lock_memory)
    return MachineProperty("swap", "in use" if not settings.lock_memory else "there", remedy)


def _pages(root: Path) -> MachineProperty:
    text = _read(root / "sys/kernel/mm/transparent_hugepage/enabled")
    chosen = text.partition("[")[2].partition("]")[0] or "not known"
    remedy = "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled" * (chosen == "always")
    return MachineProperty("transparent huge pages", chosen, remedy)


def _slack(settings: RealtimeSettings, root: Path) -> MachineProperty:
    text = _read(root / "proc/self/timerslack_ns")
    if not text.isdigit():
        return MachineProperty("timer slack", "not known")
    needed = int(text) > SLACK_NS and settings.priority is None
    remedy = "TimerSlackNSec=1us in the service's unit; SCHED_FIFO has none" * needed
    return MachineProperty("timer slack", f"{int(text) / 1e3:g} µs", remedy)


def _clock(root: Path) -> MachineProperty:
    name = _read(root / "sys/devices/system/clocksource/clocksource0/current_clocksource")
    if not name:
        return MachineProperty("clock source", "not known")
    remedy = "reading it takes microseconds; boot with clocksource=tsc if the TSC is stable"
    return MachineProperty("clock source", name, remedy * (name not in _GOOD_CLOCKS))


def _in_thread(work: Callable[[], str]) -> str:
    """Return the result of ``work``, run in a temporary thread whose scheduling does not
    persist.
    """
    found: list[str] = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join()
    return found[0]


def _read(path: Path) -> str:
    """Return the text of a system file; "" if it does not exist."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
