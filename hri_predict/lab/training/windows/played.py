"""Recordings played at any speed, forwards or backwards, up to a capture: a node's view of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools
from hri_predict.lab.training.windows.clips import Clips
from hri_predict.people.ring_buffer import resample
from hri_predict.predictors.neural.network import Shape

_MAX_GAP_S = 0.1  # as the node's people stage bridges it


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """Windows of played recordings; times are playback times, 0 at the origin.

    Attributes:
        chosen: (B,) number of the recording.
        origin: (B,) index of the capture at which the history ends.
        speed: (B,) playback speed; negative: backwards.
        period_s: (B,) time between the captures that are used.
    """

    chosen: NDArray[np.intp]
    origin: NDArray[np.intp]
    speed: NDArray[np.float64]
    period_s: NDArray[np.float64]

    def captures(
        self, clips: Clips, shape: Shape
    ) -> tuple[NDArray[np.float64], NDArray[np.float32], Bools]:
        """Real captures about ``period_s`` apart, oldest first, the origin last.

        Returns:
            Times (B, M), positions (B, M, J, 3), observed (B, M, J).
        """
        every = np.maximum(self.period_s * np.abs(self.speed) / clips.period_s[self.chosen], 1.0)
        span_s = shape.history_steps / shape.rate_hz + _MAX_GAP_S
        count = int(np.ceil(span_s / self.period_s.min())) + 2
        # captures that are not evenly spaced are taken as they come
        back = np.round(np.arange(count - 1, -1, -1) * every[:, None]).astype(np.intp)
        index = self.origin[:, None] - back * np.sign(self.speed)[:, None].astype(np.intp)
        stamps, positions, observed = clips.captures(self.chosen, index)
        times = (stamps - clips.stamps[self.origin][:, None]) / self.speed[:, None]
        return times, positions, observed

    def resampled(
        self,
        times: NDArray[np.float64],
        positions: NDArray[np.float32],
        observed: Bools,
        shape: Shape,
    ) -> tuple[NDArray[np.float32], Bools]:
        """Histories (B, T, J, 3) and whether each joint is observed, by the node's ring buffer."""
        steps = shape.history_steps
        history = np.empty((len(times), steps, *positions.shape[2:]), np.float32)
        seen = np.empty(history.shape[:3], bool)
        for k, period_s in enumerate(self.period_s):
            there = observed[k].any(1)
            window = resample(
                stamps=np.round(times[k, there] * 1e9).astype(np.int64),
                positions=positions[k, there],
                observed=observed[k, there],
                t_end_ns=0,
                n=steps,
                rate_hz=shape.rate_hz,
                max_gap_ns=round(1e9 * max(_MAX_GAP_S, 2.5 * period_s)),
            )
            history[k], seen[k] = window.positions, window.observed
        return history, seen

    def future(self, clips: Clips, shape: Shape) -> tuple[NDArray[np.float32], Bools]:
        """The truth (B, H, J, 3) that follows, and (B, H, J) where it is known."""
        steps = np.arange(1, shape.horizon_steps + 1) / shape.rate_hz
        start = clips.stamps[self.origin][:, None]
        return clips.at(self.chosen, start + steps * self.speed[:, None])
