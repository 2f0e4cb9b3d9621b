"""The machine that was measured on, and how busy it was."""

import os
import platform
import time
import timeit
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict import __version__

BUSY = 0.5  # load average from which figures are not to be trusted
_GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
_LIBRARIES = ("numpy", "torch", "onnxruntime", "numba", "openvino")


def machine() -> dict[str, Any]:
    """Cores, processor, load average, governor, versions, and a yardstick."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "kernel": platform.release(),
        "governor": _read(_GOVERNOR) or "unknown",
        "load_average": round(os.getloadavg()[0], 2),
        "yardstick_us": round(yardstick_us(), 1),
        "python": platform.python_version(),
        "hri_predict": __version__,
        "libraries": {name: version for name in _LIBRARIES if (version := _version(name))},
        "began": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def yardstick_us() -> float:
    """Microseconds of a fixed work in Python and numpy: how fast this machine is just now."""
    values = np.linspace(0.0, 1.0, 1000)

    def work() -> None:
        for _ in range(20):
            np.sqrt(values * values + 1.0).argmin()
        sum(k * k for k in range(2000))

    return 1e6 * min(timeit.repeat(work, number=10, repeat=20)) / 10


def busy(load_average: float) -> str:
    """One line if the machine is too busy to be measured, otherwise ""."""
    if load_average <= BUSY:
        return ""
    return (
        f"this machine is busy (load average {load_average:.1f}, over {BUSY:g}): figures are too "
        f"large, and ratios of one run say more; stop what else runs, or wait a minute"
    )


def described(facts: dict[str, Any]) -> str:
    """The machine in one line."""
    return (
        f"{facts['cores']} cores, {facts['processor']}, governor {facts['governor']}, load average "
        f"{facts['load_average']:g} at start"
    )


def _processor() -> str:
    lines = _read(Path("/proc/cpuinfo")).splitlines()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
