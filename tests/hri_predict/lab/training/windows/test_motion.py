"""Training windows are cut where and when they say, from real recordings and a user's own."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from hri_predict.base.errors import ConfigError, HriPredictError, RecordingError
from hri_predict.base.settings import validated
from hri_predict.lab.datasets.tracks import Track, read_tracks
from hri_predict.lab.training.windows.augment import AugmentSettings
from hri_predict.lab.training.windows.bodies import BodySettings
from hri_predict.lab.training.windows.clips import Clips
from hri_predict.lab.training.windows.motion import DataSettings, MotionSamples
from hri_predict.lab.training.windows.trackers import TrackerSettings
from hri_predict.predictors.neural.body import BODY, CMU38
from hri_predict.predictors.neural.network import Shape
from tests.shared import DATA, needs_data

SHAPE = Shape(skeleton=BODY, history_steps=15, horizon_steps=25, rate_hz=25.0)
PLAIN = AugmentSettings(
    mirror=0, yaw=False, scale=0, warp=0, slow=0, reverse=0, truncate=0, noise=0, outliers=0,
    missing=0, limb=0, frames=0, sparse=0, arms=0,
)  # fmt: skip
AS_RECORDED = {
    "bodies": BodySettings(share=0),
    "trackers": TrackerSettings(rate=0, dropped=0, noise=0, convention=0),
}


def write_line(folder: Path, name: str, frames: int = 300, fps: float = 120.0) -> Path:
    """Everything moves at (1, 2, 3) m/s (forward, left, up): any resampling must show that."""
    start = np.random.default_rng(5).normal(size=(1, 38, 3))
    time = np.arange(frames)[:, None, None] / fps
    positions = start + time * np.array([2.0, 3.0, 1.0])  # the file's axes: left, up, forward
    path = folder / f"{name}.npz"
    np.savez(
        path, positions_world=positions.astype(np.float32), fps=np.float32(fps),
        world_ok=np.ones(frames, bool), rest_pose_frames=np.int32(0), floor_height=np.float32(0),
    )  # fmt: skip
    return path


@pytest.fixture
def folder(tmp_path) -> Path:
    write_line(tmp_path, "line_1")
    write_line(tmp_path, "line_2", frames=400)
    write_line(tmp_path, "check_1", frames=250, fps=50.0)
    return tmp_path


def samples(folder: Path, augment: AugmentSettings = PLAIN) -> MotionSamples:
    settings = DataSettings(root=folder, fit=["line_*.npz"], validation=["check_1.npz"])
    return MotionSamples(settings.model_copy(update={"augment": augment} | AS_RECORDED), SHAPE)


def test_steps_are_a_25th_of_a_second_apart(folder):
    batch = samples(folder).batch(np.random.default_rng(1), 64)
    whole = torch.cat([batch.history, batch.future], 1)
    seen = torch.cat([batch.observed, batch.known], 1)
    step = whole.diff(dim=1)[seen[:, 1:] & seen[:, :-1]]
    torch.testing.assert_close(
        step, torch.tensor([1.0, 2.0, 3.0]).expand_as(step) / 25, rtol=0, atol=2e-5
    )
    assert seen[:, SHAPE.history_steps - 1].all()  # a window ends at something observed


def test_the_past_of_a_noisy_history_is_without_its_noise(folder):
    augment = PLAIN.model_copy(update={"noise": 1.0, "outliers": 1.0})
    noise = AS_RECORDED["trackers"].model_copy(update={"noise": 1.0, "correlated": 1.0})
    source = samples(folder, augment)
    source._settings = source._settings.model_copy(update={"trackers": noise})
    batch = source.batch(np.random.default_rng(1), 64)
    assert batch.past is not None
    assert batch.past_known is not None
    ahead = torch.tensor([1.0, 2.0, 3.0]) / 25
    for positions, known, least, most in (
        (batch.past, batch.past_known, 0.0, 2e-5),
        (batch.history, batch.observed, 0.01, 1.0),
    ):
        error = (positions.diff(dim=1) - ahead)[known[:, 1:] & known[:, :-1]].abs().max()
        assert least <= float(error) < most
    both = batch.past_known[:, -1] & batch.known[:, 0]  # it leads on to the future
    step = (batch.future[:, 0] - batch.past[:, -1])[both]
    torch.testing.assert_close(step, ahead.expand_as(step), rtol=0, atol=2e-5)


def test_outside_the_recording_nothing_is_known(folder):
    batch = samples(folder).batch(np.random.default_rng(2), 256)
    assert not batch.known.all()
    assert not batch.observed.all()
    assert (batch.history[~batch.observed] == 0).all()
    assert batch.known.any(2).sum(1).min() >= 9


@pytest.mark.parametrize("fps", [30.0, pytest.param(120.0, marks=pytest.mark.long)])
@pytest.mark.parametrize("reverse", [0.0, 1.0])
def test_the_history_of_a_random_walk_tells_nothing_about_its_future(tmp_path, fps, reverse):
    frames = 6000
    steps = np.random.default_rng(7).normal(size=(frames, 38, 3)) / 100
    for name in ("walk_1", "check_1"):
        np.savez(
            tmp_path / f"{name}.npz",
            positions_world=steps.cumsum(0).astype(np.float32), fps=np.float32(fps),
            world_ok=np.ones(frames, bool), rest_pose_frames=np.int32(0),
            floor_height=np.float32(0),
        )  # fmt: skip
    augment = PLAIN.model_copy(update={"reverse": reverse})
    source = opened(tmp_path, ["walk_1.npz"], ["check_1.npz"], augment=augment)
    for batch in (source.batch(np.random.default_rng(1), 2000), next(source.validation())):
        last = batch.history[:, -1] - batch.history[:, -2]
        ahead = batch.future[:, 0] - batch.history[:, -1]
        seen = (batch.observed[:, -1] & batch.observed[:, -2] & batch.known[:, 0]).all(1)
        last, ahead = last[seen].flatten(), ahead[seen].flatten()
        correlation = np.corrcoef(last, ahead)[0, 1]
        # independent: its deviation is 1 / sqrt(n); the origins of a batch are drawn anew, so n is
        # the walk's own independent increments at most
        independent = min(len(last), frames * 28 * 3 // 2)
        assert abs(correlation) < 4 / np.sqrt(independent)


def test_warp_changes_the_speed_by_at_most_its_share(folder):
    augment = PLAIN.model_copy(update={"warp": 0.15})
    batch = samples(folder, augment).batch(np.random.default_rng(3), 256)
    both = batch.observed[:, 1:] & batch.observed[:, :-1]
    speed = (batch.history.diff(dim=1).norm(dim=-1) * 25)[both] / np.sqrt(14)
    assert 1 / 1.16 < float(speed.min()) < 0.95
    assert 1.05 < float(speed.max()) < 1.16


def test_slowed_windows_move_at_any_speed_down_to_a_stop(folder):
    augment = PLAIN.model_copy(update={"slow": 0.5})
    batch = samples(folder, augment).batch(np.random.default_rng(3), 256)
    both = (batch.observed[:, 1:] & batch.observed[:, :-1]).all(2)
    step = batch.history.diff(dim=1).norm(dim=-1).mean(2) * 25 / np.sqrt(14)
    speed = (step * both).sum(1) / both.sum(1)
    assert speed.max() < 1.01
    assert 0.4 < (speed < 0.99).float().mean() < 0.6
    assert (speed < 0.1).any()


def test_reversed_windows_are_the_recording_played_backwards(folder):
    augment = PLAIN.model_copy(update={"reverse": 0.5})
    batch = samples(folder, augment).batch(np.random.default_rng(3), 256)
    whole = torch.cat([batch.history, batch.future], 1)
    seen = torch.cat([batch.observed, batch.known], 1)
    both = seen[:, 1:] & seen[:, :-1]
    ahead = torch.tensor([1.0, 2.0, 3.0]) / 25
    sign = (whole.diff(dim=1) / ahead)[both]
    torch.testing.assert_close(sign.abs(), torch.ones_like(sign), rtol=0, atol=1e-3)
    backwards = ((whole.diff(dim=1)[..., 0] < 0) & both).any(2).any(1)
    assert 0.4 < backwards.float().mean() < 0.6
    assert batch.observed[:, -1].all()
    assert batch.known.any(2).sum(1).min() >= 9


def test_the_same_seed_draws_the_same_windows(folder):
    source = samples(folder, AugmentSettings())
    one, two = (source.batch(np.random.default_rng(4), 16) for _ in range(2))
    assert torch.equal(one.history, two.history)
    assert torch.equal(one.observed, two.observed)


def test_validation_is_always_the_same_and_names_its_action(folder):
    source = samples(folder)
    one, two = (list(source.validation()) for _ in range(2))
    assert sum(len(b.history) for b in one) > 40
    for a, b in zip(one, two, strict=True):
        assert torch.equal(a.history, b.history)
        assert {source.actions[int(i)] for i in a.actions} == {"check"}
        assert a.observed.all()


@pytest.mark.long
def test_a_refit_draws_from_the_validation_recordings_and_keeps_none(folder):
    plain = {"root": folder, "fit": ["line_*.npz"], "validation": ["check_1.npz"]}
    refit = MotionSamples(DataSettings(**plain, augment=PLAIN, refit=True), SHAPE)
    assert list(refit.validation()) == []
    drawn = refit.batch(np.random.default_rng(1), 64).actions
    assert {refit.actions[k] for k in drawn} == {"line", "check"}
    drawn = samples(folder).batch(np.random.default_rng(1), 64).actions
    assert {samples(folder).actions[k] for k in drawn} == {"line"}


def test_missing_recordings_are_refused_in_one_line(tmp_path):
    with pytest.raises(ConfigError, match=r"has no cmu_mocap/train/basketball_1\.npz"):
        MotionSamples(DataSettings(root=tmp_path), SHAPE)
    with pytest.raises(ConfigError, match="nothing matches 'x"):
        MotionSamples(DataSettings(root=tmp_path, fit=["x*.npz"], validation=["y.npz"]), SHAPE)


def opened(folder: Path, fit: list[str], validation: list[str], **data) -> MotionSamples:
    given = {"root": folder, "fit": fit, "validation": validation, "augment": PLAIN}
    given |= AS_RECORDED | data
    return MotionSamples(validated(DataSettings, given, "data"), SHAPE)


def changed(folder: Path, name: str, change, **arrays) -> None:
    """``line_1`` with its positions changed."""
    with np.load(folder / "line_1.npz") as file:
        given = dict(file)
    np.savez(
        folder / f"{name}.npz",
        **given | {"positions_world": change(given["positions_world"].astype(float))} | arrays,
    )


def lost(*frames: slice):
    """A change that loses whole frames."""

    def change(positions):
        for part in frames:
            positions[part] = np.nan
        return positions

    return change


def test_recordings_too_short_to_learn_from_are_refused(folder, caplog):
    write_line(folder, "short_1", frames=40)
    with pytest.raises(ConfigError, match=r"^data: no recording lasts 0.6 s; longer ones"):
        opened(folder, ["short_1.npz"], ["check_1.npz"])
    caplog.clear()
    write_line(folder, "short_1", frames=100)  # 0.83 s; 0.96 s are needed
    with pytest.raises(ConfigError, match=r"^data.validation: no recording lasts 0.96 s"):
        opened(folder, ["line_*.npz"], ["short_1.npz"])
    opened(folder, ["line_*.npz"], ["short_1.npz"], refit=True)
    assert not caplog.records
    write_line(folder, "short_1", frames=40)
    opened(folder, ["line_*.npz", "short_1.npz"], ["check_1.npz"])
    assert "short_1.npz: shorter than 0.6 s, left out" in caplog.text


@pytest.mark.parametrize("use", ["fit", "validation"])
@pytest.mark.parametrize(
    ("change", "arrays", "says"),
    [
        (lambda p: p * np.nan, {}, "no person is observed for 0.6 s"),
        (lambda p: p * np.inf, {}, "more than 1000 m away"),
        (lost(slice(None, None, 2)), {}, "no person is observed for 0.6 s"),
        (lambda p: p * 1e200, {}, "more than 1000 m away"),
        (lambda p: p + 1e6, {}, "more than 1000 m away"),
        (lambda p: p, {"fps": 1.0}, "1 frames per second say too little"),
    ],
)
def test_a_recording_of_nothing_is_refused_by_name(folder, use, change, arrays, says):
    changed(folder, "odd_1", change, **arrays)
    names = {"fit": ["line_1.npz"], "validation": ["check_1.npz"]}
    names[use] = [*names[use], "odd_1.npz"]
    with pytest.raises(RecordingError, match=rf"odd_1\.npz: .*{says}") as error:
        opened(folder, **names)
    assert "\n" not in str(error.value)


def test_what_is_not_observed_is_not_drawn_more_often(folder):
    write_line(folder, "line_1", frames=600)
    changed(folder, "lost_1", lost(slice(100, 500)))
    source = opened(folder, ["line_1.npz", "lost_1.npz"], ["check_1.npz"], weights={})
    whole, part = (source._usable_s(t) for t in source._tracks)
    assert whole == pytest.approx(599 / 120 - 0.6)
    assert part == pytest.approx(whole - 401 / 120)
    changed(folder, "lost_1", lost(slice(100, 150), slice(300, 350)))  # windows bridge these
    source = opened(folder, ["line_1.npz", "lost_1.npz"], ["check_1.npz"])
    assert len({source._usable_s(t) for t in source._tracks}) == 1


def test_slow_captures_are_bridged_as_in_the_node(folder):
    changed(folder, "slow_1", lambda p: p, fps=8.0)
    batch = opened(folder, ["slow_1.npz"], ["check_1.npz"]).batch(np.random.default_rng(1), 64)
    assert batch.known[:, :10].all()
    assert batch.observed[:, -5:].all()


def test_a_recording_of_days_does_not_run_into_the_next(folder):
    stamps = np.arange(0, 2 * 10**9 * 86400, 10**9)
    tracks = [
        Track(
            action="line",
            name=name,
            stamps_ns=stamps,
            positions=np.full((stamps.size, 1, 3), place),
            observed=np.ones((stamps.size, 1), bool),
            rate_hz=1.0,
        )
        for name, place in (("one", 1.0), ("two", 2.0))
    ]
    clips = Clips(tracks)
    chosen = np.array([0, 1])
    positions, seen = clips.at(chosen, np.array([clips.last_s[:1] - 5, clips.first_s[1:] + 5]))
    assert seen.all()
    assert positions[:, 0, 0, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("pattern", ["", "**x", "."])
def test_what_is_no_pattern_is_refused(folder, pattern):
    # from Python 3.13 on, "**x" is a pattern: the same as "*x", which matches nothing here
    refusal = r"neither a file nor a pattern|nothing matches '\*\*x'"
    with pytest.raises(ConfigError, match=refusal):
        opened(folder, [pattern], ["check_1.npz"])


def test_a_recording_is_fitted_or_validates(folder):
    with pytest.raises(ConfigError, match=r"line_2\.npz is both in fit and in validation"):
        opened(folder, ["line_*.npz"], ["check_1.npz", str(folder / "line_2.npz")])


@pytest.mark.parametrize(
    ("weights", "says"),
    [
        ({"line": -1.0}, "greater than or equal to 0; got -1"),
        ({"line": 1e308}, "less than or equal to 1000000"),
        ({"line": 0.0}, "data.weights: all fitted actions have 0"),
    ],
)
def test_weights_that_mean_nothing_are_refused(folder, weights, says):
    with pytest.raises(HriPredictError, match=re.escape(says)) as error:
        opened(folder, ["line_*.npz"], ["check_1.npz"], weights=weights)
    assert "\n" not in str(error.value)


def test_a_weight_of_an_action_that_is_not_there_is_told(folder, caplog):
    opened(folder, ["line_*.npz"], ["check_1.npz"], weights={"lien": 5.0})
    assert "no effect for lien; the recordings show" in caplog.text


@needs_data
class TestPack:
    def test_tracks_are_the_files_joints_with_z_up(self):
        path = DATA / "cmu_mocap" / "test" / "walking_1.npz"
        (track,) = read_tracks(path)
        raw = np.load(path)
        expected = raw["positions_world"][1:, CMU38].astype(np.float64)
        expected[..., 1] -= raw["floor_height"]
        np.testing.assert_allclose(track.positions, expected[..., [2, 0, 1]], atol=1e-6)
        assert track.action == "walking"

    def test_assembly_arms_are_partly_observed_bodies(self):
        path = DATA / "assembly" / "task1_human1_trial1.npz"
        (track,) = read_tracks(path)
        seen = {BODY.joints[j] for j in np.flatnonzero(track.observed.any(0))}
        assert seen == {s + j for s in ("l_", "r_") for j in ("shoulder", "elbow", "wrist")}
