"""Shoulders and hips that are lost for a moment keep the body's heading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.inferring import LONGEST_S, PER_S, carry
from hri_sim.people.body import Body

_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.0))
SHOULDERS = [JOINTS.index("l_shoulder"), JOINTS.index("r_shoulder")]
UPPER = [JOINTS.index(f"{s}_{n}") for s in "lr" for n in ("shoulder", "elbow", "wrist")]
UPPER.append(JOINTS.index("head"))
RATE_HZ = 25.0


def walk(steps=20, gap=range(0)):
    """A body that moves 0.04 m a step, its upper half measured, no shoulder in the gap."""
    positions = BODY + np.arange(steps)[None, :, None, None] * [0.04, 0, 0]
    measured = np.zeros(positions.shape[:3], np.bool_)
    measured[:, :, UPPER] = True
    for step in gap:
        measured[:, step, SHOULDERS] = False
    return np.where(measured[..., None], positions, 7.0), measured, positions


def test_a_pair_goes_on_with_the_head_and_grows_uncertain():
    positions, measured, true = walk(gap=range(12, 16))
    found = carry(positions, measured, RATE_HZ)
    assert found.observed[:, :, SHOULDERS].all()
    np.testing.assert_allclose(found.positions[:, :, SHOULDERS], true[:, :, SHOULDERS], atol=1e-9)
    np.testing.assert_allclose(found.within_m[0, 11:17, SHOULDERS[0]] / PER_S,
                               [0, 0.04, 0.08, 0.12, 0.16, 0], atol=1e-9)  # fmt: skip


@pytest.mark.parametrize("wrong", [range(11, 12), range(10, 12)])
def test_a_pair_whose_sides_were_mistaken_is_not_carried(wrong):
    positions, measured, true = walk(gap=range(12, 16))
    for step in wrong:
        positions[0, step, SHOULDERS] = true[0, step, SHOULDERS[::-1]]
    found = carry(positions, measured, RATE_HZ)
    assert not found.observed[0, 12:16, SHOULDERS].any()


def test_it_ends_when_it_is_too_long_ago():
    longest = round(LONGEST_S * RATE_HZ)
    positions, measured, _ = walk(steps=30, gap=range(10, 30))
    found = carry(positions, measured, RATE_HZ)
    held = found.observed[0, :, SHOULDERS[0]]
    assert held[: 10 + longest - 1].all()
    assert not held[10 + longest :].any()


def test_one_shoulder_that_is_seen_stays_as_measured():
    positions, measured, true = walk(gap=range(12, 14))
    measured[0, 12, SHOULDERS[0]] = True
    positions[0, 12, SHOULDERS[0]] = true[0, 12, SHOULDERS[0]] + 0.01
    found = carry(positions, measured, RATE_HZ)
    np.testing.assert_array_equal(
        found.positions[0, 12, SHOULDERS[0]], positions[0, 12, SHOULDERS[0]]
    )
    assert found.within_m[0, 12, SHOULDERS[0]] == 0 < found.within_m[0, 12, SHOULDERS[1]]


@pytest.mark.parametrize("gap", [range(20), range(3)])
def test_nothing_is_carried_that_was_never_seen(gap):
    positions, measured, _ = walk(gap=gap)
    np.testing.assert_array_equal(carry(positions, measured, RATE_HZ).observed, measured)


@given(st.integers(0, 2**32 - 1))
def test_what_is_measured_is_never_changed(seed):
    rng = np.random.default_rng(seed)
    positions = rng.normal(0, 1, (2, 12, len(JOINTS), 3))
    measured = rng.random(positions.shape[:3]) < rng.random()
    found = carry(positions, measured, RATE_HZ)
    np.testing.assert_array_equal(found.positions[measured], positions[measured])
    assert (found.observed >= measured).all()
    assert ((found.within_m > 0) == (found.observed & ~measured)).all()
    assert np.isfinite(found.positions).all()


def test_hidden_legs_stay_inferred_while_the_shoulders_flicker(make_room):
    room = make_room()

    def person(*hidden):
        seen = np.zeros(len(JOINTS), np.bool_)
        seen[UPPER] = True
        seen[list(hidden)] = False
        return Person(1, BODY, seen)

    steady = room.see(person(), times=12)
    knee = JOINTS.index("l_knee")
    assert steady.inferred.joints[0, knee]
    flickers = room.see(person(*SHOULDERS), times=3)
    assert flickers.inferred.joints[0, [*SHOULDERS, knee]].all()
    assert not flickers.fresh[0, SHOULDERS].any()
    more_m = flickers.inferred.within_m[0, knee] - steady.inferred.within_m[0, knee]
    assert more_m > 0.05  # the heading of a moment ago is less certain
