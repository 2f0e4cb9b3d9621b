"""Loops over arrays that numba compiles where it is installed (extra ``accel``).

A loop is written twice: as plain loops, which numba compiles, and as array operations, which
compute where numba is missing or turned off (``HRI_PREDICT_COMPILED=0``). Tests hold both equal.
What is compiled is kept in the cache's folder, and nowhere else; without one, each start compiles
again.
"""

import contextlib
import functools
import importlib.util
import logging
import os
import shutil
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.machine.cache import cache_folder

log = logging.getLogger(__name__)

_SWITCH = "HRI_PREDICT_COMPILED"
_PARTS: list[Callable[..., Any]] = []  # marked, and not yet known to numba
_FAILED: list[str] = []
P = ParamSpec("P")
R = TypeVar("R")


def kernel(loops: Callable[..., Any], otherwise: Callable[P, R]) -> Callable[P, R]:
    """A function that ``loops`` computes where numba is there, and ``otherwise`` elsewhere.

    Args:
        loops: plain loops over arrays, in what numba understands. It may call other functions that
            ``part`` marked.
        otherwise: the same by array operations; it lends its types and its docstring.

    Numba is imported at the first call, which compiles: call it once, with arrays of the types
    that it will get, before time matters.
    """
    chosen: Callable[P, R] | None = None

    @functools.wraps(otherwise)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        nonlocal chosen
        if chosen is None:
            compiler = _compiler()
            chosen = otherwise if compiler is None else _unless_it_fails(compiler, loops, otherwise)
        return chosen(*args, **kwargs)

    return call


def _unless_it_fails(
    compiler: Callable[[Callable[..., Any]], Callable[..., Any]],
    loops: Callable[..., Any],
    otherwise: Callable[P, R],
) -> Callable[P, R]:
    """Compile ``loops``; once that fails, or a call of it, ``otherwise`` computes for good.

    A kept copy of an earlier version may name types that have moved since. All kept copies are
    removed then, and the loops compiled again.
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
    """Remove all kept copies; a copy that another process makes meanwhile is only made again."""
    folder = cache_folder()
    if folder is not None:
        shutil.rmtree(folder / "numba", ignore_errors=True)
        with contextlib.suppress(OSError):
            (folder / "numba").mkdir(parents=True, exist_ok=True)


def _say_once(why: str) -> None:
    """One line for all loops that fail."""
    if not _FAILED:
        log.warning("compiled loops fail, so arrays compute instead, which is slower: %s", why)
    _FAILED.append(why)


def part(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a function that compiled loops of the same file call; numba compiles it into them.

    Of the same file, because numba makes its copy again when the file of the loops changes.
    """
    _PARTS.append(function)
    return function


def plain(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same numbers as compiled loops take them: in one piece, writable, double precision.

    Loops are compiled again for arrays of another type, and those of another order or that may not
    be written are of another type. That must not happen while robots move.
    """
    if array.flags.carray and array.dtype == np.float64:
        return array
    return np.array(array, np.float64, order="C")


def is_compiled() -> bool:
    """Whether numba compiles the loops of this process."""
    return _compiler() is not None


def why_not_compiled() -> str:
    """Why arrays compute, with the remedy; "" if numba is there. Imports nothing."""
    if os.environ.get(_SWITCH, "1") == "0":
        return f"{_SWITCH} is 0"
    if importlib.util.find_spec("numba") is None:
        return "numba is not installed; pip install 'hri-predict[accel]'"
    return ""


@functools.cache
def _compiler() -> Callable[[Callable[..., Any]], Callable[..., Any]] | None:
    """Return the compiler; ``None`` if numba is missing, broken or turned off."""
    if os.environ.get(_SWITCH, "1") == "0":
        return None
    try:
        import numba
        import numba.extending
    except ImportError:
        return None
    except Exception as error:  # a broken installation must not end the node
        log.warning("numba is installed and cannot be used: %s", error)
        return None
    folder = cache_folder()
    keeps = False
    if folder is not None:
        try:
            (folder / "numba").mkdir(parents=True, exist_ok=True)
            keeps = os.access(folder / "numba", os.W_OK)
        except OSError as error:
            log.debug("cache: %s is not used: %s", folder, error.strerror)
        numba.config.CACHE_DIR = str(folder / "numba")
    compiler: Callable[..., Any] = numba.njit(cache=keeps, nogil=True, error_model="numpy")

    def compile_with_parts(loops: Callable[..., Any]) -> Callable[..., Any]:
        while _PARTS:
            numba.extending.register_jitable(_PARTS.pop())
        compiled: Callable[..., Any] = compiler(loops)
        return compiled

    return compile_with_parts
