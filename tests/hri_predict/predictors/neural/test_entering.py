"""From the room to a window and back: the loops give what the operations on batches give."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, Skeleton
from hri_predict.predictors.neural import entering
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.body_frame import neighbour_table
from hri_predict.predictors.neural.entering import tables
from hri_predict.predictors.neural.network import Network, Shape
from hri_predict.predictors.neural.windows import Entered, Histories

ROUNDING_M = 2e-6  # single precision: 2.4e-7 m at 3 m, up to the last place of each of some sums
EXACT_M = 1e-12  # double precision: 2e-15 m at 10 m, times some hundred
REST = np.random.default_rng(5).normal(0, 0.4, (28, 3)).astype(np.float32).astype(np.float64)
NEAREST = neighbour_table(BODY).numpy()


def drawn(skeleton: Skeleton, seed: int, seen: float) -> Histories:
    """People who walk anywhere; some are seen as a share, one never, one without hips."""
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 6)), int(rng.integers(1, 9)), len(skeleton.joints))
    positions = rng.normal(0, 0.3, (*shape, 3)) + rng.uniform(-5, 5, (shape[0], 1, 1, 3))
    observed = rng.random(shape) < seen
    if rng.random() < 0.3:
        observed[0] = False
    if rng.random() < 0.3:
        observed[-1, :, [skeleton.joints.index(f"{side}_hip") for side in "lr"]] = False
    if rng.random() < 0.2:  # lies on one side: no line is level
        side = [skeleton.joints.index(f"l_{name}") for name in ("hip", "shoulder")]
        other = [skeleton.joints.index(f"r_{name}") for name in ("hip", "shoulder")]
        positions[..., side, :2] = positions[..., other, :2]
    return Histories(positions, observed)


@given(
    st.sampled_from([CANONICAL, BODY]),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.02, 0.1, 0.5, 0.9, 1.0]),
)
def test_loops_agree_with_the_operations_on_batches(skeleton, seed, seen):
    histories, constant = drawn(skeleton, seed, seen), tables(skeleton, REST, NEAREST)
    found = entering.enter(histories, constant)
    wanted = entering._enter_arrays(histories, constant)
    np.testing.assert_array_equal(found.observed, wanted.observed)
    np.testing.assert_allclose(found.frames, wanted.frames, rtol=0, atol=EXACT_M)
    assert found.window.dtype == wanted.window.dtype == np.float32
    np.testing.assert_allclose(found.window, wanted.window, rtol=0, atol=ROUNDING_M)
    rng = np.random.default_rng(seed)
    forecast = rng.normal(0, 1, (len(found.window), 4, 28, 3)).astype(np.float32)
    there = entering.leave(forecast, wanted, histories, constant)
    np.testing.assert_allclose(
        there,
        entering._leave_arrays(forecast, wanted, histories, constant),
        rtol=0,
        atol=EXACT_M,
    )


@pytest.mark.parametrize("seed", range(8))
def test_loops_without_the_compiler_agree_too(seed):
    histories, constant = drawn(CANONICAL, seed, 0.6), tables(CANONICAL, REST, NEAREST)
    found = entering._enter_loops(histories, constant)
    compiled = entering.enter(histories, constant)
    for name in Entered._fields:
        one, other = getattr(found, name), getattr(compiled, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=ROUNDING_M)
    forecast = np.ones((len(found.window), 2, 28, 3), dtype=np.float32)
    np.testing.assert_allclose(
        entering._leave_loops(forecast, found, histories, constant),
        entering.leave(forecast, found, histories, constant),
        rtol=0,
        atol=EXACT_M,
    )


def test_a_window_is_that_of_training():
    histories = drawn(BODY, 3, 0.7)
    network = Network(Shape(skeleton=BODY, history_steps=8, horizon_steps=4, rate_hz=25.0))
    network.rest.copy_(torch.from_numpy(REST))
    wanted, frame = network.enter(*(torch.from_numpy(each) for each in histories))
    constant = tables(BODY, REST, NEAREST)
    found = entering.enter(histories, constant)
    np.testing.assert_allclose(found.window, wanted.positions.numpy(), rtol=0, atol=ROUNDING_M)
    back = entering.leave(found.window, found, histories, constant)
    np.testing.assert_allclose(
        back, frame.leave(wanted.positions.double()).numpy(), rtol=0, atol=ROUNDING_M
    )


def test_what_was_observed_comes_back_to_where_it_was():
    histories = drawn(BODY, 7, 1.0)
    constant = tables(BODY, REST, NEAREST)
    entered: Entered = entering.enter(histories, constant)
    back = entering.leave(entered.window, entered, histories, constant)
    # a window is relative to the person, so its single precision is that of a metre or two
    np.testing.assert_allclose(
        back[histories.observed], histories.positions[histories.observed], rtol=0, atol=ROUNDING_M
    )
