"""A live depth tracker errs along its ray, for a while, with heavy tails; bones and bursts."""

import itertools

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration import depth_tracker
from hri_predict.lab.calibration.depth_tracker import CHAINS, DROPPED, DepthTracker, ar1
from hri_predict.lab.calibration.presence import Presence
from hri_predict.zones.input_noise import input_noise_m

FRAMES = 600
BODY = np.random.default_rng(3).uniform(-0.5, 0.5, (len(JOINTS), 3)) + np.array([0.0, 0.0, 1.0])


def standing(frames=FRAMES, rate_hz=30.0):
    """A person who does not move at all."""
    return Presence(
        np.round(np.arange(frames) * 1e9 / rate_hz).astype(np.int64),
        np.repeat(BODY[None], frames, axis=0),
        np.ones((frames, len(JOINTS)), bool),
        rate_hz,
    )


def errors(tracker, seed=0):
    seen = tracker.seen(standing(), seed)
    return np.where(seen.observed[..., None], seen.positions - BODY, np.nan)


def test_noise_is_of_its_seed_and_grows_with_strength():
    assert np.array_equal(errors(DepthTracker()), errors(DepthTracker()), equal_nan=True)
    assert not np.array_equal(errors(DepthTracker()), errors(DepthTracker(), 1), equal_nan=True)
    sizes = [np.nanmedian(np.abs(errors(DepthTracker(strength=s)))) for s in (0.5, 1.0, 2.0)]
    assert sizes == sorted(sizes)
    assert sizes[2] == pytest.approx(4 * sizes[0], rel=0.2)
    assert 0.002 < sizes[1] < 0.05


def test_errors_lie_along_the_ray(monkeypatch):
    monkeypatch.setattr(depth_tracker, "BONE", 0.0)
    monkeypatch.setattr(depth_tracker, "_camera", lambda rng, presence: np.array([3.0, 0, 1]))
    error = errors(DepthTracker())
    ray = (BODY - [3.0, 0, 1]) / np.linalg.norm(BODY - [3.0, 0, 1], axis=-1, keepdims=True)
    along = np.einsum("fji,ji->fj", error, ray)
    across = np.linalg.norm(error - along[..., None] * ray, axis=-1) / np.sqrt(2.0)
    assert np.nanmedian(np.abs(along)) > 2 * np.nanmedian(across)


def test_errors_grow_with_the_square_of_the_distance(monkeypatch):
    monkeypatch.setattr(depth_tracker, "BONE", 0.0)
    size = {}
    for far_m in (4.0, 8.0):
        place = np.array([far_m, 0.0, 1.0])
        monkeypatch.setattr(depth_tracker, "_camera", lambda rng, presence, at=place: at)
        size[far_m] = np.nanmedian(np.linalg.norm(errors(DepthTracker()), axis=-1))
    assert size[8.0] == pytest.approx(4 * size[4.0], rel=0.1)


def test_errors_last_and_have_heavy_tails():
    dt_s = np.full(20_000, 0.04)
    noise = ar1(np.random.default_rng(0), dt_s, 0.4, (20_001,))
    assert noise.std() == pytest.approx(1.0, abs=0.1)
    assert np.corrcoef(noise[:-10], noise[10:])[0, 1] == pytest.approx(np.exp(-1), abs=0.1)
    heavy = ar1(np.random.default_rng(0), dt_s, 0.001, (20_001,), tail=3.0)
    assert heavy.std() == pytest.approx(1.0, abs=0.3)  # the variance of heavy tails settles slowly
    assert np.mean(np.abs(heavy) > 4) > 10 * np.mean(np.abs(noise) > 4)


def test_bones_change_their_length_and_carry_what_hangs_on_them(monkeypatch):
    monkeypatch.setattr(depth_tracker, "DEPTH_M", 0.0)
    seen = DepthTracker().seen(standing(), 0).positions
    lengths = []
    for chain in CHAINS:
        for inner, outer in itertools.pairwise(JOINTS.index(name) for name in chain):
            length = np.linalg.norm(seen[:, outer] - seen[:, inner], axis=-1)
            lengths.append(length / np.linalg.norm(BODY[outer] - BODY[inner]))
    moving = [np.quantile(length[length > 0.5], 0.9) for length in lengths]
    assert np.median(moving) == pytest.approx(1.03, abs=0.03)
    assert np.allclose(seen[seen[:, 0, 0] != 0][:, JOINTS.index("waist")], BODY[0])  # no bone


def test_joints_drop_out_in_bursts():
    seen = DepthTracker().seen(standing(6000), 0).observed
    gone = ~seen
    assert gone.mean() == pytest.approx(DROPPED, rel=0.3)
    stays = (gone[1:] & gone[:-1]).sum() / gone[:-1].sum()
    assert stays > 0.8  # by itself each capture would be lost in 3 of 100 cases


def test_unseen_joints_stay_unseen_and_captures_come_at_its_rate():
    presence = standing(480, rate_hz=120.0)
    presence.observed[:, 7] = False
    presence.positions[:, 7] = np.nan
    seen = DepthTracker().seen(presence, 0)
    assert len(seen.stamps_ns) == 120
    assert seen.rate_hz == pytest.approx(30.0, rel=0.01)
    assert not seen.observed[:, 7].any()
    assert (seen.positions[~seen.observed] == 0).all()
    assert np.isfinite(seen.positions).all()


def test_the_node_measures_what_the_tracker_does():
    found = []
    for strength in (0.0, 1.0, 2.0):
        seen = DepthTracker(strength=strength).seen(standing(25, 25.0), 4)
        noise = input_noise_m(seen.positions[None], seen.observed[None], CANONICAL)
        found.append(float(noise[0]))
    assert found[0] == 0.0 < found[1] < found[2]
