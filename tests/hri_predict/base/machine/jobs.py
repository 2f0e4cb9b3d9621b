"""Tasks for the tests of workers: other processes find them by name."""

import os
import signal
import time
from pathlib import Path

from hri_predict.base.errors import ConfigError


def square(number: int) -> int:
    return number * number


def refused(number: int) -> int:
    if number == 2:
        raise ConfigError("two: cannot be done; take another number")
    return number


def threads() -> int:
    import torch

    return torch.get_num_threads()


def ended_once(number: int, mark: str) -> int:
    """The first process that does number 3 is killed in the middle of it."""
    if number == 3:
        try:
            Path(mark).touch(exist_ok=False)
        except FileExistsError:
            return square(number)
        os.kill(os.getpid(), signal.SIGKILL)
    return square(number)


def always_ends() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def slow_square(number: int, folder: str) -> int:
    """Say which process does it, and wait until the test has seen that."""
    Path(folder, f"{os.getpid()}").touch()
    time.sleep(0.2)
    return square(number)


def wait(seconds: float) -> None:
    time.sleep(seconds)
