"""Scores: how far people were from where they were forecast, without a look at the future."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import PredictorError, RecordingError
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.predictor import Forecast
from hri_predict.contracts.scene import Scene
from hri_predict.lab.calibration.presence import presences_of
from hri_predict.lab.calibration.scores import (
    HISTORY_STEPS,
    along,
    score_recordings,
    units,
    window_at,
)
from hri_predict.predictors.baselines import (
    ConstantVelocity,
    ConstantVelocitySettings,
    ZeroVelocity,
    ZeroVelocitySettings,
)
from hri_predict.recording.recording import names_of
from hri_predict.zones.joint_zones import SETTLED_STEPS

COUNT = len(JOINTS)
WRIST = JOINTS.index("l_wrist")
BODY = np.random.default_rng(4).normal(size=(COUNT, 3))


def zero(**settings):
    return ZeroVelocity(ZeroVelocitySettings(name="zero_velocity", **settings))


def constant(**settings):
    return ConstantVelocity(ConstantVelocitySettings(name="constant_velocity", **settings))


def wandering(frames, rate_hz=25.0, seed=0):
    """(F, J, 3) a body in one piece on a random walk of about 1 m/s."""
    steps = np.random.default_rng(seed).normal(0, 1 / rate_hz, (frames, 1, 3))
    return BODY + steps.cumsum(axis=0)


def along_x(metres):
    """(F, J, 3) a body in one piece, so far along x at each frame."""
    positions = np.repeat(BODY[None], len(metres), axis=0)
    positions[:, :, 0] += np.asarray(metres)[:, None]
    return positions


# -- windows --------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [25.0, 30.0, 120.0])
def test_nothing_after_an_origin_reaches_its_forecast(make_recording, rate_hz):
    positions = wandering(round(3 * rate_hz), rate_hz)
    before = score_recordings(constant(), [make_recording(positions, rate_hz)])[0]
    chosen = 20
    stamps = before.truth.stamps_ns
    changed = np.where((stamps > before.origin_ns[chosen])[:, None, None], 9.0, positions)
    after = score_recordings(constant(), [make_recording(changed, rate_hz)])[0]
    upto = slice(0, chosen + 1)
    for name in ("origin_ns", "history", "observed", "forecast", "speed_m_s", "residual_m"):
        assert np.array_equal(getattr(before, name)[upto], getattr(after, name)[upto], True), name
    assert not np.allclose(before.history[chosen + 1], after.history[chosen + 1])
    assert (before.error_m[chosen] != after.error_m[chosen]).all()


@pytest.mark.parametrize("rate_hz", [25.0, 30.0, 120.0])
def test_nothing_after_its_horizon_reaches_an_error(make_recording, rate_hz):
    positions = wandering(round(3 * rate_hz), rate_hz)
    before = score_recordings(constant(), [make_recording(positions, rate_hz)])[0]
    end_ns = before.origin_ns[5] + 10**9
    late = (before.truth.stamps_ns > end_ns)[:, None, None]
    after = score_recordings(constant(), [make_recording(np.where(late, 9.0, positions), rate_hz)])[
        0
    ]
    assert np.array_equal(before.error_m[:6], after.error_m[:6])
    assert not np.array_equal(before.error_m[6:], after.error_m[6:], equal_nan=True)


def test_origins_are_captures_a_step_apart_from_the_eighth_on(make_recording):
    # as live: from there on joints are settled, whose zones rest on these very scores
    assert SETTLED_STEPS == 8
    entry = score_recordings(zero(), [make_recording(wandering(360, 120.0), 120.0)])[0]
    assert set(entry.origin_ns) <= set(entry.truth.stamps_ns)
    grid = 40_000_000 * np.arange(7, 7 + len(entry.origin_ns))
    assert np.abs(entry.origin_ns - grid).max() <= 0.5e9 / 120 + 1
    # of 360 captures the last is at 2.9917 s, and the last origin has a step after it
    assert entry.origin_ns[-1] == pytest.approx(2.92e9, abs=5e6)
    assert entry.history.shape[1:] == (HISTORY_STEPS, COUNT, 3)
    # at 283, 317, 358, 400 ms, and so on; what is older than the presence is not seen
    seen = entry.observed.all(-1).sum(1)
    assert seen[:4].tolist() == [8, 8, 9, 11]
    assert entry.observed[8:].all()


def test_history_is_resampled_and_ends_with_the_capture(make_recording):
    positions = along_x(np.arange(90) / 30.0)  # 1 m/s at 30 Hz
    presence = presences_of(make_recording(positions, 30.0))[0]
    history, observed = window_at(presence, 60, 15, 25.0)
    assert observed.all()
    assert np.array_equal(history[-1], positions[60])
    assert np.diff(history[:, 0, 0]) == pytest.approx(np.full(14, 0.04))


# -- errors ---------------------------------------------------------------------------------------


def test_constant_velocity_on_a_parabola_by_hand(make_recording):
    # x = t^2 at 25 Hz: the mean velocity over the last 0.08 s is 2 t - 0.08, so s seconds ahead the
    # forecast lacks (t + s)^2 - t^2 - (2 t - 0.08) s = s^2 + 0.08 s; it grows, so the end counts
    t = np.arange(80) / 25.0
    entry = score_recordings(constant(span_s=0.08), [make_recording(along_x(t**2))])[0]
    s = np.arange(1, 26) / 25.0
    assert entry.error_m[3] == pytest.approx(np.repeat((s**2 + 0.08 * s)[:, None], COUNT, axis=1))
    # 80 frames end at 3.16 s; from the origin at 2.2 s on, frame 55, the last step lacks its truth
    assert np.isfinite(entry.error_m[: 55 - 7]).all()
    first = entry.error_m[55 - 7]
    assert np.isfinite(first[:-1]).all()
    assert np.isnan(first[-1]).all()
    assert entry.speed_m_s[0] == pytest.approx(2 * (0.28 - 0.1))  # the slope over 0.2 s


def test_the_worst_capture_within_a_step_counts(make_recording):
    # 100 Hz, four captures a step: out by 1 m for 10 ms and back is 1 m of error in that step alone
    metres = np.zeros(200)
    metres[98] = 1.0
    entry = score_recordings(zero(), [make_recording(along_x(metres), 100.0)])[0]
    origin = int(np.flatnonzero(entry.origin_ns == 800_000_000)[0])
    # capture 98 is 0.18 s after the origin at 0.8 s: within the fifth step, (0.16, 0.2]
    assert entry.error_m[origin].max(1) == pytest.approx(np.eye(25)[4])


def test_between_steps_the_forecast_is_a_line(make_recording):
    # 50 Hz, a uniform motion: constant velocity is right at the captures between its steps, too
    entry = score_recordings(constant(), [make_recording(along_x(np.arange(150) * 0.02), 50.0)])[0]
    assert np.nanmax(entry.error_m) == pytest.approx(0.0, abs=1e-9)
    # zero velocity lacks s metres of a motion of 1 m/s, at the end of each step the most
    entry = score_recordings(zero(), [make_recording(along_x(np.arange(150) * 0.02), 50.0)])[0]
    assert entry.error_m[0, :, 0] == pytest.approx(np.arange(1, 26) / 25)


def test_along_goes_through_the_knots_and_rests_on_lines():
    knots = np.array([0.0, 1.0, 3.0])
    assert along(knots, np.array([0.0, 0.5, 1.0, 1.25, 2.0])) == pytest.approx([0, 0.5, 1, 1.5, 3])


def test_one_unseen_capture_leaves_its_interval_unknown(make_recording):
    observed = np.ones((300, COUNT), bool)
    observed[102, WRIST] = False  # 50 Hz: 2.04 s
    entry = score_recordings(zero(), [make_recording(wandering(300), 50.0, observed=observed)])[0]
    origin = int(np.flatnonzero(entry.origin_ns == 1_800_000_000)[0])
    unknown = np.isnan(entry.error_m[origin])
    assert unknown[:, WRIST].tolist() == [step == 5 for step in range(25)]  # (0.2, 0.24] s
    assert not np.delete(unknown, WRIST, axis=1).any()
    # of the window whose origin did not see it, it is never known
    lost = int(np.flatnonzero(entry.origin_ns == 2_040_000_000)[0])
    assert np.isnan(entry.error_m[lost][:, WRIST]).all()
    assert not np.isnan(np.delete(entry.error_m[lost], WRIST, axis=1)).any()


def test_a_joint_that_is_no_number_is_not_seen(make_recording):
    positions = wandering(80)
    positions[40, WRIST, 1] = np.nan
    presence = presences_of(make_recording(positions))[0]
    assert not presence.observed[40, WRIST]
    assert presence.observed.sum() == 80 * COUNT - 1
    assert np.isfinite(presence.positions).all()


# -- presences ------------------------------------------------------------------------------------


def test_a_gap_ends_a_presence_and_what_the_node_bridges_does_not(make_recording):
    stamps = 40_000_000 * np.arange(120)
    for gap_ns, parts in ((60_000_000, 1), (61_000_000, 2)):  # 40 ms of it are there anyway
        late = stamps + np.where(np.arange(120) >= 60, gap_ns, 0)
        recording = make_recording(wandering(120), stamps_ns=[int(s) for s in late])
        entries = score_recordings(zero(), [recording])
        assert len(entries) == parts
        assert units(entries) == {"walking_1": list(range(parts))}
    assert entries[1].origin_ns[0] - late[60] == 7 * 40_000_000  # with a history of its own
    assert np.isnan(entries[0].error_m[-1, 1:]).all()


def test_everybody_in_a_recording_is_scored(make_recording):
    first, second = make_recording(wandering(80)), make_recording(wandering(80, seed=1))
    both = replace(
        first,
        scenes=[
            Scene(a.stamp_ns, a.sequence, True, (*a.people, replace(b.people[0], id=2)))
            for a, b in zip(first.scenes, second.scenes, strict=True)
        ],
    )
    entries = score_recordings(constant(), [both])
    alone = [score_recordings(constant(), [r])[0] for r in (first, second)]
    for entry, own in zip(entries, alone, strict=True):
        assert np.array_equal(entry.error_m, own.error_m, equal_nan=True)


def test_a_slow_recording_is_refused(make_recording):
    with pytest.raises(
        RecordingError, match=r"walking_1\.npz: 15 captures per second.*20"
    ) as error:
        score_recordings(zero(), [make_recording(wandering(80), 15.0)])
    assert "\n" not in str(error.value)


def test_who_is_hardly_there_has_no_window(make_recording):
    # 7 captures before the first origin, five origins and a step after the last: 13 captures
    assert len(score_recordings(zero(), [make_recording(wandering(13))])[0].origin_ns) == 5
    # what is asked for is ample: 8 + 2 x 5 steps of 40 ms
    with pytest.raises(RecordingError, match=r"walking_1\.npz: no person is seen for 0\.72 s"):
        score_recordings(zero(), [make_recording(wandering(12))])


def test_a_predictor_that_breaks_its_contract_is_named(make_recording):
    class Lost(ZeroVelocity):
        def predict(self, history, observed):
            return Forecast(super().predict(history, observed).positions * np.nan, None)

    with pytest.raises(PredictorError, match="finite"):
        score_recordings(
            Lost(ZeroVelocitySettings(name="zero_velocity"), CANONICAL),
            [make_recording(wandering(80))],
        )


def test_names_and_actions_are_those_of_the_file(make_recording):
    seen: list[str] = []
    recordings = [
        make_recording(wandering(80), name="soccer_3"),
        replace(make_recording(wandering(80)), kind="assembly", path=Path("task1_human1.npz")),
    ]
    entries = score_recordings(zero(), recordings, on_recording=seen.append)
    assert [(e.name, e.action) for e in entries] == [
        ("soccer_3", "soccer"),
        ("task1_human1", "arms"),
    ]
    assert seen == ["soccer_3", "task1_human1"]


# -- residual -------------------------------------------------------------------------------------


def test_residual_by_hand(make_recording):
    # zero velocity of who goes at 1 m/s from 2 s on: after 0.4 s of it a forecast 0.4 s old is
    # wrong by 0.4 m, and half way there by half of that
    t = np.arange(120) / 25.0
    metres = np.maximum(t - 2.0, 0.0)
    entry = score_recordings(zero(), [make_recording(along_x(metres))])[0]
    at = {round(o * 1e-9, 3): s for o, s in zip(entry.origin_ns, entry.residual_m, strict=True)}
    assert np.isnan([at[0.28], at[0.64]]).all()  # no forecast is 0.4 s old
    assert at[0.68] == pytest.approx(0.0)
    assert [at[2.0], at[2.2], at[2.4], at[3.0]] == pytest.approx([0.0, 0.2, 0.4, 0.4])


def test_residual_is_remembered_for_as_long_as_it_looks_back(make_recording):
    metres = np.zeros(120)
    metres[50] = 1.0  # a single capture elsewhere
    entry = score_recordings(zero(), [make_recording(along_x(metres))])[0]
    frames = np.rint(entry.origin_ns * 25e-9).astype(int)
    high = frames[entry.residual_m > 0.5].tolist()
    # itself, and as an origin again 10 captures on; each for 0.4 s = 10 captures
    assert high == list(range(50, 71))


def test_residual_is_of_the_joints_that_were_seen_then_and_now(make_recording):
    t = np.arange(120) / 25.0
    positions = along_x(np.zeros(120))
    positions[:, WRIST, 0] += t  # only the wrist moves, at 1 m/s
    entry = score_recordings(zero(), [make_recording(positions)])[0]
    assert entry.residual_m[-1] == pytest.approx(0.4 / COUNT)
    observed = np.zeros((120, COUNT), bool)
    observed[:, WRIST] = True
    observed[60, :] = True
    entry = score_recordings(zero(), [make_recording(positions, observed=observed)])[0]
    assert entry.residual_m[-1] == pytest.approx(0.4)


@pytest.mark.parametrize("rate_hz", [20.0, 24.0, 25.0, 30.0, 100.0, 120.0])
def test_residual_is_by_time_whatever_the_rate(make_recording, rate_hz):
    # zero velocity of 1 m/s is wrong by the age of the forecast, 0.4 s to within half a step
    metres = np.arange(round(4 * rate_hz)) / rate_hz
    entry = score_recordings(zero(), [make_recording(along_x(metres), rate_hz)])[0]
    known = entry.residual_m[np.isfinite(entry.residual_m)]
    assert len(known) > 20
    assert np.abs(known - 0.4).max() <= 0.02 + 1e-9
    right = score_recordings(constant(), [make_recording(along_x(metres), rate_hz)])[0]
    assert np.nanmax(right.residual_m) == pytest.approx(0.0, abs=1e-8)  # stamps are whole ns


def test_a_horizon_of_less_than_400_ms_knows_no_residual(make_recording):
    entry = score_recordings(zero(horizon_s=0.36), [make_recording(wandering(80))])[0]
    assert np.isnan(entry.residual_m).all()


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["a/walking_1.npz", "a/walking_2.npz"], ["walking_1", "walking_2"]),
        (["a/w.npz", "b/w.npz", "b/v.npz"], ["a/w.npz", "b/w.npz", "v"]),
        (["a/c/w.npz", "b/c/w.npz"], ["a/c/w.npz", "b/c/w.npz"]),
        (["a/w.npz", "a/w.mcap"], ["w.npz", "w.mcap"]),
        (["a/w.npz", "a/w.npz"], ["w", "w"]),  # one recording
    ],
)
def test_recordings_are_named_by_what_tells_them_apart(paths, names):
    assert names_of([Path(path) for path in paths]) == names
