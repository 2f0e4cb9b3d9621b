"""Learned scale: what it reads, what it must not read, and what it gives where nothing is known."""

import itertools
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS, make_skeleton
from hri_predict.zones import learned_scale
from hri_predict.zones.learned_scale import (
    AHEAD,
    BEYOND,
    KINDS,
    KNOT_STEPS,
    LEAST_M,
    MOST_M,
    NOW,
    Evidence,
    LearnedScale,
    ScaleNetwork,
    inputs_ahead,
    inputs_now,
    kind_of,
    knots_within,
)
from tests.hri_predict.zones.conftest import scale_of

RATE_HZ = 25.0
COUNT = len(JOINTS)
WRIST, HEAD = JOINTS.index("l_wrist"), JOINTS.index("head")
SEEDS = st.integers(0, 2**32 - 1)


def network(seed=0, hidden=16):
    """Random weights of a usual size."""
    rng = np.random.default_rng(seed)
    sizes = (len(NOW) + len(AHEAD) + len(KINDS), hidden, hidden, 1)
    plain = len(NOW) + len(AHEAD)
    return ScaleNetwork(
        mean=rng.normal(size=plain),
        deviation=rng.uniform(0.5, 2, plain),
        layers=tuple(
            (rng.normal(size=(a, b)) / np.sqrt(a), rng.normal(size=b))
            for a, b in itertools.pairwise(sizes)
        ),
    )


def evidence(seed=0, people=2, back=15, steps=25):
    """People who move about, partly observed; some past errors are unknown."""
    rng = np.random.default_rng(seed)
    history = rng.normal(size=(people, 1, COUNT, 3)) + rng.normal(
        0, 0.04, (people, back, COUNT, 3)
    ).cumsum(1)
    ahead = rng.normal(0, 0.04, (people, steps, COUNT, 3)).cumsum(1)
    error = rng.exponential(0.1, (people, 2, COUNT))
    return Evidence(
        history=history,
        observed=rng.random((people, back, COUNT)) < 0.9,
        forecast=history[:, -1:] + ahead,
        error_m=np.where(rng.random(error.shape) < 0.2, np.nan, error),
        residual_m=np.where(rng.random(people) < 0.2, np.nan, rng.exponential(0.1, people)),
        std=rng.exponential(0.05, (people, steps, COUNT)),
    )


def scale(own=None, steps=25, rate_hz=RATE_HZ, skeleton=CANONICAL):
    return LearnedScale(own or network(), skeleton, rate_hz, steps)


def one(known, person):
    rows = {f.name: getattr(known, f.name) for f in fields(known)}
    return Evidence(**{name: r[person][None] for name, r in rows.items() if r is not None})


def double_precision(own, known, steps=25):
    """The scale's logarithm (P, H, J), layer by layer in double precision, and how far single
    precision may be from it: each sum of n products errs by at most n + 2 roundings of the sum of
    their sizes, and passes on the errors of what it adds."""
    knots = knots_within(steps)
    now = inputs_now(known, RATE_HZ, CANONICAL)[:, None]
    ahead = inputs_ahead(known, knots, RATE_HZ)
    kinds = np.eye(len(KINDS))[kind_of(CANONICAL)]
    wide = (*ahead.shape[:-1], -1)
    plain = np.concatenate([np.broadcast_to(now, (*wide[:-1], now.shape[-1])), ahead], -1)
    normal = np.clip((plain - own.mean) / own.deviation, -BEYOND, BEYOND)
    values = np.concatenate([normal, np.broadcast_to(kinds, (*wide[:-1], len(KINDS)))], -1)
    rounding = np.finfo(np.float32).eps
    error = rounding * np.abs(values)
    for number, (weights, biases) in enumerate(own.layers):
        if number:
            values = np.maximum(values, 0.0)
        sizes = np.abs(values) @ np.abs(weights) + np.abs(biases)
        error = error @ np.abs(weights) + (len(weights) + 2) * rounding * sizes
        values = values @ weights + biases
    log, at = np.maximum.accumulate(values[..., 0], axis=1), np.arange(1, steps + 1)
    rows = [[np.interp(at, knots, log[p, :, j]) for j in range(COUNT)] for p in range(len(log))]
    return np.swapaxes(np.array(rows), 1, 2), error.max()


# -- what it reads --------------------------------------------------------------------------------


@given(SEEDS)
def test_turning_and_moving_the_room_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    known = evidence(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shift = rng.uniform(-20, 20, 3)
    moved = replace(
        known, history=known.history @ turn.T + shift, forecast=known.forecast @ turn.T + shift
    )
    # coordinates up to 30 m are rounded to 4e-15 m, far less than the network's single precision
    _, error = double_precision(network(), known)
    assert scale()(moved) == pytest.approx(scale()(known), rel=np.expm1(2 * error))


@given(SEEDS)
def test_people_are_judged_alone_whoever_is_beside_them(seed):
    known = evidence(seed, people=3)
    found = scale()(known)
    for person in range(3):
        # sums of a matrix product may be ordered by its size
        _, error = double_precision(network(), one(known, person))
        assert scale()(one(known, person))[0] == pytest.approx(
            found[person], rel=np.expm1(2 * error)
        )
    assert scale()(evidence(people=0)).shape == (0, 25, COUNT)


@given(SEEDS)
def test_what_is_not_observed_is_not_read(seed):
    """Wherever a hidden joint is held, what the others get does not change."""
    known = evidence(seed)
    garbage = np.random.default_rng(seed).uniform(-9, 9, known.history.shape)
    hidden = ~known.observed
    other = replace(known, history=np.where(hidden[..., None], garbage, known.history))
    assert scale()(other) == pytest.approx(scale()(known), rel=1e-12)


def test_a_joint_that_is_hidden_now_gives_finite_inputs():
    known = evidence()
    known.history[:, :, WRIST] = np.nan
    known.observed[:, :, WRIST] = False
    knots = knots_within(25)
    assert np.isfinite(inputs_now(known, RATE_HZ, CANONICAL)).all()
    assert np.isfinite(inputs_ahead(known, knots, RATE_HZ)).all()


@pytest.mark.parametrize("back", range(1, 15))
def test_a_short_history_is_read_as_far_as_it_goes(back):
    known = evidence(back=15)
    known.observed[:] = True
    steady = np.arange(15)[:, None, None] * np.array([0.04, 0.0, 0.0])  # 1 m/s
    history = np.broadcast_to(known.history[:, :1] + steady, known.history.shape)
    long = replace(known, history=history)
    short = replace(long, history=history[:, -back:], observed=long.observed[:, -back:])
    assert np.isfinite(scale()(short)).all()
    if back > 2:  # who goes on evenly is as fast over any time
        found, whole = (inputs_now(k, RATE_HZ, CANONICAL) for k in (short, long))
        # 64 bits: positions of metres to 1e-15, times 25 steps per second and 5 (8 for the change)
        assert found == pytest.approx(whole, abs=1e-11)


def test_inputs_by_hand():
    """The wrist goes 2 m/s, the rest 1 m/s: the same way for long; then the wrist's error."""
    back = np.arange(15)[:, None, None] / RATE_HZ
    velocity = np.tile([1.0, 0.0, 0.0], (COUNT, 1))
    velocity[WRIST] = [2.0, 0.0, 0.0]
    error = np.zeros((1, 2, COUNT))
    error[0, 0, WRIST] = 0.21
    error[0, 1] = np.nan
    history = (back * velocity)[None]
    known = Evidence(
        history=history,
        observed=np.ones((1, 15, COUNT), bool),
        forecast=history[:, -1:] + np.arange(1, 26)[:, None, None] / RATE_HZ * velocity,
        error_m=error,
        residual_m=np.array([0.1]),
        std=np.full((1, 25, COUNT), 0.03),
    )
    found = dict(zip(NOW, inputs_now(known, RATE_HZ, CANONICAL)[0, WRIST], strict=True))
    speed, wrong = (lambda x: np.log1p(5 * x)), (lambda x: np.log1p(20 * x))
    wanted = {
        "speed_1": speed(2), "speed_3": speed(2), "speed_10": speed(2), "to_trunk": speed(1),
        "change": 0, "path": speed(2), "shake": 0, "trunk": speed(1), "fastest": speed(2),
        "mean_speed": speed(22 / 21), "seen": 1,
        "error_short": wrong(0.21), "error_long": 0, "no_short": 0, "no_long": 1,
        "body_short": wrong(0.01), "body_long": 0, "residual": wrong(0.1), "no_residual": 0,
    }  # fmt: skip
    assert found == pytest.approx(wanted, abs=1e-9)  # as above: 1e-12 and a root of it of 0
    ahead = inputs_ahead(known, np.array([1, 10]), RATE_HZ)[0, :, WRIST]
    assert ahead == pytest.approx(
        np.array(
            [
                [speed(0.08), speed(2), 0.04, np.log(0.04), wrong(0.03)],
                [speed(0.8), speed(2), 0.4, np.log(0.4), wrong(0.03)],
            ]
        )
    )
    alone = inputs_ahead(replace(known, std=None), np.array([1, 10]), RATE_HZ)[0, :, WRIST]
    np.testing.assert_array_equal(alone, [[*row[:4], 0.0] for row in ahead])


# -- what is not known ----------------------------------------------------------------------------


def test_an_unknown_past_error_is_told_from_one_of_zero():
    zero = replace(evidence(), error_m=np.zeros((2, 2, COUNT)), residual_m=np.zeros(2))
    none = replace(zero, error_m=np.full((2, 2, COUNT), np.nan), residual_m=np.full(2, np.nan))
    for name in ("no_short", "no_long", "no_residual"):
        own = scale(scale_of(**{name: np.log(2.0)}))
        assert own(none) == pytest.approx(2.0 * own(zero))


@pytest.mark.parametrize("name", ["error_short", "error_long", "body_short", "body_long"])
def test_an_infinite_past_error_is_a_large_one(name):
    own = scale(scale_of(**{name: 0.1}))
    zero = replace(evidence(), error_m=np.zeros((2, 2, COUNT)))
    endless = replace(zero, error_m=np.full((2, 2, COUNT), np.inf))
    assert (own(endless) > own(zero)).all()
    assert np.isfinite(own(endless)).all()


def test_a_forecast_that_is_no_number_leaves_its_joint_unbounded():
    known = evidence()
    known.observed[:] = True
    known.forecast[0, 4:, HEAD] = np.nan
    found = scale()(known)
    assert np.isinf(found[0, 4:, HEAD]).all()
    assert np.isfinite(np.delete(found[0], HEAD, axis=1)).all()
    assert np.isfinite(found[1]).all()


def test_joints_of_no_known_kind_are_unbounded():
    skeleton = make_skeleton("odd", ["waist", "neck", "tail"], [-1, 0, 0])
    known = evidence()
    some = replace(
        known,
        history=known.history[:, :, :3],
        observed=known.observed[:, :, :3],
        forecast=known.forecast[:, :, :3],
        error_m=known.error_m[..., :3],
        std=known.std[..., :3],
    )
    assert kind_of(skeleton).tolist() == [KINDS.index("waist"), KINDS.index("neck"), -1]
    found = scale(skeleton=skeleton)(some)
    assert np.isfinite(found[..., :2]).all()
    assert np.isinf(found[..., 2]).all()


def unless_compiled(scale_of_all):
    """The array operations instead of the compiled loops."""
    return scale_of_all.__wrapped__


@pytest.mark.parametrize("by", [lambda own: own, unless_compiled], ids=["loops", "arrays"])
@given(seed=SEEDS)
def test_it_is_the_network_in_double_precision_to_the_rounding_of_single(by, seed):
    own, known = network(seed), evidence(seed)
    expected, error = double_precision(own, known)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learned_scale, "_scale", by(learned_scale._scale))
        found = np.log(scale(own)(known))
    bounded = np.clip(expected, np.log(LEAST_M), np.log(MOST_M))
    assert error < 1e-3
    assert found == pytest.approx(bounded, abs=error)


# -- what it gives --------------------------------------------------------------------------------


@given(SEEDS, st.integers(1, 40))
def test_it_never_shrinks_with_the_horizon_and_stays_within_its_bounds(seed, steps):
    own = network(seed)
    (first, second, (weights, bias)) = own.layers
    steep = replace(own, layers=(first, second, (20 * weights, bias)))
    found = scale(steep, steps)(evidence(seed, steps=steps))
    assert found.shape == (2, steps, COUNT)
    # between knots that are equal, a + part x (b - a) is rounded: a few units of ln 0.01 = 4.6
    assert (np.diff(np.log(found), axis=1) >= -1e-14).all()
    # e^(ln x) is x to a few units in the last place
    assert (found >= LEAST_M * (1 - 1e-12)).all()
    assert (found <= MOST_M * (1 + 1e-12)).all()


def test_between_knots_the_logarithm_is_linear():
    known = evidence()
    log = np.log(scale(scale_of(lead=1.0))(known))[0, :, 0]  # ln scale = lead, in seconds
    assert log == pytest.approx(np.arange(1, 26) / RATE_HZ)
    # a bend at a knot: the displacement alone, and steps 16 to 19 lie between 15 and 20
    log = np.log(scale(scale_of(moved=0.1))(known))[0, :, WRIST]
    assert log[14:20] == pytest.approx(np.linspace(log[14], log[19], 6))


def test_knots_are_those_below_the_horizon_and_its_last_step():
    assert knots_within(30).tolist() == list(KNOT_STEPS)
    assert knots_within(25).tolist() == [1, 2, 3, 5, 8, 11, 15, 20, 25]
    assert knots_within(12).tolist() == [1, 2, 3, 5, 8, 11, 12]
    assert knots_within(1).tolist() == [1]


# -- stored ---------------------------------------------------------------------------------------


def test_stored_and_read_it_is_the_same_to_rounding():
    own = network()
    back = ScaleNetwork.of_json(own.to_json())
    # each of 28, 16 and 16 weights is off by 5e-6 at most, inputs are 4 at most, hidden values
    # about 4, and two layers pass it on by about 4 each: 28 x 4 x 5e-6 x 16 = 0.01 of a logarithm
    assert scale(back)(evidence()) == pytest.approx(scale(own)(evidence()), rel=0.01)
    assert back.to_json() == own.to_json()


def test_a_network_from_before_the_spread_was_an_input_is_read_and_ignores_it():
    own, at = network(), len(NOW) + len(AHEAD) - 1
    own.layers[0][0][at] = 0.0
    data = own.to_json()
    data["mean"].pop()
    data["deviation"].pop()
    data["layers"][0]["weights"].pop(at)
    old = ScaleNetwork.of_json(data)
    known = evidence()
    np.testing.assert_allclose(scale(old)(known), scale(own)(known), rtol=1e-3)  # 5 decimals
    np.testing.assert_array_equal(scale(old)(known), scale(old)(replace(known, std=None)))


def test_a_network_that_overflows_is_unbounded_and_does_not_fail():
    own = network()
    huge = replace(own, layers=tuple((w * 1e200, b) for w, b in own.layers))
    with np.errstate(over="ignore", invalid="ignore"):
        found = scale(huge)(evidence())
    assert (np.isinf(found) | (found >= LEAST_M * (1 - 1e-12))).all()
    assert not np.isnan(found).any()


@pytest.mark.parametrize("rows", [0, 5, 22])
def test_a_network_of_0_2_with_too_few_rows_is_refused(rows):
    data = network().to_json()
    data["mean"].pop()
    data["deviation"].pop()
    data["layers"][0]["weights"] = data["layers"][0]["weights"][:rows] or [[]]
    with pytest.raises(ValueError, match="mean or deviation does not fit"):
        ScaleNetwork.of_json(data)


def test_a_spread_of_another_shape_is_refused_rather_than_read_past_its_end():
    known = evidence()
    assert known.std is not None
    with pytest.raises(ValueError, match="not that of the forecast"):
        scale()(replace(known, std=known.std[:, :3]))


def test_a_missing_spread_is_not_taken_for_none_at_all():
    known = replace(evidence(), std=None)
    assert np.isinf(scale()(known)).all()
    own = network()
    own.layers[0][0][len(NOW) + AHEAD.index("spread")] = 0.0  # it does not read the spread
    assert np.isfinite(scale(own)(known)).any()
