"""Evaluation on recordings: its windows, what it scores, and the baselines' known errors."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import PredictorError, RecordingError
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.predictor import Forecast
from hri_predict.lab.evaluation.recordings import (
    MEAN_ACTIONS,
    Errors,
    RecordingResult,
    baselines,
    built,
    judge_all,
)
from hri_predict.lab.evaluation.recordings import judge_one as judge
from hri_predict.lab.evaluation.windows import (
    HORIZONS_MS,
    Motion,
    batches,
    origins,
    read_motions,
    scored_joints,
)
from hri_predict.predictors.baselines import ZeroVelocity, ZeroVelocitySettings
from hri_predict.predictors.neural.body import BODY
from tests.shared import DATA, needs_data

JOINTS = len(BODY.joints)
VELOCITY = np.array([1.0, -0.5, 0.25])


def motion(duration_s: float, rate_hz: float, name: str = "walking_1", seed: int | None = None):
    """A body in one piece that moves at ``VELOCITY``, or where ``seed`` is given, at random."""
    frames = round(duration_s * rate_hz) + 1
    stamps = np.rint(np.arange(frames) * 1e9 / rate_hz).astype(np.int64)
    positions = np.arange(JOINTS * 3, dtype=float).reshape(JOINTS, 3) / 50
    positions = positions + stamps[:, None, None] * 1e-9 * VELOCITY
    if seed is not None:
        positions = np.random.default_rng(seed).normal(size=positions.shape).cumsum(axis=0)
    seen = np.ones((frames, JOINTS), bool)
    action = name.rpartition("_")[0]
    return Motion(
        name=name,
        action=action,
        stamps_ns=stamps,
        positions=positions,
        observed=seen,
        rate_hz=rate_hz,
    )


def predictor(kind: str = "zero_velocity"):
    return built(baselines()[kind])


class Off:
    """Zero velocity, but for some joints that it puts a metre away."""

    def __init__(self, joints, horizon_s: float = 1.0) -> None:
        settings = ZeroVelocitySettings(name="off", horizon_s=horizon_s)
        self._right = ZeroVelocity(settings, BODY)
        self._joints = joints
        self.skeleton, self.rate_hz = BODY, 25.0
        self.history_steps = self._right.history_steps
        self.horizon_steps = self._right.horizon_steps

    def predict(self, history, observed) -> Forecast:
        positions = self._right.predict(history, observed).positions
        positions[:, :, list(self._joints), 2] += 1.0
        return Forecast(positions, None)


@needs_data
def test_baselines_have_the_known_errors_over_the_five_actions():
    files = [DATA / "cmu_mocap" / "test" / f"{action}_1.npz" for action in MEAN_ACTIONS]
    results = {
        r.predictor: r for r in judge_all({n: built(s) for n, s in baselines().items()}, files)
    }
    windows = [e.windows for e in results["zero_velocity"].actions.values()]
    assert windows == [81, 396, 86, 36, 535]
    columns = [HORIZONS_MS.index(ms) for ms in (120, 200, 400, 600, 1000)]
    known = {
        "zero_velocity": [119, 192, 351, 494, 777],
        "constant_velocity 120 ms": [72, 141, 326, 491, 772],
        "constant_velocity 40 ms": [56, 120, 310, 485, 789],
    }
    for name, errors in known.items():
        assert np.rint(results[name].mean_mm()[columns]).tolist() == errors


@needs_data
def test_running_is_judged_to_600_ms_and_arms_where_they_are_observed():
    files = [DATA / "cmu_mocap/test/running_1.npz", DATA / "assembly/task3_human2_trial2.npz"]
    result = judge(predictor(), files)
    assert result.averaged == ("running", "arms")  # the mean of other recordings is over all
    assert np.isfinite(result.action_mm("running")).tolist() == [True] * 4 + [False] * 2
    arms = np.isfinite(result.actions["arms"].by_joint()[0])
    names = {BODY.joints[j] for j in np.flatnonzero(arms)}
    assert names == {"l_shoulder", "l_elbow", "l_wrist", "r_elbow", "r_wrist"}  # one never seen


@pytest.mark.parametrize("rate_hz", [25.0, 30.0, 100.0, 120.0])
def test_true_seconds_and_metres_at_any_rate(rate_hz):
    result = judge(predictor(), [motion(4.0, rate_hz)])
    speed = np.linalg.norm(VELOCITY)
    assert result.mean_mm() == pytest.approx(speed * np.array(result.horizons_ms), rel=1e-6)
    straight = judge(predictor("constant_velocity 120 ms"), [motion(4.0, rate_hz)])
    assert straight.mean_mm() == pytest.approx(np.zeros(6), abs=1e-4)


def test_two_seconds_are_judged_on_windows_that_have_them():
    moving, standing = (baselines(50)[k] for k in ("constant_velocity 120 ms", "zero_velocity"))
    given = {"straight": built(moving), "still": built(standing), "one second": predictor()}
    straight, still, one_second = judge_all(given, [motion(4.0, 120)], future_steps=50)
    assert straight.horizons_ms == (120, 200, 400, 600, 800, 1000, 1600, 2000)
    assert straight.mean_mm() == pytest.approx(np.zeros(8), abs=1e-4)
    speed = np.linalg.norm(VELOCITY)
    assert still.mean_mm() == pytest.approx(speed * np.array(still.horizons_ms), rel=1e-6)
    assert np.isfinite(one_second.mean_mm()).tolist() == [True] * 6 + [False] * 2
    whole = judge(predictor(), [motion(4.0, 120)])
    assert whole.actions["walking"].windows == straight.actions["walking"].windows + 25


def test_nothing_after_an_origin_reaches_the_predictor():
    whole = motion(3.0, 120.0, seed=1)
    times, _ = origins(whole)
    chosen = 7
    changed = whole.positions.copy()
    changed[whole.stamps_ns > times[chosen]] += 5.0
    before = next(batches(whole, 15))
    after = next(batches(replace(whole, positions=changed), 15))
    assert np.array_equal(before.history[: chosen + 1], after.history[: chosen + 1])
    assert not np.allclose(before.history[chosen + 1], after.history[chosen + 1])
    assert not np.allclose(before.future[chosen], after.future[chosen])


def test_the_newest_step_is_a_capture_and_origins_are_a_step_apart():
    whole = motion(3.0, 120.0, seed=1)
    times, steps = origins(whole)
    assert set(times) <= set(whole.stamps_ns)
    assert steps == 25
    assert times[-1] + 1_000_000_000 <= whole.stamps_ns[-1]
    grid = 40_000_000 * np.arange(14, 14 + len(times))
    assert np.abs(times - grid).max() <= whole.period_ns / 2
    assert next(batches(whole, 15)).observed[:, -1].all()


def test_a_longer_history_sees_the_same_newest_steps_and_nothing_before_the_start():
    whole = motion(3.0, 120.0, seed=1)
    short, long = next(batches(whole, 15)), next(batches(whole, 50))
    assert np.array_equal(short.history, long.history[:, -15:])
    assert np.array_equal(short.observed, long.observed[:, -15:])
    assert np.array_equal(short.future, long.future)
    assert not long.observed[0, :35].any()
    assert short.observed[1:].all()


def test_artefacts_of_the_root_are_neither_input_nor_scored(tmp_path):
    frames = 600
    ok = np.ones(frames, bool)
    ok[300:330] = False
    positions = np.ones((frames, 38, 3)) * np.arange(frames)[:, None, None] / 1000
    positions[~ok] = 77.0
    path = tmp_path / "basketball_1.npz"
    np.savez(path, positions_world=positions, world_ok=ok, fps=np.float32(120))
    motions = read_motions([path])
    assert [m.action for m in motions] == ["basketball"] * 2
    assert [len(m.stamps_ns) for m in motions] == [300, 270]
    for piece in motions:
        batch = next(batches(piece, 15))
        assert batch.known.all()
        assert np.abs(batch.history).max() < 1
        assert np.abs(batch.future).max() < 1


def test_a_joint_that_was_lost_is_not_scored_while_it_was():
    whole = motion(3.0, 120.0)
    seen = whole.observed.copy()
    lost = BODY.index("l_wrist")
    seen[:, lost] = False
    result = judge(predictor(), [replace(whole, observed=seen)])
    by_joint = result.actions["walking"].by_joint()
    assert np.isnan(by_joint[:, lost]).all()
    assert np.isfinite(by_joint[:, BODY.index("r_wrist")]).all()
    assert np.isfinite(result.mean_mm()).all()


def test_scored_are_the_pelvis_and_the_25_but_not_the_hips():
    hips = [BODY.index("l_hip"), BODY.index("r_hip")]
    assert len(scored_joints()) == 26
    assert not set(hips) & set(scored_joints())
    right, off = judge(predictor(), [motion(3, 120)]), judge(Off(hips), [motion(3, 120)])
    assert np.array_equal(right.mean_mm(), off.mean_mm())
    wrist = judge(Off([BODY.index("l_wrist")]), [motion(3, 120)])
    assert (wrist.mean_mm() > right.mean_mm()).all()


def test_a_shorter_horizon_has_no_errors_beyond_it():
    result = judge(Off([], horizon_s=0.4), [motion(3, 120)])
    assert np.isfinite(result.mean_mm()).tolist() == [True] * 3 + [False] * 3


def test_a_forecast_that_is_not_finite_names_the_predictor_and_the_recording():
    class Lost(Off):
        def predict(self, history, observed) -> Forecast:
            return Forecast(np.full((len(history), 25, JOINTS, 3), np.nan), None)

    with pytest.raises(PredictorError, match=r"predictor lost: .*finite, on recording walking_1; "):
        judge_all({"lost": Lost([])}, [motion(3, 120)])


def test_other_joints_or_another_rate_are_refused():
    canonical = ZeroVelocity(ZeroVelocitySettings(name="z"), CANONICAL)
    with pytest.raises(PredictorError, match=r"predictor z.*body28 at 25 Hz"):
        judge(canonical, [motion(3, 120)], name="z")
    slow = ZeroVelocity(ZeroVelocitySettings(name="z", rate_hz=10.0), BODY)
    with pytest.raises(PredictorError, match="10 Hz"):
        judge(slow, [motion(3, 120)])


@pytest.mark.parametrize(
    ("duration_s", "reached"), [(1.72, 6), (1.71, 5), (1.32, 4), (1.31, 3), (0.84, 1)]
)
def test_a_short_recording_is_judged_as_far_as_it_leaves_five_origins(duration_s, reached):
    result = judge(predictor(), [motion(duration_s, 100)])
    assert np.isfinite(result.mean_mm()).tolist() == [True] * reached + [False] * (6 - reached)
    assert result.actions["walking"].windows >= 5


def test_a_rate_that_knows_nothing_of_the_shortest_horizon_is_refused(tmp_path):
    positions = np.ones((40, 38, 3)) * np.arange(40)[:, None, None] / 100
    for rate, fits in ((8.0, False), (9.0, True)):
        path = tmp_path / f"walking_{rate:.0f}.npz"
        np.savez(path, positions_world=positions, fps=rate)
        if fits:
            assert len(read_motions([path])) == 1
            continue
        with pytest.raises(RecordingError, match=r"walking_8\.npz: 8 frames per second"):
            read_motions([path])


def test_too_short_a_recording_has_no_windows():
    assert judge(predictor(), [motion(0.5, 120)]).actions == {}


def test_actions_weigh_the_same_and_others_are_left_out_of_the_mean():
    def errors(mm: float, windows: int) -> Errors:
        count = np.full((25, JOINTS), float(windows))
        return Errors(windows, count * mm / 1000, count)

    actions = {"walking": errors(100, 3), "soccer": errors(200, 97), "running": errors(900, 50)}
    result = RecordingResult("p", None, actions)
    assert result.averaged == ("soccer", "walking")
    assert result.mean_mm() == pytest.approx(np.full(6, 150.0))
    assert result.action_mm("running") == pytest.approx(np.full(6, 900.0))
