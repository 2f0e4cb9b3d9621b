"""The memory that the node and the predictor's process share: one window in, one forecast out.

It has no name in the file system, so nothing is left behind, however the processes exit. Its size
is fixed at the start, for the maximum number of people. A new window replaces the previous one,
even if that is unread. Each side writes a number before and after its data; a reader accepts only
data between two equal numbers.
"""

import fcntl
import mmap
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import PredictorError
from hri_predict.contracts.predictor import Forecast

MAX_BYTES = 2**30
_TEXT = 512  # bytes for what went wrong
_ALIGNED = 64  # bytes of a cache line
_MEAN, _MEAN_AND_STD, _ERROR = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Sizes:
    """Maximum P people, T steps of history, H steps of forecast, J joints."""

    people: int
    history: int
    horizon: int
    joints: int


class SharedWindows:
    """The shared memory, seen from either side.

    ``post`` and ``answer`` are the node's side, ``take`` and ``give`` and ``refuse`` the worker's.
    """

    def __init__(self, descriptor: int, sizes: Sizes) -> None:
        """Map the memory behind ``descriptor``, which must be as large as ``bytes_of`` says."""
        self.sizes = sizes
        self._memory = mmap.mmap(descriptor, bytes_of(sizes))
        self._next = 0
        window = (sizes.people, sizes.history, sizes.joints)
        forecast = (sizes.people, sizes.horizon, sizes.joints)
        self._asked = self._array((2,), np.int64)
        self._people = self._array((1,), np.int64)
        self._history: Floats = self._array((*window, 3), np.float64)
        self._observed: Bools = self._array(window, np.bool_)
        self._given = self._array((2,), np.int64)
        self._kind = self._array((2,), np.int64)  # and people, or bytes of text
        self._text = self._array((_TEXT,), np.uint8)
        self._positions: Floats = self._array((*forecast, 3), np.float64)
        self._std: Floats = self._array(forecast, np.float64)

    def post(self, number: int, history: Floats, observed: Bools) -> None:
        """Write the window ``number``: (P, T, J, 3) and (P, T, J).

        Raises:
            PredictorError: the window has too many people or another shape.
        """
        people = len(history)
        if people > self.sizes.people or history.shape[1:] != self._history.shape[1:]:
            raise PredictorError(
                f"a window of shape {history.shape} does not fit into {self._history.shape}"
            )
        self._asked[0] = number
        self._people[0] = people
        self._history[:people] = history
        self._observed[:people] = observed
        self._asked[1] = number

    def take(self, after: int) -> tuple[int, Floats, Bools] | None:
        """The newest window and its number; ``None`` without a complete one after ``after``."""
        number = int(self._asked[1])
        people = int(self._people[0])
        if number <= after or not 0 <= people <= self.sizes.people:
            return None
        history, observed = self._history[:people].copy(), self._observed[:people].copy()
        return None if int(self._asked[0]) != number else (number, history, observed)

    def give(self, number: int, forecast: Forecast) -> None:
        """Write the forecast for the window ``number``; its shapes were checked."""
        people = len(forecast.positions)
        self._given[0] = number
        self._positions[:people] = forecast.positions
        if forecast.std is not None:
            self._std[:people] = forecast.std
        self._kind[:] = (_MEAN if forecast.std is None else _MEAN_AND_STD, people)
        self._given[1] = number

    def refuse(self, number: int, why: str) -> None:
        """Write why there is no forecast for the window ``number``."""
        text = np.frombuffer(why.encode("utf-8", "replace")[:_TEXT], np.uint8)
        self._given[0] = number
        self._text[: len(text)] = text
        self._kind[:] = (_ERROR, len(text))
        self._given[1] = number

    @property
    def given(self) -> int:
        """Number of the newest window that was answered; 0 before the first."""
        return int(self._given[1])

    def answer(self, number: int) -> Forecast | PredictorError | None:
        """The answer to the window ``number``; ``None`` if it is missing or incomplete."""
        if int(self._given[1]) != number:
            return None
        kind, count = int(self._kind[0]), int(self._kind[1])
        found: Forecast | PredictorError
        if kind == _ERROR:
            found = PredictorError(bytes(self._text[:count]).decode("utf-8", "replace"))
        else:
            std = self._std[:count].copy() if kind == _MEAN_AND_STD else None
            found = Forecast(self._positions[:count].copy(), std)
        return None if int(self._given[0]) != number else found

    def _array(self, shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
        array: NDArray[Any] = np.ndarray(shape, kind, self._memory, self._next)
        self._next += _room(array.nbytes)
        return array


def bytes_of(sizes: Sizes) -> int:
    """Return the size of the memory."""
    each = sizes.people * sizes.joints
    numbers = 3 * 8 * each * sizes.history + 4 * 8 * each * sizes.horizon
    return _room(numbers + each * sizes.history + _TEXT + 12 * _ALIGNED)


def create() -> int:
    """Create memory without a size yet, and return its descriptor.

    Raises:
        OSError, AttributeError: this system has no such memory.
    """
    return os.memfd_create("hri-predict", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)


def set_size(descriptor: int, sizes: Sizes) -> None:
    """Give new memory its size; neither side can change it afterwards.

    Raises:
        PredictorError: it would be too large.
        OSError: there is no memory left.
    """
    if bytes_of(sizes) > MAX_BYTES:
        raise PredictorError(
            f"windows of {sizes.people} people, {sizes.history} steps back and {sizes.horizon} "
            f"ahead are too large for a process of their own; set predictor.process to false"
        )
    os.ftruncate(descriptor, bytes_of(sizes))
    fcntl.fcntl(
        descriptor,
        fcntl.F_ADD_SEALS,
        fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL,
    )


def _room(size: int) -> int:
    """``size`` rounded up to whole cache lines."""
    return -(-size // _ALIGNED) * _ALIGNED
