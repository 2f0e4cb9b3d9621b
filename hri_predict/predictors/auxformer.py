"""AuxFormer: a transformer over coordinates that also learns to fill in and to clean its input.

Xu, Tan, Tan, Chen, Wang, Wang: "Auxiliary Tasks Benefit 3D Skeleton-based Human Motion Prediction",
ICCV 2023. Every coordinate (a joint at a step) is one token. Layers alternate between attention
among the observed tokens and attention among all tokens, each in space (the joints of a step), then
in time (the steps of a joint). Besides the future, the network learns to recover hidden coordinates
and to clean noisy ones; prediction uses neither of these tasks.

The method's strength is how it treats unobserved joints: their tokens hold a learnt vector instead
of a coordinate, and observed-only attention skips them. Filled-in values are not read.

Where this differs from the paper, and why:

- As printed, the softmax is taken over all keys, multiplied by the mask, and not normalised again.
  Weights would then no longer sum to one, and hidden tokens would still receive weight. Here the
  softmax is taken over the observed keys, and unobserved tokens keep their features.
- The paper specifies neither normalisation nor activation. Here features are normalised before each
  attention (pre-norm), and the FFN has one hidden layer with ReLU.
- Heads return the difference from the filled-in input (for the future: from its last pose), so an
  untrained network predicts zero velocity. The encoder reads a coordinate and its difference from
  that last pose. The paper's heads return coordinates, and its encoder reads coordinates.
- The shipped weights were trained with ``velocity: true`` and ``scale: features``, which are not
  the defaults.
- ``velocity: true`` also gives each token its joint's displacement from the previous frame, or zero
  where either frame is hidden, so no hidden value is read. The paper does not mention this. The
  authors' code (https://github.com/MediaBrain-SJTU/AuxFormer) has such a switch, ``concat_vel``,
  but leaves it off for CMU.
- With ``scale: features``, attention's products are divided by the square root of F, the width of
  all features, as printed in section 4.2. By default they are divided by the square root of a
  head's width, as is usual.
- For speed, ``future_stride`` steps of the future share a token whose head predicts them all. The
  auxiliary tasks leave the future out and use half of each batch. ``future_stride: 1``,
  ``auxiliary_future: true`` and ``auxiliary_share: 1`` give the paper's version.
"""

import math
from collections.abc import Callable
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from hri_predict.predictors.auxformer_attention import AuxFormerOptions, Layer
from hri_predict.predictors.auxformer_lean import lean
from hri_predict.predictors.neural.body_frame import fill
from hri_predict.predictors.neural.network import (
    DECIMETRES,
    BodyFrames,
    Network,
    Shape,
    Target,
    mpjpe,
)
from hri_predict.predictors.neural.predictor import NeuralPredictor


class AuxFormer(Network):
    """Auxiliary-adapted transformer (section 4) with its three heads (Eq. 1)."""

    options_model = AuxFormerOptions
    exportable = True
    options: AuxFormerOptions

    def __init__(self, shape: Shape, options: AuxFormerOptions) -> None:
        super().__init__(shape)
        self.options = options
        size, stride = options.features, options.future_stride
        self.future_tokens = -(-shape.horizon_steps // stride)
        self.coordinate = nn.Linear(9 if options.velocity else 6, size)  # Eq. 2a
        self.joint = _dictionary(shape.joints, size)  # Eq. 2b
        self.step = _dictionary(shape.history_steps + self.future_tokens, 1, size)
        self.hidden = _dictionary(size)
        observed_only = options.layers if options.observed_attention else 0
        self.observed_layers = nn.ModuleList(Layer(options) for _ in range(observed_only))
        self.full_layers = nn.ModuleList(Layer(options) for _ in range(options.layers))
        self.norm = nn.LayerNorm(size)
        self.predict = _head(size, 3 * stride)
        self.unmask = _head(size, 3) if options.masking else None
        self.denoise = _head(size, 3) if options.denoising else None
        masks_future = options.masking and options.auxiliary_future
        self.unmask_future = _head(size, 3 * stride) if masks_future else None

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3) in the body frame; only observed coordinates are read."""
        return self.forward_filled(BodyFrames(self._filled(window), window.observed))

    def lean(self) -> Callable[[BodyFrames], Tensor]:
        """See ``auxformer_lean``."""
        return lean(self)

    def forward_filled(self, window: BodyFrames) -> Tensor:
        """Compute ``forward`` for a window that ``enter`` has filled, without filling it again."""
        tokens = self._features(window.positions, window.observed, future=True)
        return self._future(self.predict, tokens, window.positions)

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """L = L_prediction + alpha_1 L_mask + alpha_2 L_denoise (section 3.3).

        Each is a mean distance in metres: over the known future, the hidden coordinates, and all
        observed past coordinates (some with noise added); the true past has no noise, even where
        the window has. Draws from torch's global generator.
        """
        options = self.options
        tasks = int(options.masking) + int(options.denoising)
        if not tasks:
            return super().losses(window, target, progress)
        size = len(window.observed)
        share = math.ceil(size * options.auxiliary_share)
        inputs = [BodyFrames(window.positions[:share], window.observed[:share])] * tasks
        if options.masking:
            inputs[0] = self._masked(inputs[0])
        if options.denoising:
            inputs[-1] = self._noisy(inputs[-1])
        filled = [self._filled(w) for w in (window, *inputs)]
        if options.auxiliary_future:  # one batch of three, as printed
            observed = torch.cat([window.observed, *(w.observed for w in inputs)])
            tokens = self._features(torch.cat(filled), observed, future=True)
            main, *others = tokens.split([size] + [share] * tasks)
        else:
            observed = torch.cat([w.observed for w in inputs])
            main = self._features(filled[0], window.observed, future=True)
            others = list(
                self._features(torch.cat(filled[1:]), observed, future=False).chunk(tasks)
            )
        losses = {"position": mpjpe(self._future(self.predict, main, filled[0]), target)}
        past = target.past_of(window)
        past = Target(past.positions[:share], past.observed[:share])
        if self.unmask is not None:
            losses["mask"] = options.mask_weight * self._mask_loss(
                tokens=others[0], filled=filled[1], masked=inputs[0], past=past, target=target
            )
        if self.denoise is not None:
            cleaned = self._past(self.denoise, others[-1], filled[-1])
            losses["denoise"] = options.denoise_weight * mpjpe(cleaned, past)
        return losses

    def _mask_loss(
        self,
        *,
        tokens: Tensor,
        filled: Tensor,
        masked: BodyFrames,
        past: Target,
        target: Target,
    ) -> Tensor:
        """Mean distance over hidden coordinates of the past, and of the future as in the paper."""
        positions, hidden = past.positions, past.observed & ~masked.observed
        recovered = self._past(cast(nn.Module, self.unmask), tokens, filled)
        if self.unmask_future is None:
            return mpjpe(recovered, Target(positions, hidden))
        share = len(positions)
        recovered = torch.cat([recovered, self._future(self.unmask_future, tokens, filled)], 1)
        positions = torch.cat([positions, target.positions[:share]], 1)
        return mpjpe(recovered, Target(positions, torch.cat([hidden, target.observed[:share]], 1)))

    def _masked(self, window: BodyFrames) -> BodyFrames:
        kept = torch.rand_like(window.positions[..., 0]) >= self.options.mask_ratio
        return BodyFrames(window.positions, window.observed & kept)

    def _noisy(self, window: BodyFrames) -> BodyFrames:
        chosen = torch.rand_like(window.positions[..., 0]) < self.options.noise_ratio
        noise = self.options.noise_m * torch.randn_like(window.positions)
        return BodyFrames(window.positions + noise * chosen[..., None], window.observed)

    def _filled(self, window: BodyFrames) -> Tensor:
        """(N, T, J, 3) filled in again, so that no value depends on a hidden coordinate."""
        clean = torch.where(window.observed[..., None], window.positions, 0.0)
        return fill(clean, window.observed, self.rest, self.nearest)

    def _features(self, filled: Tensor, observed: Tensor, *, future: bool) -> Tensor:
        """Tokens (N, T + future tokens, J, F) after all layers, Eqs. 2a-2d.

        Observed-only attention leaves future tokens as they are, so it is not computed for them.
        """
        past = filled.shape[1]
        seen = observed[..., None]
        parts = [filled, filled - filled[:, -1:]]
        if self.options.velocity:
            both = functional.pad(seen[:, 1:] & seen[:, :-1], (0, 0, 0, 0, 1, 0))
            step = functional.pad(filled[:, 1:] - filled[:, :-1], (0, 0, 0, 0, 1, 0))
            parts.append(torch.where(both, step, 0.0))
        coordinates = torch.cat(parts, -1) * DECIMETRES
        places = self.step + self.joint
        tokens = torch.where(seen, self.coordinate(coordinates), self.hidden) + places[:past]
        if future:
            ahead = (self.hidden + places[past:]).expand(filled.shape[0], -1, -1, -1)
            tokens = torch.cat([tokens, ahead], 1)
        for layer, observed_only in self.order():
            if not observed_only:
                tokens = layer(tokens, None)
            elif future:
                seen_part, ahead = tokens.split([past, self.future_tokens], 1)
                tokens = torch.cat([layer(seen_part, observed), ahead], 1)
            else:
                tokens = layer(tokens, observed)
        return cast(Tensor, self.norm(tokens))

    def order(self) -> list[tuple[Layer, bool]]:
        """Layers in order, and whether each attends to observed tokens only (Table 7)."""
        observed = [(cast(Layer, layer), True) for layer in self.observed_layers]
        full = [(cast(Layer, layer), False) for layer in self.full_layers]
        if self.options.order == "separate" or not observed:
            return observed + full
        return [pair for both in zip(observed, full, strict=True) for pair in both]

    def _past(self, head: nn.Module, tokens: Tensor, filled: Tensor) -> Tensor:
        """(N, T, J, 3) metres: the filled input plus the head's output."""
        return filled + cast(Tensor, head(tokens[:, : filled.shape[1]])) / DECIMETRES

    def _future(self, head: nn.Module, tokens: Tensor, filled: Tensor) -> Tensor:
        """(N, H, J, 3) metres: the last filled pose plus the head's output."""
        return self.ahead_of(head, tokens[:, filled.shape[1] :], filled)

    def ahead_of(self, head: nn.Module, future: Tensor, filled: Tensor) -> Tensor:
        """Like ``_future``, but from the future tokens alone, (N, future tokens, J, F)."""
        change = head(future).unflatten(3, (self.options.future_stride, 3))
        change = change.transpose(2, 3).flatten(1, 2)[:, : self.shape.horizon_steps]
        return filled[:, -1:] + change / DECIMETRES


def _dictionary(*shape: int) -> nn.Parameter:
    """Learnable codes."""
    return nn.Parameter(0.1 * torch.randn(*shape))


def _head(features: int, out: int) -> nn.Linear:
    """A linear head whose output is zero before training."""
    head = nn.Linear(features, out)
    nn.init.zeros_(head.weight)
    nn.init.zeros_(head.bias)
    return head


class AuxFormerPredictor(NeuralPredictor):
    """A transformer that also learnt to fill in and clean its input (AuxFormer)."""

    method = "auxformer"
    network_class = AuxFormer
