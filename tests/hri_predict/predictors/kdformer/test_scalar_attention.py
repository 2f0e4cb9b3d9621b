"""Attention of single numbers: torch's own softmax and gradients, with loops and with arrays."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from hri_predict.base.machine import compiled
from hri_predict.predictors.kdformer import scalar_attention as module
from hri_predict.predictors.kdformer.scalar_attention import scalar_attention


def drawn(scale: float, dtype: torch.dtype = torch.float32) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    q = scale * torch.randn(3, 5, 8, generator=generator)
    k = scale * torch.randn(3, 7, 8, generator=generator)
    return [x.to(dtype) for x in (q, k, torch.randn(3, 7, 8, generator=generator))]


def plain(q: torch.Tensor, k: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    return torch.einsum("bqkh,bkh->bqh", (q[:, :, None] * k[:, None]).softmax(2), v)


def tolerance(q: np.ndarray, k: np.ndarray) -> float:
    """A score of size s has an error of s eps, which the exponential passes on."""
    return 8 * float(np.finfo(np.float32).eps) * (1 + float(np.abs(q).max() * np.abs(k).max()))


def size(x: np.ndarray) -> float:
    return float(np.abs(x).max())


def compiled_only(loops: Callable[..., Any]) -> Callable[..., Any]:
    """The loops as numba compiles them; an error where it cannot."""
    if why := compiled.why_not_compiled():
        pytest.skip(why)

    def otherwise(*_: Any) -> Any:
        raise AssertionError("numba cannot compile the loops")

    return compiled.kernel(loops, otherwise, any_order=True)


def gradient(x: torch.Tensor) -> torch.Tensor:
    assert x.grad is not None
    return x.grad


@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_it_is_the_softmax_over_the_products(scale):
    with torch.no_grad():
        q, k, v = drawn(scale, torch.double)
        torch.testing.assert_close(scalar_attention(q, k, v), plain(q, k, v))


@pytest.mark.parametrize("scale", [0.0, 1.0, 4.0, 30.0])
@pytest.mark.parametrize("dtype", [torch.float32, torch.double])
def test_its_gradients_are_those_of_the_softmax(scale, dtype):
    given = [x.requires_grad_() for x in drawn(scale, dtype)]
    exact = [x.detach().double().requires_grad_() for x in given]
    toward = torch.randn(3, 5, 8, generator=torch.Generator().manual_seed(2)).double()
    y, expected = scalar_attention(*given), plain(*exact)
    (y * toward.to(dtype)).sum().backward()
    (expected * toward).sum().backward()
    error = tolerance(*(x.detach().numpy() for x in exact[:2]))
    torch.testing.assert_close(y.double(), expected, rtol=error, atol=error)
    for mine, true in zip(given, exact, strict=True):
        size = float(gradient(true).abs().max())
        torch.testing.assert_close(
            gradient(mine).double(), gradient(true), rtol=0, atol=error * max(size, 1.0) * 10
        )


@pytest.mark.parametrize("scale", [0.0, 1.0, 4.0])
def test_loops_and_arrays_give_the_same(scale):
    q, k, v = (module._rows(x.transpose(-1, -2)) for x in drawn(scale))
    by_arrays = module._forward_by_arrays(q, k, v)
    error = tolerance(q, k)
    forward = compiled_only(module._forward_by_loops)
    np.testing.assert_allclose(forward(q, k, v), by_arrays, rtol=0, atol=error * size(by_arrays))
    backward = compiled_only(module._backward_by_loops)
    g = np.random.default_rng(3).normal(size=by_arrays.shape).astype(np.float32)
    for mine, other in zip(
        backward((q, k, v), by_arrays, g),
        module._backward_by_arrays((q, k, v), by_arrays, g),
        strict=True,
    ):
        np.testing.assert_allclose(mine, other, rtol=0, atol=10 * error * max(size(other), 1.0))


def test_weights_far_below_the_largest_vanish():
    rows = [[[1.0]]], [[[0.0], [1000.0]]], [[[5.0], [7.0]]]
    given = [torch.tensor(x, requires_grad=True) for x in rows]
    y = scalar_attention(*given)
    y.sum().backward()
    assert float(y.detach()) == 7.0
    gradients = [gradient(x) for x in given]
    assert all(bool(each.isfinite().all()) for each in gradients)
    torch.testing.assert_close(gradients[2], torch.tensor([[[0.0], [1.0]]]))
