"""Training windows in true seconds and metres, cut from recordings at every phase.

A window is what the node would have had: it ends at a capture, and nothing captured later is in
its history.
"""

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor

from hri_predict.base.arrays import Bools
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.settings import MAX_COORDINATE_M, Settings
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.lab.datasets.splits import in_pack, split
from hri_predict.lab.datasets.tracks import Track, read_tracks
from hri_predict.lab.evaluation.windows import ORIGIN_STEPS
from hri_predict.lab.training.windows.augment import AugmentSettings, disturb, move
from hri_predict.lab.training.windows.bodies import BodySettings, draw_bodies
from hri_predict.lab.training.windows.clips import Clips
from hri_predict.lab.training.windows.played import Played
from hri_predict.lab.training.windows.samples import Samples
from hri_predict.lab.training.windows.trackers import (
    TrackerSettings,
    draw_lost,
    draw_noise,
    draw_periods,
    hide_by_convention,
)
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.body_frame import body_frame
from hri_predict.predictors.neural.network import Shape

log = logging.getLogger(__name__)

_LEAST_HISTORY = 5  # known steps of history in a training window at a recording's start
_LEAST_FUTURE = 10  # known steps of future in a training window at a recording's end
_LEAST_RATE_HZ = 5.0  # captures; with fewer, most of a window's future is interpolated
_VALIDATION_BATCH = 256
_USES = ("fit", "validation")


class RecordingsSettings(Settings):
    """The recordings to fit, and those for validation.

    By default the committed split of the data pack below ``root``. ``fit`` and ``validation`` name
    the user's own recordings instead: paths or patterns below ``root``.
    """

    root: Path = Field(Path("../shared/data"), description="folder of the recordings")
    splits: str = Field("splits.yaml", description="file that lists the pack's recordings by use")
    fit: list[str] | None = None
    validation: list[str] | None = None
    joint_map: str | None = Field(
        None, description="a joint map's name or file; default: found by the joints' names"
    )

    def files(self, use: str) -> list[Path]:
        """Return the recordings for ``use``, one of ``splits.USES``.

        Raises:
            ConfigError: a file is missing, or nothing is left.
        """
        own = {"fit": self.fit, "validation": self.validation}.get(use)
        if own is not None:
            found = [path for pattern in own for path in self._matching(pattern)]
            if not found:
                raise ConfigError(f"data.{use}: names no recording; name at least one")
            return found
        return [in_pack(self.root, name) for name in split(use, self.splits)]

    def _matching(self, pattern: str) -> list[Path]:
        if Path(pattern).is_absolute():
            return [Path(pattern)]
        try:
            found = sorted(self.root.glob(pattern))
        except (ValueError, IndexError) as error:  # "", ".", and "**x" before 3.13
            raise ConfigError(
                f"data: '{pattern}' is neither a file nor a pattern such as 'walking_*.npz'; "
                f"correct it"
            ) from error
        if not found:
            raise ConfigError(f"data: nothing matches '{pattern}' in {self.root}; check both")
        return found


class DataSettings(RecordingsSettings):
    """``data:`` of a training configuration with ``judgement: real``."""

    weights: dict[str, Annotated[float, Field(ge=0, le=1e6)]] = Field(
        default_factory=dict,
        description="relative frequency with which an action is drawn; default: 1",
    )
    augment: AugmentSettings = Field(default_factory=AugmentSettings)
    bodies: BodySettings = Field(default_factory=BodySettings)
    trackers: TrackerSettings = Field(default_factory=TrackerSettings)
    refit: bool = Field(
        False, description="also fit the validation recordings, once the epoch has been chosen"
    )


class MotionSamples:
    """Windows of ``BODY`` joints; see ``samples.SampleSource``.

    Raises:
        ConfigError: a recording is missing, or is in both lists; or nothing is left to fit or to
            validate.
        RecordingError: a recording cannot be read, or nothing can be learnt from it.
    """

    settings_model = DataSettings

    @classmethod
    def opened(cls, data: DataSettings, **steps: Any) -> "MotionSamples":
        """Open the recordings; ``steps`` are those of ``Shape``."""
        return cls(data, Shape(skeleton=BODY, **steps))

    def __init__(self, settings: DataSettings, shape: Shape) -> None:
        if shape.skeleton is not BODY:
            raise ValueError("recordings are read as BODY")
        self.shape = shape
        self._settings = settings
        _refuse_in_both(settings)
        fit, validation = ([t for f in settings.files(use) for t in self._read(f)] for use in _USES)
        self._tracks, self._validation = (
            (fit + validation, []) if settings.refit else (fit, validation)
        )
        self.actions = tuple(sorted({t.action for t in (*self._tracks, *self._validation)}))
        self._clips = Clips(self._tracks)
        self._checks: list[Samples] | None = None
        self._cumulative = np.cumsum(self._shares())
        if not settings.refit and next(self.validation(), None) is None:
            raise ConfigError(
                f"data.validation: no recording lasts {self._least_validation_s:g} s; longer ones "
                f"are needed"
            )

    @property
    def _least_s(self) -> float:
        """Minimum duration of a motion from which a window is cut, in seconds."""
        return (_LEAST_HISTORY + _LEAST_FUTURE) / self.shape.rate_hz

    @property
    def _least_validation_s(self) -> float:
        return (ORIGIN_STEPS - 1 + _LEAST_FUTURE) / self.shape.rate_hz

    def _read(self, path: Path) -> tuple[Track, ...]:
        """Return every person of a recording, which must have a window.

        A recording that is shorter than a window only gives a warning.

        Raises:
            RecordingError: it is long enough, but has no window; or its rate is too low.
        """
        own = self._settings.joint_map
        tracks = read_tracks(path, None if own is None else load_joint_map(own))
        rate_hz = min((t.rate_hz for t in tracks), default=_LEAST_RATE_HZ)
        if rate_hz < _LEAST_RATE_HZ:
            raise RecordingError(
                f"recording {path}: {rate_hz:g} frames per second say too little about motion; "
                f"give one of at least {_LEAST_RATE_HZ:g}, or leave it out"
            )
        if not any(self._usable_s(t) > 0 for t in tracks):
            if not tracks or max(map(_span_s, tracks)) > self._least_s:
                raise RecordingError(
                    f"recording {path}: no person is observed for {self._least_s:g} s in it, "
                    "within "
                    f"{MAX_COORDINATE_M:g} m of its origin; correct it, or leave it out"
                )
            log.warning("recording %s: shorter than %g s, left out", path, self._least_s)
        return tracks

    def _usable_s(self, track: Track) -> float:
        """Return the total time (s) in which a window with observed joints may end.

        A time is observed if it lies between adjacent captures of one joint. A window bridges a
        pause shorter than itself, so only longer pauses are left out.
        """
        stamps, least = track.stamps_ns, self._least_s
        both = (track.observed[1:] & track.observed[:-1]).any(1)
        both &= np.diff(stamps) <= track.max_gap_s * 1e9
        if 1e-9 * float(np.diff(stamps)[both].sum()) < least:
            return 0.0
        seen = stamps[np.append(both, False) | np.append(False, both)]
        pauses = 1e-9 * np.diff([stamps[0], *seen, stamps[-1]])
        return max(0.0, _span_s(track) - least - float(pauses[pauses > least].sum()))

    def _shares(self) -> NDArray[np.float64]:
        """Return the probability of each track; they add up to 1."""
        usable = [self._usable_s(track) for track in self._tracks]
        if not sum(usable) > 0:
            raise ConfigError(
                f"data: no recording lasts {self._least_s:g} s; longer ones are needed"
            )
        weights, known = self._settings.weights, sorted({t.action for t in self._tracks})
        # a user's recordings may show other actions than the shipped configurations name
        absent = sorted(weights.keys() - set(self.actions))
        if absent:
            log.warning(
                "data.weights: no effect for %s; the recordings show %s",
                ", ".join(absent), ", ".join(known),
            )  # fmt: skip
        share = np.zeros(len(usable))
        for k, track in enumerate(self._tracks):
            same = sum(
                s for s, t in zip(usable, self._tracks, strict=True) if t.action == track.action
            )
            share[k] = weights.get(track.action, 1.0) * usable[k] / max(same, 1e-9)
        if not share.sum() > 0:
            raise ConfigError("data.weights: all fitted actions have 0; give an action more than 0")
        return share / share.sum()

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
        """Draw windows: action, recording, phase, speed, body and tracker at random."""
        settings, augment, clips = self._settings, self._settings.augment, self._clips
        chosen = np.searchsorted(self._cumulative, rng.random(size), side="right")
        chosen = np.minimum(chosen, len(self._tracks) - 1)
        speed = np.exp(rng.uniform(-1, 1, size) * np.log1p(augment.warp))
        # recordings show people on the move; near a robot they often sit or stand
        speed *= np.where(rng.random(size) < augment.slow, rng.random(size), 1.0)
        backwards = rng.random(size) < augment.reverse
        origin = self._origins(rng, chosen, speed, backwards)
        played = Played(
            chosen=chosen,
            origin=origin,
            speed=np.where(backwards, -speed, speed),
            period_s=draw_periods(settings.trackers, rng, clips.period_s[chosen] / speed),
        )
        times, captured, seen = played.captures(clips, self.shape)
        ahead, known = played.future(clips, self.shape)
        positions, observed = np.concatenate([captured, ahead], 1), np.concatenate([seen, known], 1)
        positions = draw_bodies(settings.bodies, rng, size).worn(positions, observed)
        positions, observed = move(augment, rng, positions, observed)
        newest = times.shape[1]
        captured, seen = positions[:, :newest], observed[:, :newest]
        past, past_known = played.resampled(times, captured, seen, self.shape)
        captured = captured + draw_noise(settings.trackers, rng, times, captured.shape[2])
        seen = seen & ~draw_lost(settings.trackers, rng, size, newest)[..., None]
        history, held = played.resampled(times, captured, seen, self.shape)
        hide_by_convention(settings.trackers, rng, held)
        disturb(augment, rng, history, held)
        known = observed[:, newest:]
        return self._samples(
            history=np.where(held[..., None], history, np.float32(0)),
            observed=held,
            future=np.where(known[..., None], positions[:, newest:], np.float32(0)),
            known=known,
            chosen=chosen,
            past=np.where(past_known[..., None], past, np.float32(0)),
            past_known=past_known,
        )

    def _origins(
        self,
        rng: np.random.Generator,
        chosen: NDArray[np.intp],
        speed: NDArray[np.float64],
        backwards: Bools,
    ) -> NDArray[np.intp]:
        """(B,) captures with some steps of history before them, and of future after them."""
        first, last = self._clips.first_s[chosen], self._clips.last_s[chosen]
        before, after = (
            np.where(backwards, reversed_, usual) / self.shape.rate_hz * speed
            for usual, reversed_ in (
                (_LEAST_HISTORY, _LEAST_FUTURE),
                (_LEAST_FUTURE, _LEAST_HISTORY),
            )
        )
        begin = first + before
        end = np.maximum(begin, last - after)
        return self._clips.capture_at(begin + rng.random(len(chosen)) * (end - begin))

    def validation(self) -> Iterator[Samples]:
        """Yield every second step of every validation recording, unaugmented; a refit has none."""
        if not self._validation:
            return
        if self._checks is None:
            self._checks = list(self._cut_validation())
        yield from self._checks

    def _cut_validation(self) -> Iterator[Samples]:
        clips, rate = Clips(self._validation), self.shape.rate_hz
        chosen, origins = [], []
        for k in range(len(self._validation)):
            begin = clips.first_s[k] + (ORIGIN_STEPS - 1) / rate  # and see _least_validation_s
            times = np.arange(begin, clips.last_s[k] - _LEAST_FUTURE / rate + 1e-9, 2 / rate)
            captures = np.unique(clips.capture_at(times))
            chosen.append(np.full(captures.size, k))
            origins.append(captures)
        which, where = np.concatenate(chosen), np.concatenate(origins)
        for at in range(0, which.size, _VALIDATION_BATCH):
            part = slice(at, at + _VALIDATION_BATCH)
            own = which[part]
            played = Played(
                chosen=own,
                origin=where[part],
                speed=np.ones(own.size),
                period_s=clips.period_s[own],
            )
            history, observed = played.resampled(*played.captures(clips, self.shape), self.shape)
            future, known = played.future(clips, self.shape)
            yield self._samples(
                history=np.where(observed[..., None], history, np.float32(0)),
                observed=observed,
                future=future,
                known=known,
                chosen=own,
                tracks=self._validation,
            )

    def _samples(
        self,
        *,
        chosen: NDArray[np.intp],
        tracks: Sequence[Track] | None = None,
        **arrays: NDArray[np.float32] | Bools,
    ) -> Samples:
        tracks = self._tracks if tracks is None else tracks
        actions = torch.tensor([self.actions.index(tracks[k].action) for k in chosen])
        made = {k: torch.from_numpy(np.ascontiguousarray(a)) for k, a in arrays.items()}
        return Samples(actions=actions, **made)


def _span_s(track: Track) -> float:
    return float(track.stamps_ns[-1] - track.stamps_ns[0]) * 1e-9


def _refuse_in_both(settings: DataSettings) -> None:
    """Refuse a recording that is both fitted and used for validation."""
    fit, validation = ({f.resolve() for f in settings.files(use)} for use in _USES)
    for path in sorted(fit & validation):
        raise ConfigError(
            f"data: {path} is both in fit and in validation; take it out of one of them"
        )
