"""The fitted scale: it follows what errors depend on, and never sees what it is compared with."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.scale_fit import FOLDS, QUANTILE, cross_scales
from hri_predict.lab.calibration.scores import HISTORY_STEPS, Presence, Scores, evidence_of
from hri_predict.zones.learned_scale import (
    AHEAD,
    BEYOND,
    KINDS,
    NOW,
    LearnedScale,
    inputs_ahead,
    inputs_now,
    kind_of,
    knots_within,
)
from tests.hri_predict.short_fit import short_fit

RATE_HZ = 25.0
COUNT, STEPS = len(JOINTS), 5
BODY = np.random.default_rng(2).normal(size=(COUNT, 3))


def scores(name, seed, windows=60, action="walking"):
    """Each window has a speed of its own; errors are half-normal, their size grows with it."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(0, 2, windows)
    along = (np.arange(HISTORY_STEPS) / RATE_HZ)[None, :, None, None] * np.array([1.0, 0, 0])
    history = BODY + speed[:, None, None, None] * along
    size = 0.02 + 0.1 * speed
    error = np.abs(rng.normal(size=(windows, STEPS, COUNT))) * size[:, None, None]
    origin = 40_000_000 * np.arange(windows)
    return Scores(
        name=name,
        action=action,
        origin_ns=origin,
        history=history,
        observed=np.ones((windows, HISTORY_STEPS, COUNT), bool),
        forecast=np.repeat(history[:, -1:], STEPS, axis=1),
        error_m=error,
        speed_m_s=speed,
        residual_m=np.full(windows, np.nan),
        past_error_m=np.full((windows, 2, COUNT), np.nan),
        truth=Presence(
            origin, np.zeros((windows, COUNT, 3)), np.ones((windows, COUNT), bool), RATE_HZ
        ),
    )


def entries(count=7):
    return [scores(f"r{n}", n) for n in range(count)]


def fitted(given):
    return cross_scales(given, RATE_HZ, CANONICAL)


@pytest.mark.long
def test_the_scale_follows_what_the_error_depends_on():
    own = entries(10)
    with short_fit(steps=600, batch=1024):
        _, found = fitted(own)
    speed = np.concatenate([e.speed_m_s for e in own])
    scale = np.concatenate(found).mean((1, 2))
    error = np.concatenate([e.error_m for e in own])
    # the 95 % quantile of |N| is 1.96 sizes: from 0.04 m at rest to 0.43 m at 2 m/s
    slow, fast = scale[speed < 0.3].mean(), scale[speed > 1.7].mean()
    assert fast > 4 * slow  # 0.20 / 0.035 of the sizes at 1.85 and 0.15 m/s are 5.9
    for chosen in (speed < 0.5, (speed > 0.75) & (speed < 1.25), speed > 1.5):
        share = (error <= np.concatenate(found))[chosen].mean()
        # 150 windows of 105 independent errors: the fit's own error is what remains
        assert share == pytest.approx(QUANTILE, abs=0.03)


def test_a_recording_that_is_left_out_has_no_part_in_its_own_scale():
    own = entries()
    with short_fit():
        network, before = fitted(own)
        changed = replace(own[3], error_m=own[3].error_m * 50.0)
        other, after = fitted([*own[:3], changed, *own[4:]])
    assert np.array_equal(before[3], after[3])
    assert not np.array_equal(before[4], after[4])  # but in that of the others
    assert network.to_json() != other.to_json()


def test_two_presences_of_a_recording_are_left_out_together():
    own = entries()
    second = replace(scores("r3", 99), name="r3")
    with short_fit():
        _, before = fitted([*own, second])
        _, after = fitted([*own, replace(second, error_m=second.error_m * 50.0)])
    assert np.array_equal(before[3], after[3])
    assert np.array_equal(before[-1], after[-1])


def test_the_inputs_of_a_recording_do_not_decide_how_its_own_are_scaled():
    own = entries()
    faster = replace(own[3], history=own[3].history.copy())
    faster.history[30:] *= 3.0
    with short_fit():
        _, before = fitted(own)
        _, after = fitted([*own[:3], faster, *own[4:]])
    assert np.array_equal(before[3][:30], after[3][:30])
    assert not np.array_equal(before[3][30:], after[3][30:])


@pytest.mark.long
def test_the_same_scores_give_the_same_network_in_any_order():
    own = entries()
    with short_fit():
        first, one = fitted(own)
        again, two = fitted(own)
        other, three = fitted(own[::-1])
    assert first.to_json() == again.to_json() == other.to_json()
    for a, b, c in zip(one, two, three[::-1], strict=True):
        assert np.array_equal(a, b)
        assert np.array_equal(a, c)


def test_the_random_numbers_of_others_are_left_alone():
    torch.manual_seed(5)
    wanted = torch.rand(3)
    torch.manual_seed(5)
    with short_fit(steps=2):
        fitted(entries(4))
    assert torch.equal(torch.rand(3), wanted)


@pytest.mark.parametrize("count", [4, FOLDS, FOLDS + 1])
def test_everybody_gets_a_scale_however_few_recordings_there_are(count):
    with short_fit(steps=5):
        _, found = fitted(entries(count))
    assert [f.shape for f in found] == [(60, STEPS, COUNT)] * count
    assert all((f > 0).all() and np.isfinite(f).all() for f in found)


def test_what_is_not_known_is_not_learned_and_does_not_spoil_the_rest():
    own = entries()
    for entry in own:
        entry.error_m[:, :, JOINTS.index("head")] = np.nan
        entry.error_m[::2] = np.nan
    with short_fit():
        network, found = fitted(own)
    assert all(np.isfinite(f).all() for f in found)
    assert all(np.isfinite(w).all() for w, _ in network.layers)


def test_the_network_in_numpy_is_that_of_torch():
    with short_fit():
        network, _ = fitted(entries())
    layers: list[nn.Module] = []
    for weights, biases in network.layers:
        linear = nn.Linear(*weights.shape)
        with torch.no_grad():
            linear.weight.copy_(torch.tensor(weights.T))
            linear.bias.copy_(torch.tensor(biases))
        layers += [linear, nn.ReLU()]
    net = nn.Sequential(*layers[:-1])
    known, knots = evidence_of(scores("new", 50)), knots_within(STEPS)
    now = np.repeat(inputs_now(known, RATE_HZ, CANONICAL)[:, None], len(knots), axis=1)
    plain = np.concatenate([now, inputs_ahead(known, knots, RATE_HZ)], axis=-1)
    plain = np.clip((plain - network.mean) / network.deviation, -BEYOND, BEYOND)
    kinds = np.broadcast_to(np.eye(len(KINDS))[kind_of(CANONICAL)], (*plain.shape[:3], len(KINDS)))
    rows = torch.tensor(np.concatenate([plain, kinds], axis=-1), dtype=torch.float32)
    with torch.no_grad():
        log = net(rows)[..., 0].numpy()
    found = np.log(LearnedScale(network, CANONICAL, RATE_HZ, STEPS)(known))[:, knots - 1]
    # 32-bit floats: 6e-8 of values up to 10, over three layers of 36 to 64 terms: 1e-5, times ten
    np.testing.assert_allclose(found, np.maximum.accumulate(log, axis=1), atol=1e-4)


def test_a_spread_that_is_stated_at_times_is_not_read():
    first, *others = entries()
    stated = replace(first, std=np.ones(first.error_m.shape))
    for given in ([first, *others], [stated, *others]):
        with short_fit():
            network, scales = fitted(given)
        assert not network.layers[0][0][len(NOW) + AHEAD.index("spread")].any()
        assert all(np.isfinite(own).any() for own in scales)
