"""Attention with one number per head, as between KD-Former's joints: d = 8 with 8 heads.

With single numbers, all sums of Eq. 6 and of its gradient run over a row of the same table of
weights p = softmax(q k), which need never be stored: for outputs y and their gradients g,
dq_i = g_i sum_j p_ij (v_j - y_i) k_j, dk_j = sum_i p_ij g_i q_i (v_j - y_i) and
dv_j = sum_i p_ij g_i. In training, torch's general products and softmax take seven times as long.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hri_predict.base.machine.compiled import kernel, part

Rows = NDArray[np.float32]
"""A row (N, K) for each head of each sequence."""
Given = tuple[Rows, Rows, Rows]
"""Queries, keys and values."""


def scalar_attention(q: Tensor, k: Tensor, v: Tensor) -> Tensor:
    """Return the attention (B, Q, h) of queries (B, Q, h) to keys and values (B, K, h)."""
    rows = [x.transpose(-1, -2) for x in (q, k, v)]
    if not torch.is_grad_enabled():
        attended = _attended(*rows)
    elif q.dtype == torch.float32 and q.device.type == "cpu":
        attended = _Attention.apply(*rows)
    else:
        q, k, v = rows
        attended = ((q[..., None] * k[..., None, :]).softmax(-1) @ v[..., None])[..., 0]
    return attended.transpose(-1, -2)


def _attended(q: Tensor, k: Tensor, v: Tensor) -> Tensor:
    """The same without gradients, in operations that can be exported.

    The softmax over these few keys takes most of a forecast's time, and half of that is the search
    for the largest score. With one number per head it is always at the largest or the smallest key.
    So one product gives the scores minus the largest, and another gives the weighted sum and its
    divisor.
    """
    one = torch.ones_like(k)
    smallest, largest = k.aminmax(dim=-1, keepdim=True)
    shift = torch.maximum(q * smallest, q * largest)
    weight = (torch.stack([q, -shift], -1) @ torch.stack([k, one], -2)).exp_()
    total, norm = (weight @ torch.stack([v, one], -1)).unbind(-1)
    return total / norm


class _Attention(torch.autograd.Function):
    """Attention with its gradient, on a CPU."""

    @staticmethod
    def forward(ctx: Any, q: Tensor, k: Tensor, v: Tensor) -> Tensor:
        given = [_rows(x) for x in (q, k, v)]
        y = torch.from_numpy(_forward(*given)).view(q.shape)
        ctx.save_for_backward(q, k, v, y)
        return y

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:
        q, k, v, y = ctx.saved_tensors
        found = _backward((_rows(q), _rows(k), _rows(v)), _rows(y), _rows(gradients[0]))
        return tuple(
            torch.from_numpy(x).view(given.shape) for x, given in zip(found, (q, k, v), strict=True)
        )


def _rows(x: Tensor) -> Rows:
    rows: Rows = x.detach().reshape(-1, x.shape[-1]).contiguous().numpy()
    return rows


# -- with arrays -----------------------------------------------------------------------------------


def _weights_by_arrays(q: Rows, k: Rows) -> Rows:
    scores = q[:, :, None] * k[:, None]
    weights = np.exp(scores - scores.max(-1, keepdims=True))
    result: Rows = weights / weights.sum(-1, keepdims=True)
    return result


def _forward_by_arrays(q: Rows, k: Rows, v: Rows) -> Rows:
    """Return the attention (N, Q) of queries (N, Q) to keys and values (N, K)."""
    result: Rows = (_weights_by_arrays(q, k) @ v[..., None])[..., 0]
    return result


def _backward_by_arrays(given: Given, y: Rows, g: Rows) -> Given:
    """Return the gradients of q, k and v from the output ``y`` (N, Q) and its gradients ``g``."""
    q, k, v = given
    weights = _weights_by_arrays(q, k) * g[..., None]
    moves = weights * (v[:, None] - y[..., None])
    return (moves @ k[..., None])[..., 0], (moves * q[..., None]).sum(1), weights.sum(1)


# -- with loops ------------------------------------------------------------------------------------

_LOG2_E = np.float32(1.4426950408889634)
_LEAST = np.float32(-126.0)  # the exponent of the smallest normal number
_HALF = np.float32(0.5)
# Taylor coefficients of 2**x, for |x| <= 0.5 to within 2e-7
_C1, _C2, _C3 = np.float32(6.9314718e-1), np.float32(2.4022651e-1), np.float32(5.5504109e-2)
_C4, _C5, _C6 = np.float32(9.6181291e-3), np.float32(1.3333558e-3), np.float32(1.5403530e-4)
_ONE = np.float32(1.0)


@part
def _exponentials(q: Any, k: Any, most: Any, found: Any) -> None:
    """exp(q k - most), at most 1, as a fraction times the number with the bits of a power.

    numba has no exponential of several numbers at once.
    """
    fraction, power = found
    for j in range(len(k)):
        exponent = (q * k[j] - most) * _LOG2_E
        exponent = exponent if exponent > _LEAST else _LEAST
        whole = np.int32(exponent - _HALF)
        x = exponent - np.float32(whole)
        high = (((_C6 * x + _C5) * x + _C4) * x + _C3) * x + _C2
        fraction[j] = (high * x + _C1) * x + _ONE
        power[j] = (whole + np.int32(127)) << np.int32(23)


def _forward_by_loops(q: Rows, k: Rows, v: Rows) -> Rows:
    keys = k.shape[1]
    y = np.empty_like(q)
    fraction, power = np.empty(keys, np.float32), np.empty(keys, np.int32)
    scale = power.view(np.float32)
    for n in range(len(q)):
        least, largest = k[n].min(), k[n].max()
        for i in range(q.shape[1]):
            one = q[n, i]
            _exponentials(one, k[n], max(one * least, one * largest), (fraction, power))
            norm = total = np.float32(0.0)
            for j in range(keys):
                weight = fraction[j] * scale[j]
                norm += weight
                total += weight * v[n, j]
            y[n, i] = total / norm
    return y


def _backward_by_loops(given: Given, y: Rows, g: Rows) -> Given:
    q, k, v = given
    keys = k.shape[1]
    dq, dk, dv = np.empty_like(q), np.zeros_like(k), np.zeros_like(k)
    weight, power = np.empty(keys, np.float32), np.empty(keys, np.int32)
    scale = power.view(np.float32)
    for n in range(len(q)):
        least, largest = k[n].min(), k[n].max()
        key, value, dkey, dvalue = k[n].copy(), v[n].copy(), dk[n], dv[n]
        for i in range(q.shape[1]):
            one = q[n, i]
            _exponentials(one, key, max(one * least, one * largest), (weight, power))
            norm = np.float32(0.0)
            for j in range(keys):
                weight[j] *= scale[j]
                norm += weight[j]
            share = g[n, i] / norm
            total = np.float32(0.0)
            for j in range(keys):
                moves = weight[j] * (value[j] - y[n, i])
                total += moves * key[j]
                dkey[j] += moves * share * one
                dvalue[j] += weight[j] * share
            dq[n, i] = total * share
    return dq, dk, dv


_forward = kernel(_forward_by_loops, _forward_by_arrays, any_order=True)
_backward = kernel(_backward_by_loops, _backward_by_arrays, any_order=True)
