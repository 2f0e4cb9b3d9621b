"""One capture of a motion capture system, as extracted from its bytes."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, Protocol

import numpy as np

from hri_drivers.sources.sent import SentPerson
from hri_predict.base.arrays import Floats

MAX_PEOPLE = 64
MAX_STAMP_S = 9e9  # the year 2255; nanoseconds of it fit in 64 bits
_SHOWN = 80


class FrameError(ValueError):
    """The bytes are not in the expected format; one line with the remedy."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Frame:
    """One capture.

    Attributes:
        stamp_ns: time of the capture on the sender's clock; ``None`` if it sends no time.
        number: the sender's count of captures; ``None`` if it sends no count.
        people: every person, in the units and axes of the joint map.
        tracks: whether the sender reports that it tracks; if not, no person is seen.
        complete: false if the sender names a person without a position.
    """

    stamp_ns: int | None
    number: int | None = None
    people: tuple[SentPerson, ...] = ()
    tracks: bool = True
    complete: bool = True


class Reader(Protocol):
    """Turns untrusted bytes into captures; it may keep parts of a capture between calls."""

    def read(self, data: bytes) -> Frame | None:
        """The capture that one datagram completes, if any.

        Raises:
            FrameError: the datagram is not valid. No input raises any other exception.
        """

    def reset(self) -> None:
        """Discard incomplete captures, and what the sender reported about itself."""

    def pause(self) -> None:
        """Discard incomplete captures: the sender was silent, and may have restarted."""


def person(number: int, positions: Floats, *, origin_seen: bool = True) -> SentPerson:
    """A person whose unobserved joints are NaN.

    Args:
        number: the sender's id.
        positions: (J_source, 3).
        origin_seen: false if the sender writes zeros for joints that it did not measure.
    """
    if not origin_seen:
        positions = np.where((positions == 0).all(axis=1, keepdims=True), np.nan, positions)
    observed = np.asarray(np.isfinite(positions).all(axis=1))
    return SentPerson(number, np.where(observed[:, None], positions, np.nan), observed)


def json_object(data: bytes) -> Mapping[str, Any]:
    """The object in JSON text.

    Raises:
        FrameError: it is not an object in valid JSON.
    """
    try:
        found = json.loads(data.decode("utf-8"), parse_constant=_no_constant)
    except RecursionError:
        raise FrameError("JSON that is nested too deeply") from None
    except (ValueError, OverflowError) as error:
        raise FrameError(f"not JSON in UTF-8: {shown(str(error))}") from None
    if not isinstance(found, dict):
        raise FrameError("not a JSON object")
    return found


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def member(found: Any, key: str, kind: type) -> Any:
    """The value of a key in an object.

    Raises:
        FrameError: the key is missing, or its value is of another type.
    """
    value = found.get(key) if isinstance(found, Mapping) else None
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise FrameError(f"'{key}' is missing, or not {_KINDS[kind]}")
    return value


_KINDS = {dict: "an object", list: "a list", str: "text", int: "a whole number", bool: "a boolean"}


def number_of(value: Any) -> float:
    """A finite number.

    Raises:
        FrameError: it is not one.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FrameError(f"{shown(str(value))} is not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise FrameError("a number that is not finite")
    return number


def place_of(found: Any) -> tuple[float, float, float]:
    """The position in an object with ``x``, ``y`` and ``z``.

    Raises:
        FrameError: one of them is missing or not a finite number.
    """
    if not isinstance(found, Mapping):
        raise FrameError("a place must be an object with x, y and z")
    return number_of(found.get("x")), number_of(found.get("y")), number_of(found.get("z"))


def stamp_of_s(value: Any) -> int:
    """Nanoseconds of a stamp in seconds.

    Raises:
        FrameError: it is not a number, or not a time.
    """
    seconds = number_of(value)
    if abs(seconds) > MAX_STAMP_S:
        raise FrameError(f"a time stamp of {seconds:.3g} s")
    return round(seconds * 1e9)


def shown(text: str) -> str:
    """Text from the sender, made safe for a log: short, one line, ASCII."""
    line = " ".join(text.split())[:_SHOWN]
    return line.encode("ascii", "backslashreplace").decode("ascii")
