"""One step of training: warm-up and schedule, clipped gradients, averaged weights."""

import inspect
import math
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from hri_predict.base.errors import PredictorError
from hri_predict.contracts import registry
from hri_predict.lab.training.config import TrainSettings
from hri_predict.lab.training.parts import part
from hri_predict.lab.training.processes import Processes
from hri_predict.predictors.neural.network import BodyFrames, Network, Target


class Optimisation:
    """The optimisers of a network and the running average of its weights.

    By default AdamW: Loshchilov and Hutter 2019, https://arxiv.org/abs/1711.05101. The average
    (Polyak and Juditsky 1992) forgets faster at first: its decay is at most (1 + n) / (10 + n) at
    step n.

    Attributes:
        network: the network that is trained.
        averaged: a copy with averaged weights, in evaluation mode, to be evaluated and shipped;
            ``network`` itself where ``ema_decay`` is 0.
    """

    def __init__(self, network: Network, settings: TrainSettings, processes: Processes) -> None:
        self.network = network
        self._settings = settings
        self._processes = processes
        processes.same([p.data for p in network.parameters()])
        self._model = list(network.model_parameters())
        self._critic = list(network.critic_parameters())
        self._adam = _optimiser(
            settings, self._model, settings.learning_rate, settings.weight_decay
        )
        self._critic_adam = (
            _optimiser(settings, self._critic, settings.critic_learning_rate, 0.0)
            if self._critic
            else None
        )
        part("schedules", settings.schedule)  # refuses an unknown one before the first step
        self.averaged = network
        self._average: AveragedModel | None = None
        if settings.ema_decay:
            self._average = _averaged(network, settings.ema_decay)
            self.averaged = cast(Network, self._average.module).eval()

    def step(
        self,
        window: BodyFrames,
        target: Target,
        share: float,
        number: int,
        *,
        progress: float,
    ) -> dict[str, float]:
        """Take step ``number`` (from 0) on this process's windows; returns the batch's losses.

        The losses are those of ``Network.losses``, their sum as ``loss``, and an adversary's as
        ``critic``.

        Args:
            window: this process's histories.
            target: their futures.
            share: this process's share of the batch's loss.
            number: number of steps taken before.
            progress: completed share of the training.

        Raises:
            PredictorError: the loss or its gradient is not finite.
        """
        factor = learning_rate_factor(number, self._settings, progress)
        self.network.train()
        shown: dict[str, float] = {}
        if self._critic_adam is not None:
            self._critic_adam.zero_grad()
            with self._precision():
                loss = self.network.critic_loss(window, target, progress)
            if loss is not None:
                shown |= self._descend(
                    self._critic_adam,
                    self._critic,
                    {"critic": loss * share},
                    number=number,
                    factor=factor,
                )
        self._adam.zero_grad()  # also clears the critic's gradients where it did not detach
        with self._precision():
            losses = self.network.losses(window, target, progress)
        mine = {name: loss * share for name, loss in losses.items()}
        found = self._descend(self._adam, self._model, mine, number=number, factor=factor)
        shown |= found | {"loss": sum(found.values())}
        if self._average is not None:
            self._average.update_parameters(self.network)
        return shown

    def _precision(self) -> torch.autocast:
        """Products in bfloat16 where the settings ask for it; sums and weights stay float32."""
        lower = self._settings.precision == "bfloat16"
        return torch.autocast(self._settings.device, torch.bfloat16, enabled=lower)

    def _descend(
        self,
        adam: torch.optim.Optimizer,
        parameters: list[nn.Parameter],
        losses: dict[str, Tensor],
        *,
        number: int,
        factor: float,
    ) -> dict[str, float]:
        parts = torch.stack(list(losses.values()))
        parts.sum().backward()
        shown = parts.detach()
        gradients = [p.grad for p in parameters if p.grad is not None]
        self._processes.add([*gradients, shown])
        norm = torch.nn.utils.get_total_norm(gradients)
        if not math.isfinite(float(shown.sum() + norm)):
            bad = [k for k, v in zip(losses, shown, strict=True) if not math.isfinite(v)]
            what = f"loss '{bad[0]}'" if bad else "gradient"
            raise PredictorError(
                f"training step {number}: the {what} is not finite; lower train.learning_rate, or "
                f"look for wrong positions in the data"
            )
        torch.nn.utils.clip_grads_with_norm_(parameters, self._settings.clip_norm, norm)
        for group in adam.param_groups:
            group["lr"] = factor * group["full_lr"]
        adam.step()
        return dict(zip(losses, shown.tolist(), strict=True))

    @torch.no_grad()
    def settle(self) -> Network:
        """Return ``averaged`` for evaluation, with the newest buffers of the first process."""
        buffers = list(self.network.buffers())
        self._processes.same(buffers)
        if self.averaged is not self.network:
            for average, newest in zip(self.averaged.buffers(), buffers, strict=True):
                average.copy_(newest)
        return self.averaged.eval()

    def state(self) -> dict[str, Any]:
        """Everything that the next step depends on, for a checkpoint."""
        return {
            "network": self.network.state_dict(),
            "averaged": self.averaged.state_dict(),
            "adam": self._adam.state_dict(),
            "critic_adam": self._critic_adam.state_dict() if self._critic_adam else None,
        }

    def restore(self, state: dict[str, Any], number: int) -> None:
        """Continue from the ``state`` saved after ``number`` steps.

        Raises:
            ValueError: it does not fit this network and these settings, or is not finite. Other
                errors come from torch.
        """
        self.averaged.load_state_dict(state["averaged"])
        self.network.load_state_dict(state["network"])
        if not all(bool(t.isfinite().all()) for t in self.network.state_dict().values()):
            raise ValueError("a weight is not finite")
        _restore(self._adam, state["adam"])
        if self._critic_adam is not None:
            _restore(self._critic_adam, state["critic_adam"])
        if self._average is not None:
            self._average.n_averaged.fill_(number + 1)


def _restore(adam: torch.optim.Optimizer, state: dict[str, Any]) -> None:
    """Load an optimiser's state; torch checks neither its settings nor the shapes.

    Raises:
        ValueError: it is the state of another optimiser, or damaged.
    """
    own = adam.state_dict()["param_groups"]
    for ours, theirs in zip(own, state["param_groups"], strict=True):
        if ours | {"lr": 0.0} != theirs | {"lr": 0.0}:  # the schedule sets it at each step
            raise ValueError("an optimiser has other settings")
    adam.load_state_dict(state)
    for parameter, moments in adam.state.items():
        for value in moments.values():
            fits = value.dim() == 0 or value.shape == parameter.shape
            if not fits or not bool(value.isfinite().all()):
                raise ValueError("an optimiser's state does not fit its network")


def learning_rate_factor(number: int, settings: TrainSettings, progress: float) -> float:
    """Share of the learning rate at step ``number``: linear warm-up times the schedule.

    ``progress``: completed share of the training.
    """
    warm = min(1.0, (number + 1) / (settings.warmup_steps + 1))
    return warm * float(part("schedules", settings.schedule)(settings, progress))


def _averaged(network: Network, most: float) -> AveragedModel:
    """The running average of a network's weights, starting with the present ones.

    After step n (from 0) the average has seen n + 1 networks.
    """

    @torch.no_grad()
    def lerp(averages: Any, weights: Any, seen: Tensor | int) -> None:
        decay = min(most, int(seen) / (9 + int(seen)))
        torch._foreach_lerp_(averages, weights, 1.0 - decay)

    average = AveragedModel(network, multi_avg_fn=lerp)
    average.update_parameters(network)
    return average


def _optimiser(
    settings: TrainSettings, parameters: list[nn.Parameter], rate: float, decay: float
) -> torch.optim.Optimizer:
    """The optimiser; its weight decay leaves vectors (biases, scales of norms) alone."""
    groups = [
        {"params": [p for p in parameters if p.dim() >= 2], "weight_decay": decay},
        {"params": [p for p in parameters if p.dim() < 2], "weight_decay": 0.0},
    ]
    kept = [group | {"full_lr": rate} for group in groups if group["params"]]
    name = settings.optimiser
    kind = part("optimisers", name)
    with registry.calling(f"optimiser '{name}' cannot be built", "correct it, or use adamw"):
        # torch's own differ: RMSprop has no fused form
        fused = {"fused": True} if "fused" in inspect.signature(kind).parameters else {}
        made: torch.optim.Optimizer = kind(kept, lr=rate, **fused)
    return made
