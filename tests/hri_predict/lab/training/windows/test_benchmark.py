"""The benchmark's train windows as batches."""

import numpy as np
import pytest
import torch
import yaml

from hri_predict.base.errors import ConfigError, HriPredictError, RecordingError
from hri_predict.base.settings import validated
from hri_predict.lab.datasets.cmu_benchmark import from_model, read_clip, to_model
from hri_predict.lab.training.loop import fingerprint
from hri_predict.lab.training.windows.benchmark import BenchmarkData, BenchmarkSamples
from hri_predict.predictors.neural.cmu_skeleton import CMU25, CMU38, MOVING
from tests.shared import DATA, needs_data

FRAMES = {
    "train/walking_1": 400,
    "train/walking_2": 120,
    "train/soccer_1": 90,
    "train/soccer_2": 80,
    "train/walking_extra_1": 200,
}


@pytest.fixture
def pack(tmp_path):
    """A small pack; every frame of a recording has the recording's number in it."""
    (tmp_path / "test").mkdir()
    (tmp_path / "train").mkdir()
    rng = np.random.default_rng(0)
    for k, (name, frames) in enumerate(FRAMES.items()):
        expmap = rng.normal(size=(frames, 117), scale=0.1)
        expmap[:, 3] = k
        np.savez(tmp_path / f"{name}.npz", expmap=expmap.astype(np.float32))
    splits = {"fit": ["train/walking_1", "train/soccer_1", "train/walking_extra_1"]}
    splits["validation"] = ["train/walking_2", "train/soccer_2"]
    (tmp_path / "splits.yaml").write_text(yaml.safe_dump({"version": 2, "benchmark": splits}))
    return tmp_path


def opened(pack, history=10, horizon=25, **changes):
    data = {"root": pack, "splits": str(pack / "splits.yaml"), **changes}
    return BenchmarkSamples(BenchmarkData(**data), history, horizon)


def of(fit, validation):
    return f"version: 2\nbenchmark: {{fit: [{fit}], validation: [{validation}]}}\n"


def recordings_of(samples):
    return set(samples.history[:, 0, 0, 0].round().int().tolist())


def test_windows_are_those_of_the_fitted_recordings_alone(pack):
    source = opened(pack, history=5, horizon=10, space="rotations")
    assert source.actions == ("soccer", "walking")
    assert source.window_count == (200 - 14) + (45 - 14)
    batch = source.batch(np.random.default_rng(0), 200)
    assert recordings_of(batch) == {0, 2}
    assert batch.history.shape == (200, 5, 38, 3)
    assert batch.future.shape == (200, 10, 38, 3)
    assert batch.observed.all()
    assert batch.known.all()
    validation = list(source.validation())
    assert set().union(*map(recordings_of, validation)) == {1, 3}


def test_a_refit_fits_all_but_walking_extra_and_has_no_validation(pack):
    source = opened(pack, history=5, horizon=10, space="rotations", refit=True)
    assert recordings_of(source.batch(np.random.default_rng(0), 500)) == {0, 1, 2, 3}
    assert list(source.validation()) == []
    chosen = opened(pack, history=5, horizon=10, space="rotations")
    assert fingerprint(source) != fingerprint(chosen)


def test_one_action_alone_as_sinn_s_paper_trains(pack):
    source = opened(pack, history=5, horizon=10, space="rotations", actions=["walking"])
    assert source.actions == ("walking",)
    assert source.window_count == 200 - 14
    with pytest.raises(ConfigError, match=r"data.actions dance: .* available: soccer, walking"):
        opened(pack, history=5, horizon=10, space="rotations", actions=["walking", "dance"])


def test_batches_are_balanced_by_action_unless_told_otherwise(pack):
    share = {}
    for balanced in (True, False):
        source = opened(pack, balanced=balanced)
        batch = source.batch(np.random.default_rng(1), 2000)
        share[balanced] = float((batch.actions == source.actions.index("soccer")).float().mean())
    windows = {"soccer": 45 - 34, "walking": 200 - 34}
    assert share[True] == pytest.approx(0.5, abs=0.05)
    assert share[False] == pytest.approx(windows["soccer"] / sum(windows.values()), abs=0.03)


def test_the_same_generator_gives_the_same_batch(pack):
    source = opened(pack)
    one, two = (source.batch(np.random.default_rng(4), 16) for _ in range(2))
    assert torch.equal(one.history, two.history)
    assert torch.equal(one.future, two.future)
    assert not torch.equal(one.history, source.batch(np.random.default_rng(5), 16).history)


def test_positions_are_the_benchmarks_in_metres_with_z_up(pack):
    source = opened(pack)
    assert source.shape.skeleton is CMU25
    assert source.shape.framed
    mm = read_clip(pack, "train/walking_1").positions()[:, MOVING]
    batch = source.batch(np.random.default_rng(0), 8)
    windows = torch.cat([batch.history, batch.future], dim=1).numpy()
    walking = windows[batch.actions.numpy() == source.actions.index("walking")]
    expected = (mm[..., [2, 0, 1]] / 1000).astype(np.float32)
    for window in walking:  # a stretch of the recording without a gap
        (start,) = np.flatnonzero((expected == window[0]).all((1, 2)))
        np.testing.assert_array_equal(window, expected[start : start + 35])
    np.testing.assert_allclose(from_model(to_model(mm)), mm)
    assert opened(pack, history=5, horizon=10, space="rotations").shape.skeleton is CMU38


def windows_of(source, seed=3):
    batch = source.batch(np.random.default_rng(seed), 16)
    return torch.cat([batch.history, batch.future], 1)


def test_reversed_and_mirrored_windows_are_the_drawn_ones(pack):
    plain = windows_of(opened(pack))
    assert torch.equal(windows_of(opened(pack, reverse=1.0)), plain.flip(1))
    mirrored = windows_of(opened(pack, mirror=1.0))
    pairs = CMU25.left_right_pairs
    assert len(pairs) == 10
    for left, right in pairs:
        for one, other in ((left, right), (right, left)):
            flipped = plain[:, :, one] * torch.tensor([1.0, -1.0, 1.0])
            assert torch.equal(mirrored[:, :, other], flipped)
    some = windows_of(opened(pack, reverse=0.5))
    same = (some == plain).all((1, 2, 3)).float().mean()
    assert 0.1 < same < 0.9  # 16 draws of one half


def test_rotations_are_not_mirrored(pack):
    with pytest.raises(HriPredictError, match="rotations cannot be mirrored"):
        validated(BenchmarkData, {"root": pack, "space": "rotations", "mirror": 0.5}, "data")


def test_validation_windows_weigh_the_actions_alike(pack):
    source = opened(pack, history=5, horizon=10, validation_windows=12)
    actions = torch.cat([s.actions for s in source.validation()])
    assert torch.bincount(actions).tolist() == [12, 12]


def test_mistakes_are_named_in_one_line(pack):
    with pytest.raises(ConfigError, match="no train recording of 400 frames"):
        opened(pack, history=375)
    with pytest.raises(ConfigError, match="root"):
        opened(pack / "test")
    (pack / "splits.yaml").write_text(of("train/walking_9", "train/walking_1"))
    with pytest.raises(RecordingError, match="walking_9"):
        opened(pack)
    (pack / "splits.yaml").write_text(of("train/dancing_1", ""))
    with pytest.raises(ConfigError, match="names no recording"):
        opened(pack)


def test_something_must_validate_that_is_not_fitted(pack):
    with pytest.raises(ConfigError, match="no recording in validation has 70 frames"):
        opened(pack, history=45)
    assert opened(pack, history=45, refit=True).window_count > 0
    (pack / "splits.yaml").write_text(of("train/walking_1, train/walking_2", "train/walking_2"))
    with pytest.raises(ConfigError, match="train/walking_2 is both in fit and in validation"):
        opened(pack)


@needs_data
def test_all_train_windows_of_the_pack():
    source = BenchmarkSamples(BenchmarkData(root=DATA, refit=True), 10, 25)
    assert source.window_count == 15818  # as the pack's own table counts them
    chosen = BenchmarkSamples(BenchmarkData(root=DATA), 10, 25)
    assert len(chosen.actions) == 7
    assert chosen.window_count < source.window_count
    assert chosen.rest().shape == (25, 3)
