"""Recordings in one array: captures as a node gets them, and the true motion at any time."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools
from hri_predict.lab.datasets.tracks import Track


class Clips:
    """All tracks in one array.

    Times are in seconds; each track has its own time range, far from those of all other tracks.

    Attributes:
        positions: (F, J, 3) metres, float32.
        observed: (F, J).
        stamps: (F,) times of the captures.
        first_s: (N,) time of each track's first capture.
        last_s: (N,) time of each track's last capture.
        period_s: (N,) nominal time between captures.
    """

    def __init__(self, tracks: Sequence[Track]) -> None:
        self.positions = np.concatenate([t.positions for t in tracks]).astype(np.float32)
        self.observed = np.concatenate([t.observed for t in tracks])
        lengths = np.array([len(t.stamps_ns) for t in tracks])
        self._begin = np.concatenate([[0], np.cumsum(lengths)[:-1]])
        self._last = self._begin + lengths - 1
        self._max_gap_s = np.array([t.max_gap_s for t in tracks])
        self.period_s = np.array([1 / t.rate_hz for t in tracks])
        own = [(t.stamps_ns - t.stamps_ns[0]) * 1e-9 for t in tracks]
        # every track starts a day (or the longest track's length) after the one before it, so that
        # one search finds frames in all of them
        apart_s = max(86400.0, 1.0 + max(s[-1] for s in own))
        self.first_s = np.arange(len(tracks)) * apart_s
        self.stamps = np.concatenate([s + f for s, f in zip(own, self.first_s, strict=True)])
        self.last_s = self.stamps[self._last]
        self._seen = np.flatnonzero(self.observed.any(1))

    def capture_at(self, times: NDArray[np.float64]) -> NDArray[np.intp]:
        """(B,) index of the newest capture with observed joints up to each time.

        For a time before a track's first such capture, it is that capture.
        """
        seen = self.stamps[self._seen]
        newest = np.searchsorted(seen, times + 1e-9, side="right") - 1
        track = np.searchsorted(self.first_s, times + 1e-9, side="right") - 1
        oldest = np.searchsorted(seen, self.first_s[track])
        return self._seen[np.clip(np.maximum(newest, oldest), 0, len(self._seen) - 1)]

    def captures(
        self, chosen: NDArray[np.intp], index: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float32], Bools]:
        """Captures by their index (B, M).

        Returns:
            Times (B, M), positions (B, M, J, 3), and whether each joint is observed (B, M, J);
            nothing outside the track ``chosen`` (B,) is observed.
        """
        low, high = self._begin[chosen][:, None], self._last[chosen][:, None]
        inside = (index >= low) & (index <= high)
        index = np.clip(index, low, high)
        seen = self.observed.take(index, axis=0) & inside[..., None]
        return self.stamps[index], self.positions.take(index, axis=0), seen

    def at(
        self, chosen: NDArray[np.intp], times: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], Bools]:
        """The truth: (B, S, J, 3) positions at (B, S) times, and (B, S, J) where they are known.

        Linear between captures, later ones included: no input of a predictor.
        """
        after = np.searchsorted(self.stamps, times.ravel(), side="right").reshape(times.shape)
        low, high = self._begin[chosen][:, None], self._last[chosen][:, None]
        inside = (times >= self.stamps[low] - 1e-9) & (times <= self.stamps[high] + 1e-9)
        before = np.clip(after - 1, low, high)
        after = np.clip(after, low, high)
        gap = self.stamps[after] - self.stamps[before]
        weight = np.clip((times - self.stamps[before]) / np.where(gap > 0, gap, 1.0), 0, 1)
        near = np.where(weight < 0.5, before, after)
        share = weight.astype(np.float32)[..., None, None]
        start = self.positions.take(before, axis=0)
        positions = start + share * (self.positions.take(after, axis=0) - start)
        seen = self.observed.take(before, axis=0) & self.observed.take(after, axis=0)
        on_frame = np.abs(times - self.stamps[near]) < 1e-6
        seen = np.where(on_frame[..., None], self.observed.take(near, axis=0), seen)
        adjacent = gap <= self._max_gap_s[chosen][:, None]
        seen &= (inside & (adjacent | on_frame))[..., None]
        return np.where(seen[..., None], positions, np.float32(0)), seen
