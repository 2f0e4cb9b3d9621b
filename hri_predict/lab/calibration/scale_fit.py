"""Fits the learned scale to the errors of a predictor on recordings that it was not fitted on.

The network learns the quantile ``QUANTILE`` of the logarithm of the error (R. Koenker, G. Bassett,
"Regression Quantiles", Econometrica 46 (1978) 33: the pinball loss). Every recording weighs about
the same, whatever its length. The recordings are divided into ``FOLDS``: the errors of a
recording are compared with the scale of a network that has not seen it (``cross_scales``), so the
factors on the scale (``conformal``) are as valid as if these recordings were new. The network that
is shipped is fitted to all.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import nn

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.skeleton import Skeleton
from hri_predict.base.work.workers import ThisProcess, Workers
from hri_predict.lab.calibration.scores import Scores, evidence_of, units
from hri_predict.zones.learned_scale import (
    AHEAD,
    BEYOND,
    KINDS,
    NOW,
    Evidence,
    LearnedScale,
    ScaleNetwork,
    inputs_ahead,
    inputs_now,
    kind_of,
    knots_within,
)

QUANTILE = 0.95
FOLDS = 5
HIDDEN = 64
STEPS = 2000
BATCH = 4096
WINDOWS = 300
"""Maximum number of windows used of a recording."""
_LEAST_ERROR_M = 0.003
_RATE, _DECAY = 3e-3, 1e-3


class _Rows:
    """Inputs and errors of chosen windows, one row per window, knot and joint."""

    def __init__(self, scores: Sequence[Scores], rate_hz: float, skeleton: Skeleton) -> None:
        rng = np.random.default_rng(0)
        self.knots = knots_within(scores[0].error_m.shape[1])
        self.kind = torch.tensor(kind_of(skeleton).copy())
        now, ahead, error, unit = [], [], [], []
        by_name = units(scores)
        self.names = _mixed(scores)  # their order, not that of the scores, decides what is drawn
        for index, name in enumerate(self.names):
            own = by_name[name]
            share = WINDOWS / max(sum(len(scores[i].origin_ns) for i in own), 1)
            for i in own:
                chosen = rng.random(len(scores[i].origin_ns)) < share
                if not chosen.any():
                    continue
                known = _some(evidence_of(scores[i]), chosen)
                now.append(inputs_now(known, rate_hz, skeleton))
                ahead.append(inputs_ahead(known, self.knots, rate_hz))
                error.append(scores[i].error_m[chosen][:, self.knots - 1])
                unit.append(np.full(int(chosen.sum()), index))
        self.now = torch.tensor(np.concatenate(now), dtype=torch.float32)
        self.ahead = torch.tensor(np.concatenate(ahead), dtype=torch.float32)
        self.error = torch.tensor(np.concatenate(error), dtype=torch.float32)
        self.unit: Ints = np.concatenate(unit)

    def normal(self, windows: Ints) -> tuple[Floats, Floats]:
        """Mean and standard deviation of the inputs of some windows."""
        now, ahead = self.now[windows], self.ahead[windows]
        parts = [now.reshape(-1, len(NOW)), ahead.reshape(-1, len(AHEAD))]
        mean = np.concatenate([p.mean(0).numpy() for p in parts]).astype(np.float64)
        deviation = np.concatenate([p.std(0).numpy() for p in parts]).astype(np.float64)
        return mean, np.maximum(deviation, 1e-3)


def _some(evidence: Evidence, chosen: Bools) -> Evidence:
    return Evidence(
        **{
            name: known[chosen]
            for name in Evidence.__dataclass_fields__
            if (known := getattr(evidence, name)) is not None
        }
    )


def cross_scales(
    scores: Sequence[Scores],
    rate_hz: float,
    skeleton: Skeleton,
    *,
    on_fit: Callable[[str], None] = lambda _: None,
    workers: Workers | None = None,
) -> tuple[ScaleNetwork, list[Floats]]:
    """Return the network fitted to all, and each entry's scales (W, H, J).

    An entry's scales come from a network that was not fitted to its recording.

    Args:
        on_fit: called with a description before each fit, which takes a minute or more.
        workers: workers that fit; default: this process.
        scores, rate_hz, skeleton: see ``conformal.calibrate``.
    """
    if any(entry.std is None for entry in scores):  # what is stated at times cannot be relied on
        scores = [replace(entry, std=None) for entry in scores]
    rows = _Rows(scores, rate_hz, skeleton)
    fold_of = {name: k % FOLDS for k, name in enumerate(rows.names)}
    of_unit = np.array([fold_of[name] for name in rows.names])
    folds = min(FOLDS, len(fold_of))
    steps = scores[0].error_m.shape[1]
    chosen = [np.arange(len(rows.unit))]
    chosen += [np.flatnonzero(of_unit[rows.unit] != fold) for fold in range(folds)]
    begun = 1
    on_fit(f"fitting the scale, 1 of {1 + folds}")

    def on_done() -> None:
        nonlocal begun
        begun += 1
        if begun <= 1 + folds:
            on_fit(f"fitting the scale, {begun} of {1 + folds}")

    fits = (workers or ThisProcess()).in_order(_fitted, [(rows, c) for c in chosen], on_done)
    network = fits[0]
    found: list[Floats] = [np.zeros(0)] * len(scores)
    for fold, fitted in enumerate(fits[1:]):
        own = LearnedScale(fitted, skeleton, rate_hz, steps)
        for i, entry in enumerate(scores):
            if fold_of[entry.name] == fold:
                found[i] = own(evidence_of(entry))
    return network, found


def _mixed(scores: Sequence[Scores]) -> list[str]:
    """Names of the recordings, ordered by action, so that each fold gets a part of each action."""
    action = {entry.name: entry.action for entry in scores}
    return sorted(action, key=lambda name: (action[name], name))


def _fitted(rows: _Rows, windows: Ints) -> ScaleNetwork:
    """Fit a network; the same rows give the same network on the same machine."""
    mean, deviation = rows.normal(windows)
    centre, spread = (torch.tensor(v, dtype=torch.float32) for v in (mean, deviation))
    generator = torch.Generator().manual_seed(0)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        width = len(NOW) + len(AHEAD) + len(KINDS)
        net = nn.Sequential(
            nn.Linear(width, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
            nn.Linear(HIDDEN, 1),
        )  # fmt: skip
    optimiser = torch.optim.AdamW(net.parameters(), _RATE, weight_decay=_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    chosen = torch.tensor(windows)
    kinds = torch.eye(len(KINDS))
    joints = torch.nonzero(rows.kind >= 0)[:, 0]
    for _ in range(STEPS):
        w = chosen[torch.randint(len(chosen), (BATCH,), generator=generator)]
        k = torch.randint(len(rows.knots), (BATCH,), generator=generator)
        j = joints[torch.randint(len(joints), (BATCH,), generator=generator)]
        error = rows.error[w, k, j]
        known = torch.isfinite(error)
        w, k, j, error = w[known], k[known], j[known], error[known]
        plain = (torch.cat([rows.now[w, j], rows.ahead[w, k, j]], 1) - centre) / spread
        out = net(torch.cat([plain.clamp(-BEYOND, BEYOND), kinds[rows.kind[j]]], 1))[:, 0]
        short = error.clamp(_LEAST_ERROR_M).log() - out
        loss = torch.maximum(QUANTILE * short, (QUANTILE - 1.0) * short).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    layers = [layer for layer in net if isinstance(layer, nn.Linear)]
    if not rows.ahead[..., AHEAD.index("spread")].any():  # none is stated: its weights are chance
        layers[0].weight.data[:, len(NOW) + AHEAD.index("spread")] = 0.0
    return ScaleNetwork(
        mean=mean,
        deviation=deviation,
        layers=tuple(
            (
                layer.weight.detach().numpy().T.astype(np.float64),
                layer.bias.detach().numpy().astype(np.float64),
            )
            for layer in layers
        ),
    )
