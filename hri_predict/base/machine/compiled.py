"""Loops over arrays, compiled by numba if it is installed (extra ``accel``).

Each loop has two versions: plain loops, which numba compiles, and array operations, used if numba
is missing or turned off (``HRI_PREDICT_COMPILED=0``). Tests verify that both give equal results.
Compiled code is stored only in the cache folder; without it, each start compiles again.
"""

import contextlib
import functools
import importlib.util
import logging
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.machine.cache import cache_folder

log = logging.getLogger(__name__)

_SWITCH = "HRI_PREDICT_COMPILED"
_PARTS: list[Callable[..., Any]] = []  # marked, and not yet known to numba
_FAILED: list[str] = []
P = ParamSpec("P")
R = TypeVar("R")


def kernel(
    loops: Callable[..., Any], otherwise: Callable[P, R], *, any_order: bool = False
) -> Callable[P, R]:
    """Return a function that runs ``loops`` if numba is available, and ``otherwise`` if not.

    Args:
        loops: plain loops over arrays, in the subset supported by numba. It may call functions
            marked by ``part``.
        otherwise: the same with array operations; its types and docstring are used for both.
        any_order: let the compiler add up in any order, several numbers at once: faster, but
            results differ between processors in the last digits. For training, not for the node.

        The first call imports numba and compiles: call it once before real-time operation, with
        arrays of the final types.
    """
    chosen: Callable[P, R] | None = None

    @functools.wraps(otherwise)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        nonlocal chosen
        if chosen is None:
            compiler = _compiler(any_order)
            chosen = otherwise if compiler is None else _unless_it_fails(compiler, loops, otherwise)
        return chosen(*args, **kwargs)

    return call


def _unless_it_fails(
    compiler: Callable[[Callable[..., Any]], Callable[..., Any]],
    loops: Callable[..., Any],
    otherwise: Callable[P, R],
) -> Callable[P, R]:
    """Compile ``loops``; if compiling or a call fails, use ``otherwise`` from then on.

    A cached copy from an earlier version may name types that have moved. All cached copies are then
    removed, and the loops are compiled again.
    """
    compiled, again = compiler(loops), False
    working = True

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        nonlocal compiled, again, working
        while working:
            try:
                result: R = compiled(*args, **kwargs)
            except Exception as error:  # no fault of a compiler may end the node
                if isinstance(error, AttributeError | ImportError) and not again:
                    _forget_kept()
                    compiled, again = compiler(loops), True
                    continue
                working = False
                _say_once(f"{error}".partition("\n")[0])
            else:
                return result
        return otherwise(*args, **kwargs)

    return call


def _forget_kept() -> None:
    """Remove all cached copies; a copy created meanwhile by another process is just compiled
    again.
    """
    folder = cache_folder()
    if folder is not None:
        shutil.rmtree(folder / "numba", ignore_errors=True)
        with contextlib.suppress(OSError):
            (folder / "numba").mkdir(parents=True, exist_ok=True)


def _say_once(why: str) -> None:
    """Logged once for all failing loops."""
    if not _FAILED:
        log.warning("compiled loops fail; using slower array operations instead: %s", why)
    _FAILED.append(why)


def part(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a function called by compiled loops in the same file; numba compiles it into them.

    It must be in the same file, because numba recompiles its copy only when the loops' file
    changes.
    """
    _PARTS.append(function)
    return function


def plain(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the numbers in the layout that compiled loops need: contiguous, writable, double
    precision.

    Loops are recompiled for arrays of another type, and memory order and writability are part of
    the type. That must not happen while robots move.
    """
    if array.flags.carray and array.dtype == np.float64:
        return array
    return np.array(array, np.float64, order="C")


def is_compiled() -> bool:
    """Whether numba compiles the loops in this process."""
    return _compiler(any_order=False) is not None


def why_not_compiled() -> str:
    """Return why array operations are used, with the remedy; "" if numba is available. Does not
    import numba.
    """
    if os.environ.get(_SWITCH, "1") == "0":
        return f"{_SWITCH} is 0"
    if importlib.util.find_spec("numba") is None:
        return "numba is not installed; install it with: pip install 'hri-predict[accel]'"
    return ""


def why_not_kept() -> str:
    """Return why the next start will compile again, with the remedy; "" if it will not."""
    folder = cache_folder()
    if folder is None:
        return "the cache is off; set HRI_PREDICT_CACHE to a folder"
    if not _is_writable(folder / "numba"):
        return f"{folder} cannot be written; correct its permissions, or set HRI_PREDICT_CACHE"
    return ""


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        log.debug("cache: %s is not used: %s", folder, error.strerror)
        return False
    return os.access(folder, os.W_OK)


@contextlib.contextmanager
def _unused_blas() -> Iterator[None]:
    """Hide scipy's BLAS from numba, which imports it where it finds it, for products of matrices.

    No loop has such a product. scipy takes 0.2 s of processor time and 14 MiB, in the node and in
    the inference process.
    """
    name = "scipy.linalg.cython_blas"
    hidden = name not in sys.modules
    if hidden:
        sys.modules[name] = cast(ModuleType, None)  # as the import system marks what is not there
    try:
        yield
    finally:
        if hidden:
            del sys.modules[name]


@functools.cache
def _compiler(any_order: bool) -> Callable[[Callable[..., Any]], Callable[..., Any]] | None:
    """Return the compiler; ``None`` if numba is missing, broken or turned off."""
    if os.environ.get(_SWITCH, "1") == "0":
        return None
    try:
        with _unused_blas():
            import numba
            import numba.extending
            import numba.np.arraymath  # the part that looks for BLAS, otherwise loaded later
    except ImportError:
        return None
    except Exception as error:  # a broken installation must not end the node
        log.warning("numba is installed but cannot be used: %s", error)
        return None
    folder = cache_folder()
    keeps = folder is not None and _is_writable(folder / "numba")
    if folder is not None:
        numba.config.CACHE_DIR = str(folder / "numba")
    free = {"reassoc", "contract"} if any_order else False
    compiler: Callable[..., Any] = numba.njit(
        cache=keeps, nogil=True, error_model="numpy", fastmath=free
    )

    def compile_with_parts(loops: Callable[..., Any]) -> Callable[..., Any]:
        while _PARTS:
            numba.extending.register_jitable(_PARTS.pop())
        compiled: Callable[..., Any] = compiler(loops)
        return compiled

    return compile_with_parts
