"""A small network, people to train it on, and a run of it."""

import numpy as np
import torch
from torch import nn

from hri_predict.lab.training import loop
from hri_predict.lab.training.checkpoint import load_checkpoint
from hri_predict.lab.training.config import TrainingConfig
from hri_predict.lab.training.windows.samples import Samples
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import (
    Network,
    NetworkOptions,
    Shape,
    last_pose,
    mpjpe,
)

SHAPE = Shape(skeleton=BODY, history_steps=4, horizon_steps=3, rate_hz=25.0)


class Options(NetworkOptions):
    width: int = 8
    dropout: float = 0.0
    critic: bool = False
    blow_up_at: float = 2.0


class Small(Network):
    """One hidden layer over time, the same for every joint and axis."""

    options_model = Options
    options: Options
    seen: torch.Tensor

    def __init__(self, shape, options):
        super().__init__(shape)
        self.options = options
        self.layers = nn.Sequential(
            nn.Linear(shape.history_steps, options.width),
            nn.Tanh(),
            nn.Dropout(options.dropout),
            nn.Linear(options.width, shape.horizon_steps),
        )
        self.critic = nn.Linear(shape.horizon_steps, 1) if options.critic else None
        self.register_buffer("seen", torch.zeros(()))

    def forward(self, window):
        if self.training:
            self.seen += 1
        residual = self.layers((window.positions - last_pose(window)).movedim(1, -1))
        return last_pose(window) + residual.movedim(-1, 1)

    def losses(self, window, target, progress):
        scale = float("nan") if progress >= self.options.blow_up_at else 1.0
        return {"position": scale * mpjpe(self(window), target)}

    def critic_loss(self, window, target, progress):
        if self.critic is None or progress < 0.5:
            return None
        fake = self.critic(self(window).detach().movedim(1, -1))
        return fake.mean() - self.critic(target.positions.movedim(1, -1)).mean()

    def critic_parameters(self):
        return iter(()) if self.critic is None else self.critic.parameters()


class Walkers:
    """People who drift at a constant velocity of their own."""

    shape = SHAPE
    actions: tuple[str, ...] = ("walking", "standing")

    def __init__(self, validates=True):
        self._validates = validates

    def rest(self):
        return torch.linspace(0, 1, 84).view(28, 3)

    def batch(self, rng, size):
        steps = np.arange(SHAPE.history_steps + SHAPE.horizon_steps)[:, None, None]
        actions = rng.integers(0, 2, size)
        start = rng.normal(size=(size, 1, 28, 3))
        velocity = rng.normal(size=(size, 1, 1, 3)) * 0.05 * (actions == 0)[:, None, None, None]
        positions = torch.from_numpy(start + velocity * steps).float()
        seen = torch.from_numpy(rng.random((size, 7, 28)) < 0.9)
        past = SHAPE.history_steps
        return Samples(
            history=positions[:, :past],
            observed=seen[:, :past],
            future=positions[:, past:],
            known=seen[:, past:],
            actions=torch.from_numpy(actions),
        )

    def validation(self):
        rng = np.random.default_rng(99)
        yield from (self.batch(rng, 32) for _ in range(2 if self._validates else 0))


class Watcher:
    def __init__(self):
        self.start = None
        self.losses = []
        self.epochs = []

    def started(self, step, total_steps):
        self.start = (step, total_steps)

    def stepped(self, step, loss):
        self.losses.append(loss)

    def ended_epoch(self, epoch):
        self.epochs.append(epoch)


def make_config(out, options=None, **train):
    settings = {"epochs": 4, "windows_per_epoch": 64, "batch": 16, "learning_rate": 0.02,
                "warmup": 0.05}  # fmt: skip
    return TrainingConfig.model_validate(
        {
            "predictor": "small", "judgement": "real", "out": out, "options": options or {},
            "shape": {"history_steps": 4, "horizon_steps": 3}, "train": settings | train,
        }
    )  # fmt: skip


def run(out, options=None, resume=False, source=None, stop=None, **train):
    config = make_config(out, options, **train)
    source, view = source or Walkers(), Watcher()
    torch.manual_seed(config.train.seed)
    network = Small(SHAPE, Options(**config.options))
    network.rest.copy_(source.rest())
    more = {} if stop is None else {"stop": stop}
    result = loop.Run(config, source, network, view, **more).go(resume)
    return network, result, view


def same(a, b):
    return all(torch.equal(x, y) for x, y in zip(a.values(), b.values(), strict=True))


def checkpoint(out):
    return load_checkpoint(out / "last.pt")
