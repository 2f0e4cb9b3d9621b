"""Training windows in true seconds and metres, cut from recordings at every phase."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor

from hri_predict.errors import ConfigError
from hri_predict.predictors.body import BODY
from hri_predict.predictors.body_frame import body_frame
from hri_predict.predictors.network import Shape
from hri_predict.scene import Bools
from hri_predict.settings import Settings, data_path, read_yaml
from hri_predict.training.augment import AugmentSettings, disturb, move
from hri_predict.training.samples import Samples
from hri_predict.training.tracks import Track, read_tracks

ORIGIN_STEPS = 15
"""Steps of history at every judged forecast origin, whatever a predictor reads."""
_LEAST_HISTORY = 5  # steps that a training window rests on at least, where the recording starts
_LEAST_FUTURE = 10  # steps of known future at least, where it ends
_MAX_GAP_S = 0.1  # as the node's ring buffers bridge it
_VALIDATION_BATCH = 256
_USES = ("fit", "validation")


class RecordingsSettings(Settings):
    """Which recordings are fitted and which validate.

    By default those of the committed split, of the CMU pack below ``root``. With ``fit`` and
    ``validation`` a user's own: paths or patterns below ``root``.
    """

    root: Path = Field(Path("../shared/data"), description="folder of the recordings")
    splits: str = Field("splits.yaml", description="file that lists the pack's recordings by use")
    fit: list[str] | None = None
    validation: list[str] | None = None

    def files(self, use: str) -> list[Path]:
        """Return the recordings for ``use``: "fit", "validation", "calibration" or "test".

        Raises:
            ConfigError: a file is missing, or nothing is left.
        """
        own = {"fit": self.fit, "validation": self.validation}.get(use)
        if own is not None:
            found = [path for pattern in own for path in self._matching(pattern)]
            if not found:
                raise ConfigError(f"data.{use}: no recording is named; name at least one")
            return found
        return [self._in_pack(name) for name in split(use, self.splits)]

    def _matching(self, pattern: str) -> list[Path]:
        found = (
            sorted(self.root.glob(pattern)) if not Path(pattern).is_absolute() else [Path(pattern)]
        )
        if not found:
            raise ConfigError(f"data: nothing matches '{pattern}' in {self.root}; check both")
        return found

    def _in_pack(self, name: str) -> Path:
        for folder in (self.root / "cmu_mocap", self.root):
            path = folder / f"{name}.npz"
            if path.exists():
                return path
        raise ConfigError(
            f"data.root: {self.root} has no cmu_mocap/{name}.npz; give the data pack's folder "
            f"(--data DIR), or name your own recordings under data.fit and data.validation"
        )


def split(use: str, file: str = "splits.yaml") -> list[str]:
    """Names of the CMU pack's recordings for one use, as "train/basketball_1".

    Raises:
        ConfigError: the file has no such list.
    """
    shipped = data_path("training", file)
    path = shipped if shipped.exists() else Path(file)
    names = read_yaml(path, "splits").get(use)
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise ConfigError(f"splits {path}: '{use}' must be a list of recordings")
    return names


class DataSettings(RecordingsSettings):
    """``data:`` of a training configuration for the Real judgement."""

    weights: dict[str, float] = Field(
        default_factory=dict,
        description="how often an action is drawn, relative to the others; 1 where not named",
    )
    augment: AugmentSettings = Field(default_factory=AugmentSettings)
    refit: bool = Field(
        False, description="fit the validation recordings, too, once the epoch has been chosen"
    )


class MotionSamples:
    """Windows of ``BODY`` joints; see ``samples.SampleSource``."""

    def __init__(self, settings: DataSettings, shape: Shape) -> None:
        if shape.skeleton is not BODY:
            raise ValueError("recordings are read as BODY")
        self.shape = shape
        self._settings = settings
        fit, validation = (
            [t for f in settings.files(use) for t in read_tracks(f)] for use in _USES
        )
        self._tracks, self._validation = (
            (fit + validation, []) if settings.refit else (fit, validation)
        )
        self.actions = tuple(sorted({t.action for t in (*self._tracks, *self._validation)}))
        self._clips = _Clips(self._tracks)
        weight = np.array([self._weight(track) for track in self._tracks])
        if not weight.sum() > 0:
            raise ConfigError(
                f"data: no recording lasts {(_LEAST_HISTORY + _LEAST_FUTURE) / shape.rate_hz:g} s; "
                f"longer ones are needed"
            )
        self._cumulative = np.cumsum(weight / weight.sum())

    def _usable_s(self, track: Track) -> float:
        span = float(track.stamps_ns[-1] - track.stamps_ns[0]) * 1e-9
        return max(0.0, span - (_LEAST_HISTORY + _LEAST_FUTURE) / self.shape.rate_hz)

    def _weight(self, track: Track) -> float:
        same = sum(self._usable_s(t) for t in self._tracks if t.action == track.action)
        return (
            self._settings.weights.get(track.action, 1.0) * self._usable_s(track) / max(same, 1e-9)
        )

    def rest(self) -> Tensor:
        """(28, 3) mean over all observed frames, each in its own body frame."""
        positions, observed = self._clips.positions[::4], self._clips.observed[::4]
        whole = observed.all(1) if observed.all(1).any() else observed.any(1)
        one = torch.from_numpy(positions[whole])[:, None].double()
        seen = torch.from_numpy(observed[whole])[:, None]
        placed = body_frame(one, seen, BODY).enter(one)
        count = seen.sum((0, 1)).clamp(min=1)[:, None]
        return ((placed * seen[..., None]).sum((0, 1)) / count).float()

    def batch(self, rng: np.random.Generator, size: int) -> Samples:
        """Draw windows: action, recording, phase and speed at random, then augment."""
        augment, rate = self._settings.augment, self.shape.rate_hz
        chosen = np.searchsorted(self._cumulative, rng.random(size), side="right")
        chosen = np.minimum(chosen, len(self._tracks) - 1)
        first, last = self._clips.first_s[chosen], self._clips.last_s[chosen]
        speed = np.exp(rng.uniform(-1, 1, size) * np.log1p(augment.warp))
        # recordings show people on the move; near a robot they sit and stand a lot, too
        speed *= np.where(rng.random(size) < augment.slow, rng.random(size), 1.0)
        backwards = rng.random(size) < augment.reverse
        before, after = (
            np.where(backwards, reversed_, usual) / rate * speed
            for usual, reversed_ in (
                (_LEAST_HISTORY, _LEAST_FUTURE),
                (_LEAST_FUTURE, _LEAST_HISTORY),
            )
        )
        begin = first + before
        end = np.maximum(begin, last - after)
        origin = begin + rng.random(size) * (end - begin)
        direction = np.where(backwards, -1.0, 1.0)
        positions, observed = self._cut(chosen, origin, direction * speed / rate)
        positions, observed = move(augment, rng, positions, observed)
        steps = self.shape.history_steps
        history, seen = positions[:, :steps].copy(), observed[:, :steps].copy()
        disturb(augment, rng, history, seen)
        return self._samples(history, seen, positions[:, steps:], observed[:, steps:], chosen)

    def validation(self) -> Iterator[Samples]:
        """Yield every second step of every validation recording, unaugmented; none of a refit."""
        if not self._validation:
            return
        clips, rate = _Clips(self._validation), self.shape.rate_hz
        chosen, origins = [], []
        for k in range(len(self._validation)):
            begin = clips.first_s[k] + (ORIGIN_STEPS - 1) / rate
            times = np.arange(begin, clips.last_s[k] - _LEAST_FUTURE / rate + 1e-9, 2 / rate)
            chosen.append(np.full(times.size, k))
            origins.append(times)
        which, when = np.concatenate(chosen), np.concatenate(origins)
        steps = self.shape.history_steps
        for at in range(0, which.size, _VALIDATION_BATCH):
            part = slice(at, at + _VALIDATION_BATCH)
            step_s = np.full(which[part].size, 1 / rate)
            positions, observed = self._cut(which[part], when[part], step_s, clips)
            yield self._samples(
                positions[:, :steps],
                observed[:, :steps],
                positions[:, steps:],
                observed[:, steps:],
                which[part],
                self._validation,
            )

    def _cut(
        self,
        chosen: NDArray[np.intp],
        origin_s: NDArray[np.float64],
        step_s: NDArray[np.float64],
        clips: "_Clips | None" = None,
    ) -> tuple[NDArray[np.float32], Bools]:
        steps = np.arange(1 - self.shape.history_steps, self.shape.horizon_steps + 1)
        return (clips or self._clips).at(chosen, origin_s[:, None] + steps * step_s[:, None])

    def _samples(
        self,
        history: NDArray[np.float32],
        observed: Bools,
        future: NDArray[np.float32],
        known: Bools,
        chosen: NDArray[np.intp],
        tracks: Sequence[Track] | None = None,
    ) -> Samples:
        tracks = self._tracks if tracks is None else tracks
        actions = [self.actions.index(tracks[k].action) for k in chosen]
        past, seen, ahead, sure = (
            torch.from_numpy(np.ascontiguousarray(a)) for a in (history, observed, future, known)
        )
        return Samples(past, seen, ahead, sure, torch.tensor(actions))


class _Clips:
    """All tracks behind one another, read at any times by linear interpolation."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        self.positions = np.concatenate([t.positions for t in tracks]).astype(np.float32)
        self.observed = np.concatenate([t.observed for t in tracks])
        lengths = np.array([len(t.stamps_ns) for t in tracks])
        self._begin = np.concatenate([[0], np.cumsum(lengths)[:-1]])
        self._last = self._begin + lengths - 1
        # every track starts a day after the one before: one search finds frames in all of them
        self.first_s = np.arange(len(tracks)) * 86400.0
        own = [(t.stamps_ns - t.stamps_ns[0]) * 1e-9 for t in tracks]
        self._stamps = np.concatenate([s + f for s, f in zip(own, self.first_s, strict=True)])
        self.last_s = self._stamps[self._last]

    def at(
        self, chosen: NDArray[np.intp], times: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], Bools]:
        """(B, S, J, 3) positions at (B, S) times, and (B, S, J) whether they are observed."""
        after = np.searchsorted(self._stamps, times.ravel(), side="right").reshape(times.shape)
        low, high = self._begin[chosen][:, None], self._last[chosen][:, None]
        inside = (times >= self._stamps[low] - 1e-9) & (times <= self._stamps[high] + 1e-9)
        before = np.clip(after - 1, low, high)
        after = np.clip(after, low, high)
        gap = self._stamps[after] - self._stamps[before]
        weight = np.clip((times - self._stamps[before]) / np.where(gap > 0, gap, 1.0), 0, 1)
        near = np.where(weight < 0.5, before, after)
        share = weight.astype(np.float32)[..., None, None]
        start = self.positions.take(before, axis=0)
        positions = start + share * (self.positions.take(after, axis=0) - start)
        seen = self.observed.take(before, axis=0) & self.observed.take(after, axis=0)
        on_frame = np.abs(times - self._stamps[near]) < 1e-6
        seen = np.where(on_frame[..., None], self.observed.take(near, axis=0), seen)
        seen &= (inside & ((gap <= _MAX_GAP_S) | on_frame))[..., None]
        return np.where(seen[..., None], positions, np.float32(0)), seen
