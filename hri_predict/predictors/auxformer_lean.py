"""AuxFormer's forecast for the engines, with only the arithmetic that it needs.

The result equals that of ``AuxFormer.forward_filled`` except for rounding:

- Observed-only attention reads only the joints observed for at least one person. These joints are
  moved to the front; attention does not depend on the order of joints. (A source shows 18 of the
  body's 28.)
- The last attention is computed for future tokens alone.
- Normalisation's factors and attention's scale are part of the projections. A key's bias adds the
  same amount to the scores of all keys, so it cancels in the softmax; a value's bias adds a
  constant.
- Attention's products are bounded (``_bound``), so the softmax need not subtract the largest. One
  product then gives the weighted values and their divisor. Hidden keys are zeroed in the values, so
  no mask over all pairs is needed.
- Each head has its own projections, so nothing is split or transposed.
"""

from collections.abc import Callable, Iterator
from typing import Protocol

import torch
from torch import Tensor, nn
from torch.nn import functional

from hri_predict.predictors.auxformer_attention import (
    Attention,
    AuxFormerOptions,
    Layer,
)
from hri_predict.predictors.neural.network import DECIMETRES, BodyFrames, Shape

_LARGEST = 60.0  # e^60 is 1e26 and e^-60 1e-26: far inside single precision, times any values


class Parts(Protocol):
    """Parts read from a network; see ``AuxFormer``."""

    shape: Shape
    options: AuxFormerOptions
    future_tokens: int
    coordinate: nn.Linear
    joint: nn.Parameter
    step: nn.Parameter
    hidden: nn.Parameter
    norm: nn.LayerNorm
    predict: nn.Linear

    def modules(self) -> Iterator[nn.Module]:
        """All of its parts."""

    def order(self) -> list[tuple[Layer, bool]]:
        """Layers in order, and whether each attends to observed tokens only."""

    def forward_filled(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3) of a filled window."""

    def ahead_of(self, head: nn.Module, future: Tensor, filled: Tensor) -> Tensor:
        """(B, H, J, 3) metres of future tokens (B, future tokens, J, F)."""


def lean(network: Parts) -> Callable[[BodyFrames], Tensor]:
    """The lean forward pass if attention's products are small enough, otherwise the plain one."""
    if max(_bound(a) for a in network.modules() if isinstance(a, Attention)) > _LARGEST:
        return network.forward_filled
    return _Lean(network)


def _bound(attention: Attention) -> float:
    """Upper bound on query-key products: normalised features have length sqrt(F)."""
    largest = 0.0
    for head in _heads(attention):
        both = torch.linalg.matrix_norm(head.query @ head.key.t(), 2)
        alone = (head.query_bias @ head.key.t()).norm()
        size = attention.norm.normalized_shape[0]
        largest = max(largest, float(both * size + alone * size**0.5))
    return largest


class _Head:
    """One head's projections (F, width) of features normalised without learnt factors.

    ``value`` has one more column, set to one by its bias: its weighted sum is the softmax's
    divisor.
    """

    def __init__(self, qkv: Tensor, bias: Tensor, scale: float, out: Tensor) -> None:
        query, key, value = qkv  # (width, F) each
        self.query, self.query_bias = scale * query.t(), scale * bias[0]
        self.key = key.t().contiguous()
        self.value = functional.pad(value.t(), (0, 1))
        self.one = functional.pad(torch.zeros_like(bias[2]), (0, 1), value=1.0)
        self.out = out.t().contiguous()  # (width, hidden): its part of the FFN's first layer
        self.constant = out @ bias[2]


def _heads(attention: Attention) -> list[_Head]:
    count = attention.heads
    qkv, size = attention.qkv, attention.qkv.in_features
    bias = (qkv.weight @ attention.norm.bias + qkv.bias).view(count, 3, -1)
    weight = (qkv.weight * attention.norm.weight).view(count, 3, -1, size)
    scale = attention.scale or weight.shape[2] ** -0.5
    first = attention.ffn[0]
    assert isinstance(first, nn.Linear)
    parts = first.weight.chunk(count, 1)
    return [
        _Head(qkv, added, scale, out) for qkv, added, out in zip(weight, bias, parts, strict=True)
    ]


class _Attention:
    """Attention along the second axis from the end, of (..., N, F), and its FFN."""

    def __init__(self, attention: Attention) -> None:
        self.heads = _heads(attention)
        self.size, self.eps = list(attention.norm.normalized_shape), attention.norm.eps
        first, _, second = attention.ffn
        assert isinstance(first, nn.Linear)
        assert isinstance(second, nn.Linear)
        self.bias = first.bias + torch.stack([head.constant for head in self.heads]).sum(0)
        self.second, self.second_bias = second.weight.t().contiguous(), second.bias

    def __call__(self, tokens: Tensor, seen: Tensor | None, past: int = 0) -> Tensor:
        """Update the tokens (..., N, F) after the first ``past`` by those ``seen`` (..., N, 1)."""
        features = functional.layer_norm(tokens, self.size, eps=self.eps)
        keys = None
        if seen is not None:
            known = seen.amax(-2, keepdim=True)
            keys = torch.maximum(seen, 1.0 - known)  # without any, all are open, and not used
        asking = features[..., past:, :] if past else features
        inner = self.bias
        for head in self.heads:
            query = asking @ head.query + head.query_bias
            value = features @ head.value + head.one
            if keys is not None:
                value = value * keys
            mixed = (query @ (features @ head.key).transpose(-1, -2)).exp() @ value
            width = head.query.shape[1]
            total, divisor = mixed.split([width, 1], -1)
            inner = (total / divisor) @ head.out + inner
        change = inner.relu() @ self.second + self.second_bias
        if seen is not None:
            change = change * seen
        return (tokens[..., past:, :] if past else tokens) + change


class _Lean:
    def __init__(self, network: Parts) -> None:
        self.network = network
        o, past = network.options, network.shape.history_steps
        self.order = [
            (_Attention(layer.spatial), _Attention(layer.temporal), observed_only)
            for layer, observed_only in network.order()
        ]
        places = network.step + network.joint
        self.embed = network.coordinate.weight.t() * DECIMETRES
        self.embed_bias = network.coordinate.bias
        self.places, self.ahead = places[:past], network.hidden + places[past:]
        self.hidden, self.velocity, self.past = network.hidden, o.velocity, past

    def __call__(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3); the window is filled."""
        order, place, count = _seen_first(window.observed)
        filled, observed = window.positions[:, :, order], window.observed[:, :, order]
        tokens = self._embedded(filled, observed, order)
        shown = observed[:, :, :count, None].to(tokens.dtype)
        *before, (spatial, temporal, observed_only) = self.order
        for first, second, only in before:
            tokens = self._updated(tokens, first, second, shown if only else None)
        assert not observed_only  # full attention comes last, whatever the order
        tokens = spatial(tokens, None).transpose(1, 2)
        future = temporal(tokens, None, past=self.past).transpose(1, 2)[:, :, place]
        future = self.network.norm(future)
        return self.network.ahead_of(self.network.predict, future, window.positions)

    def _embedded(self, filled: Tensor, observed: Tensor, order: Tensor) -> Tensor:
        """Tokens (B, T + future tokens, J, F), Eqs. 2a and 2b."""
        parts = [filled, filled - filled[:, -1:]]
        if self.velocity:
            both = (observed[:, 1:] & observed[:, :-1])[..., None].to(filled.dtype)
            step = (filled[:, 1:] - filled[:, :-1]) * both
            parts.append(functional.pad(step, (0, 0, 0, 0, 1, 0)))
        known = torch.cat(parts, -1) @ self.embed + self.embed_bias
        past = torch.where(observed[..., None], known, self.hidden) + self.places[:, order]
        nothing = torch.zeros_like(past[:, :1, :1, :1])  # of as many people
        return torch.cat([past, self.ahead[:, order] + nothing], 1)

    def _updated(
        self, tokens: Tensor, spatial: _Attention, temporal: _Attention, shown: Tensor | None
    ) -> Tensor:
        if shown is None:
            return temporal(spatial(tokens, None).transpose(1, 2), None).transpose(1, 2)
        past, future = tokens.split([self.past, self.network.future_tokens], 1)
        count = shown.shape[2]
        seen = spatial(past[:, :, :count], shown).transpose(1, 2)
        seen = temporal(seen, shown.transpose(1, 2)).transpose(1, 2)
        return torch.cat([torch.cat([seen, past[:, :, count:]], 2), future], 1)


def _seen_first(observed: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return the order of joints, each joint's place in it, and the number of joints shown.

    Joints shown by at least one person come first. The first joint always counts as shown, because
    attention needs at least one key.
    """
    shown = observed.flatten(0, 1).any(0)
    shown = torch.cat([torch.ones_like(shown[:1]), shown[1:]])
    order = torch.cat([shown.nonzero()[:, 0], (~shown).nonzero()[:, 0]])
    number = shown.long()
    count = number.sum()
    place = torch.where(shown, number.cumsum(0) - 1, count + (1 - number).cumsum(0) - 1)
    return order, place, count
