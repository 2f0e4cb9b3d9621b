"""Errors that a user can cause and correct.

Each message is one line that names the file, key or field and the remedy (``ConfigMistakes`` has
one line for each mistake). The command line prints only these lines and exits with status 2,
without a traceback.
"""

import difflib
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType


class HriPredictError(Exception):
    """Base of every error that a user's file, flag or device can cause."""


class ConfigError(HriPredictError):
    """The configuration, a skeleton map or a flag is wrong."""


class ConfigMistakes(ConfigError):
    """All mistakes of one configuration; ``lines`` has one line for each."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(lines)
        super().__init__("\n".join(self.lines))


class RecordingError(HriPredictError):
    """A recording is missing, truncated, empty, or of an unknown kind."""


class UnusableRecordingError(RecordingError):
    """An intact recording is unsuitable: too short, slow or empty, or with unknown joints.

    Other recordings may be usable.
    """


class LostRecordingError(RecordingError):
    """Most joints of a recording are farther away than any that can be believed."""


class RobotError(HriPredictError):
    """A robot file or its trajectory is wrong: broken chain, missing capsule, joint count."""


class SourceError(HriPredictError):
    """A source cannot be opened, or its key cannot be used."""


class LinkError(HriPredictError):
    """A link cannot be opened, or cannot carry its messages."""


class LinkErrors(LinkError):
    """Several links cannot be opened; ``lines`` has one line for each."""

    def __init__(self, errors: Iterable[LinkError]) -> None:
        self.lines = tuple(map(str, errors))
        super().__init__("\n".join(self.lines))


class MachineError(HriPredictError):
    """The machine did something after which a running node cannot continue."""


class DiscoveryError(HriPredictError):
    """Services cannot be searched, or a service does not answer."""


class PredictorError(HriPredictError):
    """A predictor cannot be built, or its forecast breaks the contract."""


class ForeignError(Exception):
    """An error of foreign code that is not an ``Exception``; see ``failure``."""


def failure(error: BaseException) -> Exception:
    """Return an error of foreign code as an ``Exception``: a failure of that code alone.

    Some errors derive from ``BaseException`` alone although they do not ask this program to end:
    asyncio's ``CancelledError``, the panic of a library in Rust, and ``SystemExit`` of a part that
    behaves like a program. Call this first under ``except BaseException``.

    Raises:
        KeyboardInterrupt, GeneratorExit: ``error`` itself, which is not a failure. Ctrl-C reaches
            only the main thread.
    """
    if isinstance(error, GeneratorExit) or (
        isinstance(error, KeyboardInterrupt)
        and threading.current_thread() is threading.main_thread()
    ):
        raise error
    if isinstance(error, Exception):
        return error
    foreign = ForeignError(f"{type(error).__name__}: {first_line(error)}")
    foreign.__cause__ = error
    return foreign


class OsErrorAs:
    """Converts an ``OSError`` in a ``with`` block into one of these errors.

    Args:
        kind: class of the error.
        what: the failed action; the system's reason follows.
        remedy: follows the reason.
    """

    def __init__(self, kind: type[HriPredictError], what: str, remedy: str = "") -> None:
        self._kind, self._what, self._remedy = kind, what, remedy

    def __enter__(self) -> None:
        """Nothing."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if isinstance(error, OSError):
            remedy = f"; {self._remedy}" if self._remedy else ""
            raise self._kind(f"{self._what}: {error.strerror or error}{remedy}") from error


_OTHERS = {
    **dict.fromkeys(
        ("rpy", "yaw", "euler", "rotation", "orientation", "quaternion"), "quaternion_xyzw"
    ),
    **dict.fromkeys(("position", "translation", "origin"), "xyz"),
}
"""Other programs' terms, and the project's own."""
TURNED = "turned by 90 degrees about z"
QUARTER = "[0, 0, 0.7071, 0.7071]"
"""The quaternion of such a pose, an example for messages."""


def nearest(word: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """Return ``"; did you mean 'x'?"`` for the known word nearest to ``word``, or ``""``.

    ``cutoff``: minimum similarity, 0 to 1.
    """
    known = list(known)
    ours = _OTHERS.get(word.lower())
    close = [ours] if ours in known else difflib.get_close_matches(word, known, n=1, cutoff=cutoff)
    return f"; did you mean '{close[0]}'?" if close else ""


def first_line(error: object) -> str:
    """Return the first line of an error's text; the name of its class if the text is empty."""
    return next(iter(str(error).splitlines()), type(error).__name__)


def nearest_file(path: Path, others: Iterable[str] = ()) -> str:
    """Return ``"; did you mean 'x'?"`` for a near file of the same folder and ending, or ``""``.

    Args:
        path: the file that does not exist.
        others: names known elsewhere, considered if the folder has none as near.
    """
    try:
        there = [p.name for p in path.parent.iterdir() if p.suffix == path.suffix]
    except OSError:
        there = []
    for names in (there, list(others)):
        if close := difflib.get_close_matches(path.name, names, n=1, cutoff=0.75):
            return f"; did you mean '{path.parent / close[0] if names is there else close[0]}'?"
    return ""


def expected_shape(kind: str, keys: Sequence[str]) -> str | None:
    """Return the expected form if a value should be a settings block or a list; otherwise ``None``.

    Args:
        kind: type of pydantic's error.
        keys: keys of the block, most important first.
    """
    if kind == "list_type":
        return "expected a list: an entry after each '- ', or [entry, entry]; [] for none"
    if kind not in ("model_type", "model_attributes_type", "dict_type"):
        return None
    if not keys:
        return "expected a block of settings: each as 'key: value' on a line of its own below"
    return f"expected a block of settings such as {', '.join(f'{key}: ...' for key in keys[:3])}"
