"""Publishers in processes of their own; each test has a domain of its own.

``OTHER_ROS_PYTHON=/path/to/python`` lets another interpreter publish, with another release of ROS.
"""

import ctypes
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.hri_drivers.ros_domains import domains
from tests.hri_drivers.sources.ros2 import generated

PUBLISHER = Path(__file__).parents[4] / "drivers" / "ros2" / "people_publisher.py"
DOMAINS = domains(100)
OF_THIS_RELEASE = (
    "PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
)  # fmt: skip
"""Variables by which an interpreter finds its own ROS; the last one is of the wheels."""
Publish = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def domain() -> int:
    return next(DOMAINS)


@pytest.fixture(scope="session")
def other_messages() -> Iterator[Path]:
    """Packages that the wheels lack, for this process and for publishers; built only once."""
    if why := generated.missing():
        pytest.skip(why)
    folder = generated.build()
    for library in folder.glob("*.so"):  # for this process; others look along the path
        ctypes.CDLL(str(library))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
        patch.setenv("LD_LIBRARY_PATH", str(folder), prepend=os.pathsep)
        yield folder


@pytest.fixture
def publish(domain: int) -> Iterator[Publish]:
    """Starts publishers, and kills them in the end."""
    started: list[subprocess.Popen[bytes]] = []

    def start(program: Path = PUBLISHER, **options: Any) -> "subprocess.Popen[bytes]":
        words = [
            f"--{name.replace('_', '-')}" + ("" if value is True else f"={value}")
            for name, value in options.items()
        ]
        python = os.environ.get("OTHER_ROS_PYTHON", sys.executable)
        process = subprocess.Popen([python, program, *words], env=_environment(domain))
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()


def _environment(domain: int) -> dict[str, str]:
    kept = dict(os.environ)
    if "OTHER_ROS_PYTHON" in kept:
        for name in OF_THIS_RELEASE:
            kept.pop(name, None)
    return kept | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
