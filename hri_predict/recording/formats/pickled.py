"""Python pickles as data: NumPy arrays and plain containers only; nothing in the file is run.

A pickle is a program that may name any function of any module. This reader knows the few names with
which NumPy's arrays are written, in the protocols 0 to 4, and puts its own constructors in their
place. Every other name, and every instruction that calls, imports or changes objects, is refused.
Text of Python 2 is read as Latin-1, as NumPy's documentation asks (``encoding='latin1'``).
"""

import io
import math
import pickle
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hri_predict.base.arrays import Floats

MAX_BYTES = 2**28
MAX_STEPS = 1_000_000
"""Maximum number of instructions in a pickle: each may add an object. One of 3DPW's has a few
thousand."""
MAX_ARGUMENTS = 4
"""Arguments of a constructor: NumPy's have three, and a long tuple may be used again and again."""
_NUMBER = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248])")
_LATIN = "latin1"


class _Opaque:
    """A value that is ignored, such as a NumPy scalar."""


@dataclass
class _Type:
    code: str
    order: str = "<"


@dataclass
class Array:
    """An array as stated in its pickle, not yet checked."""

    shape: Any = ()
    kind: Any = None
    fortran: Any = False
    data: Any = b""

    def numbers(self, most: int) -> Floats:
        """Return its numbers, at most ``most`` of eight bytes each.

        Raises:
            ValueError: it holds other things, or less or more than its shape says, or too many;
                with the remedy.
        """
        if not isinstance(self.kind, _Type) or not isinstance(self.shape, tuple):
            raise ValueError("an array without a type; copy it again")
        code = f"{self.kind.order}{self.kind.code}"
        if not _NUMBER.fullmatch(code):
            raise ValueError(
                f"an array of type {self.kind.code[:8]!r}, not of numbers; copy it again"
            )
        data = self.data.encode(_LATIN) if isinstance(self.data, str) else self.data
        sizes = [n for n in self.shape if type(n) is int and 0 <= n <= MAX_BYTES]
        kind = np.dtype(code)
        whole = len(sizes) == len(self.shape) <= 8 and isinstance(data, bytes)
        if not whole or math.prod(sizes) * kind.itemsize != len(data):
            raise ValueError("an array whose data do not fill its shape; copy it again")
        if (count := math.prod(sizes)) > most:
            raise ValueError(f"an array of {count} numbers, more than {most}; cut it into parts")
        order: Any = "F" if self.fortran is True else "C"
        return np.frombuffer(data, kind).reshape(sizes, order=order).astype(np.float64)


def _new_array(*_: Any) -> Array:
    return Array()


def _new_type(code: Any, *_: Any) -> _Type:
    if not isinstance(code, str):
        raise pickle.UnpicklingError("a type of NumPy without a name")
    return _Type(code)


def _opaque(*_: Any) -> _Opaque:
    return _Opaque()


_NAMES: dict[str, Any] = {"numpy.ndarray": None, "numpy.dtype": _new_type}
for _core in ("numpy.core", "numpy._core"):
    _NAMES |= {
        f"{_core}.multiarray._reconstruct": _new_array,
        f"{_core}.multiarray.scalar": _opaque,
    }


class _Reader(pickle._Unpickler):
    """The instructions of containers, numbers, text and NumPy's arrays.

    It derives from the reader in Python: with that in C, a few bytes can claim gigabytes.
    """

    dispatch: ClassVar[dict[int, Callable[[Any], None]]]
    memo: dict[int, Any]
    pop_mark: Callable[[], list[Any]]

    def run(self) -> Any:
        """Return the object in the file.

        Raises:
            pickle.UnpicklingError: it holds other things than data.
        """
        self._unframer = pickle._Unframer(self._file_read, self._file_readline)  # type: ignore[attr-defined]
        self.read, self.readline = self._unframer.read, self._unframer.readline
        self.readinto = self._unframer.readinto
        self.metastack: list[list[Any]] = []
        self.stack: list[Any] = []
        self.append = self.stack.append
        self.proto, self._spent = 0, 0
        for _ in range(MAX_STEPS):
            key = self.read(1)
            if key == pickle.STOP:
                return self.stack.pop()
            step = self.dispatch.get(key[0]) if key else None
            if step is None:
                what = f"the instruction {key!r}" if key else "no end"
                raise pickle.UnpicklingError(f"it has {what}, not data alone")
            step(self)
        raise pickle.UnpicklingError(f"it has more than {MAX_STEPS} instructions")

    def find_class(self, module: str, name: str) -> Any:
        """Return the reader's own constructor of that name."""
        whole = f"{module}.{name}"
        if whole == "_codecs.encode":
            return self._encoded
        if whole not in _NAMES:
            raise pickle.UnpicklingError(f"it names {whole[:60]!r}, not data alone")
        return _NAMES[whole]

    def _encoded(self, text: Any, *_: Any) -> bytes:
        """Return bytes as protocol 2 of Python 3 writes them: as Latin-1."""
        if not isinstance(text, str):
            raise pickle.UnpicklingError("it has bytes that are not text")
        self._spent += len(text)
        if self._spent > MAX_BYTES:  # one text may be used again and again
            raise pickle.UnpicklingError("it unpacks to too much")
        return text.encode(_LATIN)

    def load_put(self) -> None:
        self._keep(int(self.readline()[:-1]))

    def load_binput(self) -> None:
        self._keep(self.read(1)[0])

    def load_long_binput(self) -> None:
        self._keep(int.from_bytes(self.read(4), "little"))

    def _keep(self, number: int) -> None:
        if not 0 <= number <= MAX_STEPS:  # chosen numbers could make all look-ups slow
            raise pickle.UnpicklingError("it numbers its objects in no order")
        self.memo[number] = self.stack[-1]

    def load_reduce(self) -> None:
        args = self.stack.pop()
        function = self.stack.pop()
        if not callable(function) or not isinstance(args, tuple):
            raise pickle.UnpicklingError("it calls what is not NumPy's")
        if len(args) > MAX_ARGUMENTS:
            raise pickle.UnpicklingError(f"it calls with more than {MAX_ARGUMENTS} arguments")
        self.append(function(*args))

    def load_build(self) -> None:
        state, made = self.stack.pop(), self.stack[-1]
        if isinstance(made, Array) and isinstance(state, tuple) and len(state) == 5:
            _, made.shape, made.kind, made.fortran, made.data = state
        elif isinstance(made, _Type) and isinstance(state, tuple) and len(state) >= 2:
            made.order = state[1] if isinstance(state[1], str) else "?"
        else:
            raise pickle.UnpicklingError("it changes what is not an array")

    def load_setitem(self) -> None:
        value, key, made = self.stack.pop(), self.stack.pop(), self.stack[-1]
        _put(made, [key, value])

    def load_setitems(self) -> None:
        items = self.pop_mark()
        _put(self.stack[-1], items)

    def load_dict(self) -> None:
        items = self.pop_mark()
        made: dict[Any, Any] = {}
        _put(made, items)
        self.append(made)

    def load_append(self) -> None:
        value, made = self.stack.pop(), self.stack[-1]
        _extend(made, [value])

    def load_appends(self) -> None:
        items = self.pop_mark()
        _extend(self.stack[-1], items)


def _put(made: Any, items: list[Any]) -> None:
    if not isinstance(made, dict) or len(items) % 2:
        raise pickle.UnpicklingError("it puts items into what is not a dictionary")
    for key, value in zip(items[::2], items[1::2], strict=True):
        if not isinstance(key, str | bytes):  # hashes of others can be made slow
            raise pickle.UnpicklingError("it has a dictionary with keys that are not text")
        made[key] = value


def _extend(made: Any, items: list[Any]) -> None:
    if not isinstance(made, list):
        raise pickle.UnpicklingError("it appends to what is not a list")
    made.extend(items)


_BASE = pickle._Unpickler.dispatch
_TAKEN = (
    pickle.PROTO, pickle.FRAME, pickle.MARK, pickle.POP, pickle.POP_MARK, pickle.DUP, pickle.NONE,
    pickle.NEWTRUE, pickle.NEWFALSE, pickle.INT, pickle.BININT, pickle.BININT1, pickle.BININT2,
    pickle.LONG, pickle.LONG1, pickle.LONG4, pickle.FLOAT, pickle.BINFLOAT, pickle.STRING,
    pickle.BINSTRING, pickle.SHORT_BINSTRING, pickle.BINBYTES, pickle.SHORT_BINBYTES,
    pickle.BINBYTES8, pickle.UNICODE, pickle.BINUNICODE, pickle.SHORT_BINUNICODE,
    pickle.BINUNICODE8, pickle.TUPLE, pickle.EMPTY_TUPLE, pickle.TUPLE1, pickle.TUPLE2,
    pickle.TUPLE3, pickle.LIST, pickle.EMPTY_LIST, pickle.EMPTY_DICT, pickle.MEMOIZE, pickle.GET,
    pickle.BINGET, pickle.LONG_BINGET, pickle.GLOBAL, pickle.STACK_GLOBAL,
)  # fmt: skip
_Reader.dispatch = {step[0]: _BASE[step[0]] for step in _TAKEN} | {
    pickle.PUT[0]: _Reader.load_put,
    pickle.BINPUT[0]: _Reader.load_binput,
    pickle.LONG_BINPUT[0]: _Reader.load_long_binput,
    pickle.REDUCE[0]: _Reader.load_reduce,
    pickle.BUILD[0]: _Reader.load_build,
    pickle.SETITEM[0]: _Reader.load_setitem,
    pickle.SETITEMS[0]: _Reader.load_setitems,
    pickle.DICT[0]: _Reader.load_dict,
    pickle.APPEND[0]: _Reader.load_append,
    pickle.APPENDS[0]: _Reader.load_appends,
}


def read_pickle(data: bytes) -> Any:
    """Return a pickle's object: dictionaries, lists, tuples, text, numbers and ``Array``.

    Raises:
        ValueError: the pickle is damaged, or contains more than data.
    """
    try:
        return _Reader(io.BytesIO(data), encoding=_LATIN).run()
    except pickle.UnpicklingError as error:
        raise ValueError(str(error)) from error
    except Exception as error:  # of any kind, on damaged bytes
        raise ValueError("it is damaged") from error
