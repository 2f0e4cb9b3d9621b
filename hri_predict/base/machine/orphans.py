"""Processes that exit with their parent process, even if it is killed or hangs.

On Linux the kernel kills them; on other systems they continue.
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
        parent: process id; the parent's thread that started this process must exist as long as this
            process.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before the kernel was told
        os._exit(1)


def command_of(program: str, *arguments: str) -> list[str]:
    """Return the command of a Python program that exits with this process.

    Args:
        program: a module, as for ``python -m``, or the path of a script ``*.py``.
        arguments: arguments of the program.
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
