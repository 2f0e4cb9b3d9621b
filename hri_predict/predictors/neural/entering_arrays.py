"""``entering`` with torch's operations, for use without numba."""

import numpy as np
import torch

from hri_predict.base.arrays import Floats
from hri_predict.predictors.masked import at_step, last_observed
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.body_frame import BodyFrame, body_frame, fill
from hri_predict.predictors.neural.windows import Entered, Histories, Singles, Tables


def enter_arrays(histories: Histories, tables: Tables) -> Entered:
    """Bring histories into the people's own frames, and fill what was not observed."""
    there = tables.given >= 0
    body = np.zeros((*histories.observed.shape[:2], len(there), 3))
    observed = np.zeros(body.shape[:3], dtype=bool)
    body[:, :, there] = histories.positions[:, :, tables.given[there]]
    observed[:, :, there] = histories.observed[:, :, tables.given[there]]
    positions, seen = torch.from_numpy(body), torch.from_numpy(observed)
    with torch.inference_mode():
        frame = body_frame(positions, seen, BODY)
        clean = torch.where(seen[..., None], frame.enter(positions), 0.0)
        rest, nearest = torch.from_numpy(tables.rest), torch.from_numpy(tables.nearest)
        window = fill(clean, seen, rest, nearest).float().numpy()
    frames = torch.cat([frame.origin, frame.rotation[:, 1, :2]], 1).numpy()
    return Entered(window, observed, frames)


def leave_arrays(
    forecast: Singles, entered: Entered, histories: Histories, tables: Tables
) -> Floats:
    """Bring forecasts (P, H, 28, 3) in the people's frames into the room: (P, H, K, 3), m."""
    left, carried = entered.frames[:, 3:], tables.carried
    rotation = np.zeros((len(left), 3, 3))
    rotation[:, 0, 0], rotation[:, 0, 1] = left[:, 1], -left[:, 0]
    rotation[:, 1, :2], rotation[:, 2, 2] = left, 1.0
    frame = BodyFrame(torch.from_numpy(entered.frames[:, :3]), torch.from_numpy(rotation))
    with torch.inference_mode():
        future, past = (
            frame.leave(torch.from_numpy(each).double()).numpy()
            for each in (forecast, entered.window)
        )
    result: Floats = future[:, :, tables.taken].mean(axis=3)
    step, seen = last_observed(histories.observed[:, :, carried])
    newest = at_step(histories.positions[:, :, carried], step)
    then = at_step(past[:, :, tables.taken[carried]].mean(axis=3), step)
    result[:, :, carried] += np.where(seen[..., np.newaxis], newest - then, 0.0)[:, np.newaxis]
    return result
