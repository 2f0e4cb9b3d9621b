"""Disturbed input: the shares asked for, the same for every predictor, and nothing else changed."""

import numpy as np
import pytest

from hri_predict.lab.datasets.corruption import LIMBS, Corruption, standard
from hri_predict.predictors.neural.body import BODY

SHAPE = (200, 15, len(BODY.joints))


@pytest.fixture
def history():
    return np.random.default_rng(3).normal(size=(*SHAPE, 3))


def apply(corruption, history, observed=None, name="walking_1", batch=0):
    seen = np.ones(history.shape[:3], bool) if observed is None else observed
    return corruption.apply(history, seen, (name, batch), 15)


@pytest.mark.parametrize("corruption", standard(), ids=lambda c: c.name)
def test_same_bytes_again_and_the_input_is_left_alone(corruption, history):
    kept, observed = history.copy(), np.ones(SHAPE, bool)
    first, again = (apply(corruption, history, observed) for _ in range(2))
    assert np.array_equal(history, kept)
    assert observed.all()
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    other = apply(corruption, history, name="soccer_1")
    assert not (np.array_equal(first[0], other[0]) and np.array_equal(first[1], other[1]))


@pytest.mark.parametrize("corruption", standard(), ids=lambda c: c.name)
def test_a_longer_history_is_disturbed_the_same_in_its_newest_steps(corruption, history):
    older = np.zeros((200, 35, *history.shape[2:]))
    long, long_seen = apply(corruption, np.concatenate([older, history], axis=1))
    short, short_seen = apply(corruption, history)
    assert np.array_equal(long[:, -15:], short)
    assert np.array_equal(long_seen[:, -15:], short_seen)


def test_missing_joint_frames_have_their_share_and_what_was_unobserved_stays_so(history):
    observed = np.ones(SHAPE, bool)
    observed[:, :, 5] = False
    moved, seen = apply(Corruption("missing", 0.3), history, observed)
    assert np.array_equal(moved, history)
    assert not seen[:, :, 5].any()
    assert np.delete(seen, 5, axis=2).mean() == pytest.approx(0.7, abs=0.01)


def test_dropped_frames_are_whole_and_never_the_capture_itself(history):
    _, seen = apply(Corruption("frames", 0.3), history)
    assert seen[:, -1].all()
    assert np.array_equal(seen.all(axis=2), seen.any(axis=2))
    assert seen[:, :-1].mean() == pytest.approx(0.7, abs=0.03)


@pytest.mark.parametrize(("share", "steps"), [(0.4, 6), (1.0, 15)])
def test_one_whole_limb_is_occluded(history, share, steps):
    _, seen = apply(Corruption("limb", share), history)
    hidden = ~seen
    assert not hidden[:, : 15 - steps].any()
    chosen = {tuple(np.flatnonzero(window[-1])) for window in hidden}
    assert chosen == set(LIMBS)
    assert (hidden[:, 15 - steps :] == hidden[:, -1:]).all()


def test_noise_has_its_share_and_size(history):
    moved, seen = apply(Corruption("noise", 0.3, 0.05), history)
    change = moved - history
    assert seen.all()
    assert (change != 0).mean() == pytest.approx(0.3, abs=0.01)
    assert change[change != 0].std() == pytest.approx(0.05, rel=0.02)


def test_names_tell_corruptions_apart():
    names = [c.name for c in standard()]
    assert len(set(names)) == len(names) == 19
    assert "30 % of joint-frames missing" in names
    assert "noise of 50 mm on 30 % of coordinates" in names
