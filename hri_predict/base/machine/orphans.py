"""Processes that end with the one that started them, even if that is killed or hangs.

The kernel ends them, on Linux; on other systems they stay.
"""

import contextlib
import ctypes
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1
_BEGIN = "from hri_predict.base.machine.orphans import _run; _run()"


def end_with(parent: int) -> None:
    """Let the kernel kill this process when its parent ends.

    Args:
        parent: process id; its thread that started this process has to live as long as it.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before the kernel was told
        os._exit(1)


def command_of(program: str, *arguments: str) -> list[str]:
    """Return the command of a Python program that ends with this process.

    Args:
        program: a module, as ``python -m`` takes it, or the path of a script ``*.py``.
        arguments: of the program.
    """
    return [sys.executable, "-c", _BEGIN, str(os.getpid()), program, *arguments]


def _run() -> None:
    """Run the command line of ``command_of``."""
    end_with(int(sys.argv.pop(1)))
    program = sys.argv.pop(1)
    if program.endswith(".py"):
        runpy.run_path(program, run_name="__main__")
    else:
        runpy.run_module(program, run_name="__main__", alter_sys=True)
