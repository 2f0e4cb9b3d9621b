"""Quality of a network on validation windows: mean per joint position error, millimetres."""

from dataclasses import dataclass
from typing import Any

import torch

from hri_predict.lab.training.processes import Processes
from hri_predict.lab.training.windows.samples import SampleSource
from hri_predict.predictors.neural.network import Network


@dataclass(frozen=True, slots=True)
class Validation:
    """MPJPE over all horizons, at each horizon, and per action; actions have equal weights.

    Milliradians where windows hold rotations instead of positions.

    Attributes:
        mm: mean error, first over each action, then over the actions, millimetres.
        at_mm: the same at each horizon step.
        actions_mm: by action, over all horizons.
    """

    mm: float
    at_mm: list[float]
    actions_mm: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"mpjpe_mm": self.mm, "horizon_mm": self.at_mm, "actions_mm": self.actions_mm}


@torch.no_grad()
def validate(
    network: Network, entry: Network, source: SampleSource, processes: Processes
) -> Validation | None:
    """Evaluate ``network`` on validation windows; ``None`` if they contain nothing known.

    Args:
        network: in evaluation mode, on any device.
        entry: a network on the CPU with the same rest pose; brings windows into body frames.
        source: gives the windows; the processes take turns.
        processes: the processes that share the work; all get the same result.
    """
    device, actions = network.rest.device, source.actions
    horizon = network.shape.horizon_steps
    error = torch.zeros(len(actions), horizon, dtype=torch.float64)
    count = torch.zeros_like(error)
    for turn, batch in enumerate(source.validation()):
        if turn % processes.count != processes.rank:
            continue
        window, target = batch.entered(entry)
        predicted = network(window.to(device))[..., :3].cpu().double()
        distance = (predicted - target.positions.double()).norm(dim=-1)
        known = target.observed
        error.index_add_(0, batch.actions, (distance * known).sum(-1))
        count.index_add_(0, batch.actions, known.sum(-1).double())
    processes.add([error, count])
    seen = count.sum(1) > 0
    if not bool(seen.any()):
        return None
    per_action = 1000.0 * error.sum(1) / count.sum(1)
    at = 1000.0 * error / count  # not a number where an action's futures are all shorter
    return Validation(
        mm=float(per_action[seen].mean()),
        at_mm=[float(v) for v in at.nanmean(0)],
        actions_mm={name: float(per_action[i]) for i, name in enumerate(actions) if seen[i]},
    )
