"""Benchmarks that ``evaluate --benchmark`` names: recordings, windows, joints and printed numbers.

A package adds one, an object, with an entry point in the group ``hri_predict.benchmarks``.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts import registry
from hri_predict.lab.datasets import cmu_benchmark, human36m
from hri_predict.predictors.neural.cmu_skeleton import CMU25, CMU38, MOVING
from hri_predict.predictors.neural.human_skeleton import HUMAN22, HUMAN32, SCORED

Takes = tuple[str, str, list[Floats]]
"""An action, its recordings' names in errors, and (n, J, 3) of each at 25 frames per second."""


_EULER = "Error of Euler angles by the quaternion route, the root's rotation included."


class Benchmark(Protocol):
    """The test recordings of a benchmark, and the rules of its papers.

    Attributes:
        title: its name for readers.
        unit: unit of positions; networks read and predict positions divided by 1000.
        skeletons: joints that are predicted, by error: ``mpjpe``, and ``euler`` where the
            recordings hold rotations.
        windows: the choices of ``--windows``.
        mean_over: actions of the mean; empty: all.
        zero_shot: actions without a train recording.
        notes: sentences for a reader of the tables, by error.
        published: YAML of the numbers that papers print, as ``published.yaml``; or ``None``.
    """

    title: str
    unit: str
    skeletons: Mapping[str, Skeleton]
    windows: Sequence[str]
    mean_over: Sequence[str]
    zero_shot: Sequence[str]
    notes: Mapping[str, Sequence[str]]
    published: Path | None

    def takes(self, directory: Path, error: str) -> Iterator[Takes]:
        """Yield the test recordings: positions with x left, y up, z forward, or rotations.

        Raises:
            ConfigError: there are none below ``directory``.
            RecordingError: a recording cannot be read.
        """

    def starts(
        self, windows: str, frames: Sequence[int], n_in: int, n_out: int
    ) -> list[NDArray[np.intp]]:
        """First frames of the windows of each take.

        Raises:
            RecordingError: a take is too short.
        """

    def errors(self, predicted: Floats, true: Floats) -> Floats:
        """(N, H, joints that count) distances of (N, H, J, 3)."""


class Cmu(Benchmark):
    """CMU-Mocap; see ``datasets.cmu_benchmark``."""

    title, unit = "CMU-Mocap", "benchmark mm"
    skeletons = {"mpjpe": CMU25, "euler": CMU38}
    windows = ("all", "8-seeds", "80-seeds")
    mean_over: Sequence[str] = cmu_benchmark.MEAN_OVER
    zero_shot: Sequence[str] = ("washwindow",)
    _AVAILABLE = (
        "32 of the 40 train recordings and 6 of the 8 test recordings are available: printed "
        "methods trained on more. Their epoch was chosen on the test recordings, ours was not."
    )
    notes = {
        "mpjpe": (
            "The benchmark's time and length are nominal: its 25 frames per second are 60 "
            "true ones, and its mm is 0.806 true mm. Of the 38 scored joints, 13 copy another or "
            "cannot err.",
            _AVAILABLE,
        ),
        "euler": (_EULER, _AVAILABLE),
    }
    published = Path(__file__).with_name("published.yaml")

    def takes(self, directory: Path, error: str) -> Iterator[Takes]:
        """See ``Benchmark``."""
        root = cmu_benchmark.data_root(directory)
        names = cmu_benchmark.benchmark_names(root, "test")
        if not names:
            raise ConfigError(
                f"--data {directory}: no test recording of the CMU benchmark "
                f"(test/basketball_1.npz, ...) there; check the folder"
            )
        for name in names:
            clip = cmu_benchmark.read_clip(root, name)
            values = clip.expmaps if error == "euler" else clip.positions()[:, MOVING]
            yield clip.action, f"recording {root / name}.npz", [values]

    def starts(
        self, windows: str, frames: Sequence[int], n_in: int, n_out: int
    ) -> list[NDArray[np.intp]]:
        """See ``Benchmark``."""
        return [cmu_benchmark.windows_of(windows, n, n_in, n_out) for n in frames]

    def errors(self, predicted: Floats, true: Floats) -> Floats:
        """See ``cmu_benchmark.joint_errors``."""
        return cmu_benchmark.joint_errors(predicted, true)


class Human36m(Benchmark):
    """Human3.6M; see ``datasets.human36m``."""

    title, unit = "Human3.6M", "mm"
    skeletons = {"mpjpe": HUMAN22, "euler": HUMAN32}
    windows = ("all", *human36m.SEEDED)
    mean_over, zero_shot = (), ()
    notes = {"euler": (_EULER,)}
    published = None

    def takes(self, directory: Path, error: str) -> Iterator[Takes]:
        """See ``Benchmark``."""
        for action, takes in human36m.read_takes(directory).items():
            where = f"recordings {directory}: {human36m.TEST_SUBJECT}/{action}_*.txt"
            if error == "euler":
                yield action, where, [take.maps for take in takes]
            else:
                yield action, where, [take.positions[:, SCORED] for take in takes]

    def starts(
        self, windows: str, frames: Sequence[int], n_in: int, n_out: int
    ) -> list[NDArray[np.intp]]:
        """See ``Benchmark``."""
        if windows in human36m.SEEDED:
            return human36m.seeded_windows(list(frames), n_in, windows)
        return [cmu_benchmark.all_windows(n, n_in, n_out) for n in frames]

    def errors(self, predicted: Floats, true: Floats) -> Floats:
        """Distance of each of the 22 joints."""
        return np.asarray(np.linalg.norm(predicted - true, axis=-1))


class Brought(Benchmark):
    """A package's benchmark; an error in the package's code names the benchmark.

    Raises:
        ConfigError: an attribute is missing or of another type.
    """

    def __init__(self, name: str, own: Any) -> None:
        self._name, self._own = name, own
        with self._blamed():
            self.title, self.unit = str(own.title), str(own.unit)
            self.skeletons = {str(error): _skeleton(s) for error, s in own.skeletons.items()}
            self.windows, self.mean_over = _texts(own.windows), _texts(own.mean_over)
            self.zero_shot = _texts(own.zero_shot)
            self.notes = {str(error): _texts(notes) for error, notes in own.notes.items()}
            self.published = None if own.published is None else Path(own.published)

    def takes(self, directory: Path, error: str) -> Iterator[Takes]:
        """See ``Benchmark``."""
        joints = len(self.skeletons[error].joints)
        actions: set[str] = set()
        with self._blamed():
            left = iter(self._own.takes(directory, error))
        while True:
            with self._blamed():
                item = next(left, _END)
                if item is _END:
                    break
                action, where, takes = item
                arrays = [np.asarray(take, np.float64) for take in takes]
                for array in arrays:
                    if array.ndim != 3 or array.shape[1:] != (joints, 3):
                        raise ValueError(f"{where}: has shape {array.shape}, not (n, {joints}, 3)")
                    if not np.isfinite(array).all():
                        raise ValueError(f"{where}: has values that are not finite numbers")
                if not arrays or str(action) in actions:
                    raise ValueError(f"{where}: gives action {action} twice, or no recording of it")
                actions.add(str(action))
            yield str(action), str(where), arrays
        with self._blamed():
            if not actions:
                raise ValueError(f"takes gives no action for {directory}")

    def starts(
        self, windows: str, frames: Sequence[int], n_in: int, n_out: int
    ) -> list[NDArray[np.intp]]:
        """See ``Benchmark``."""
        with self._blamed():
            starts = []
            given = list(map(np.asarray, self._own.starts(windows, frames, n_in, n_out)))
            for own, count in zip(given, frames, strict=True):
                if own.ndim != 1 or (own.size and own.dtype.kind not in "iu"):
                    raise ValueError(f"starts are {own.dtype} of shape {own.shape}, not integers")
                starts.append(own.astype(np.intp))  # an empty list becomes an array of floats
                if own.size and not (own.min() >= 0 and starts[-1].max() + n_in + n_out <= count):
                    raise ValueError(f"starts of windows are outside a take of {count} frames")
        return starts

    def errors(self, predicted: Floats, true: Floats) -> Floats:
        """See ``Benchmark``."""
        with self._blamed():
            errors = np.asarray(self._own.errors(predicted, true), np.float64)
            if errors.ndim != 3 or errors.shape[:2] != true.shape[:2]:
                raise ValueError(f"errors have shape {errors.shape}, not {true.shape[:2]} + joints")
            if errors.size == 0 or not (np.isfinite(errors) & (errors >= 0)).all():
                raise ValueError("errors have no joint, are below 0 or are not finite")
        return errors

    def _blamed(self) -> contextlib.AbstractContextManager[None]:
        return registry.calling(f"benchmark '{self._name}'", "fix the package that provides it")


_END: Any = object()


def _texts(given: Any) -> tuple[str, ...]:
    if isinstance(given, str):
        raise TypeError(f"'{given}' is a text, not a list of texts")
    return tuple(map(str, given))


def _skeleton(given: Any) -> Skeleton:
    if not isinstance(given, Skeleton):
        raise TypeError(f"skeletons has a {type(given).__name__}, not a Skeleton")
    return given


_OURS: Mapping[str, Benchmark] = {"cmu": Cmu(), "human36m": Human36m()}


def benchmark_of(name: str) -> Benchmark:
    """Return the benchmark of this name, from this project or an installed package.

    Raises:
        ConfigError: no benchmark has this name, it cannot be imported, or it is not a
            ``Benchmark``.
    """
    found = registry.part("benchmarks", name, _OURS)
    return _OURS[name] if name in _OURS else Brought(name, found)
