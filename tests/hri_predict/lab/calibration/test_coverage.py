"""Coverage: counts by hand, intervals by recording, and zones as the node would have had them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.conformal import calibrate
from hri_predict.lab.calibration.coverage import (
    Calibrated,
    Coverage,
    as_calibrated,
    as_run,
    run_zones,
)
from hri_predict.lab.calibration.scores import Presence, score_presence, score_recordings
from hri_predict.predictors.baselines import (
    ConstantVelocity,
    ConstantVelocitySettings,
    ZeroVelocity,
    ZeroVelocitySettings,
)
from hri_predict.zones.settings import CoverageSettings, HumanLimits, Reach
from tests.hri_predict.zones.conftest import scale_of

RATE_HZ = 25.0
STEPS = 12
COUNT = len(JOINTS)
HEAD, WRIST = JOINTS.index("head"), JOINTS.index("l_wrist")
BODY = np.random.default_rng(4).normal(size=(COUNT, 3))
FAR = Reach(speed_m_s=50, burst_m_s=50)
UNBOUNDED = HumanLimits(reach={"trunk": FAR, "arm": FAR, "leg": FAR})
CUT = CoverageSettings(level=0.9, of="joint", self_check=False)
CHECKED = CoverageSettings(level=0.9, of="joint")


def zero():
    settings = ZeroVelocitySettings(name="zero_velocity", horizon_s=STEPS / RATE_HZ)
    return ZeroVelocity(settings)


def constant():
    settings = ConstantVelocitySettings(name="constant_velocity", horizon_s=STEPS / RATE_HZ)
    return ConstantVelocity(settings)


def wandering(frames, rate_hz=RATE_HZ, seed=0, speed=1.0):
    """(F, J, 3) a body in one piece that turns now and then."""
    rng = np.random.default_rng(seed)
    heading = rng.normal(0, 3 / np.sqrt(rate_hz), frames).cumsum()
    ways = np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    return BODY + (ways * speed / rate_hz).cumsum(axis=0)[:, None]


@pytest.fixture(scope="module")
def scored(make_recording):
    """Scores of five recordings by a predictor, and a calibration with radii of one size."""

    @cache
    def make(predictor, rate_hz, seconds):
        recordings = [
            make_recording(
                wandering(round(seconds * rate_hz), rate_hz, seed), rate_hz, f"walking_{seed}"
            )
            for seed in range(4)
        ]
        scores = score_recordings(predictor(), recordings)
        made = calibrate(
            scores=scores,
            predictor="own",
            settings={},
            weights=None,
            rate_hz=RATE_HZ,
            skeleton=CANONICAL,
        )
        return scores, made

    def scored(predictor, radius_m, rate_hz=RATE_HZ, seconds=2.2):
        scores, made = make(predictor, rate_hz, seconds)
        tables = {of: np.full_like(table, radius_m) for of, table in made.estimated.items()}
        return scores, replace(made, estimated=tables, limits=None, scale=scale_of())

    return scored


# -- counts ---------------------------------------------------------------------------------------


def test_counts_by_hand(scored):
    scores, calibration = scored(zero, 0.1)
    windows = len(scores[0].origin_ns)
    error = np.zeros((windows, STEPS, COUNT))
    error[0, 0, WRIST] = 0.2  # outside
    error[1, 0, HEAD] = np.nan  # not known, all others inside
    error[2, 1] = np.nan  # nothing known
    error[3, 2, [WRIST, HEAD]] = 0.1, 0.100001  # on the rim is inside
    second = np.full((windows, STEPS, COUNT), 0.3)
    entries = [replace(scores[0], error_m=error), replace(scores[1], error_m=second)]
    found = as_calibrated(entries, calibration, CUT, CANONICAL)
    n = windows * COUNT
    assert found.names == ("walking_0", "walking_1")
    assert found.known["joint"][0, :4].tolist() == [n - 1, n - COUNT, n, n]
    assert found.held["joint"][0, :4].tolist() == [n - 2, n - COUNT, n - 1, n]
    assert found.known["body"][0, :4].tolist() == [windows, windows - 1, windows, windows]
    assert found.held["body"][0, :4].tolist() == [windows - 1, windows - 1, windows - 1, windows]
    assert not found.held["joint"][1].any()
    assert found.share("joint")[3] == 0.5
    assert found.windows.tolist() == [windows, windows]


def test_presences_of_one_recording_are_counted_together(scored):
    scores, calibration = scored(zero, 0.1)
    once = as_calibrated(scores[:2], calibration, CUT, CANONICAL)
    twice = as_calibrated([scores[0], scores[0], scores[1]], calibration, CUT, CANONICAL)
    assert twice.names == ("walking_0", "walking_1")
    for of in ("joint", "body"):
        for more, counts in ((twice.known, once.known), (twice.held, once.held)):
            assert np.array_equal(more[of][0], 2 * counts[of][0])
            assert np.array_equal(more[of][1], counts[of][1])
    assert twice.windows.tolist() == [2 * once.windows[0], once.windows[1]]


def test_where_nothing_is_calibrated_nothing_is_known(scored):
    scores, calibration = scored(zero, np.inf)
    found = as_calibrated(scores, calibration, CUT, CANONICAL)
    assert not found.known["joint"].any()
    assert np.isnan(found.share("body")).all()
    assert all(np.isnan(bound).all() for bound in found.interval("body"))


def coverage(held, known, actions=None):
    """Of recordings (U, H), the same for both questions."""
    held, known = np.asarray(held, float), np.asarray(known, float)
    count = len(held)
    return Coverage(
        names=tuple(f"r{n}" for n in range(count)),
        actions=tuple(actions or ["walking"] * count),
        held=dict.fromkeys(("joint", "body"), held),
        known=dict.fromkeys(("joint", "body"), known),
        windows=np.full(count, 10.0),
        widened_in=np.arange(count, dtype=float),
        unlike_in=np.zeros(count),
    )


def test_an_action_is_reported_on_its_own():
    found = coverage([[9, 8], [5, 5], [1, 0]], [[10, 10]] * 3, ["walking", "soccer", "walking"])
    assert found.share("joint") == pytest.approx([0.5, 13 / 30])
    own = found.of_action("walking")
    assert own.names == ("r0", "r2")
    assert own.share("body") == pytest.approx([0.5, 0.4])
    assert found.of_action("soccer").share("body") == pytest.approx([0.5, 0.5])
    assert (found.widened, own.widened) == pytest.approx((3 / 30, 2 / 20))
    assert found.trust_of("soccer") == (0.1, 0.0)


# -- intervals ------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_an_interval_holds_the_share_and_is_within_what_recordings_show(seed, count):
    rng = np.random.default_rng(seed)
    known = rng.integers(20, 200, (count, 3))
    found = coverage(rng.binomial(known, rng.beta(8, 2, (count, 1))), known)
    low, high = found.interval("joint")
    share, own = found.share("joint"), found.held["joint"] / known
    assert (low <= share + 1e-12).all()
    assert (share <= high + 1e-12).all()
    assert (low >= own.min(0) - 1e-12).all()
    assert (high <= own.max(0) + 1e-12).all()


def test_one_recording_says_nothing_of_others_and_equal_ones_agree():
    for held in ([[45]], [[45]] * 7):
        low, high = coverage(held, [[50]] * len(held)).interval("body")
        assert low == high == pytest.approx([0.9])


def test_two_recordings_by_hand():
    # drawn are both of one kind (a quarter each), or one of each: 1, 0.75 or 0.5
    low, high = coverage([[50], [25]], [[50], [50]]).interval("body")
    assert (low.item(), high.item()) == (0.5, 1.0)


def test_intervals_are_the_same_each_time():
    found = coverage([[9], [5], [7], [10]], [[10]] * 4)
    assert found.interval("joint")[0].tobytes() == found.interval("joint")[0].tobytes()
    assert found.interval("joint", seed=0)[0] <= found.share("joint") <= found.interval("joint")[1]


# -- as run ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [25.0, 100.0])
def test_where_nothing_is_cut_zones_as_run_hold_what_their_radii_hold(scored, rate_hz):
    # who stays where the forecast is still: a ball about a point, and so no larger than its radius
    scores, calibration = scored(zero, 0.15, rate_hz)
    radii = as_calibrated(scores, calibration, CUT, CANONICAL)
    run = as_run(scores, Calibrated(zero(), calibration), CUT, UNBOUNDED)
    for of in ("joint", "body"):
        assert np.array_equal(run.known[of], radii.known[of])
        assert np.array_equal(run.held[of], radii.held[of])
    share = run.share("joint")
    assert share[0] == 1.0  # 0.04 m
    assert 0.0 < share[5] < 1.0
    assert (run.widened, run.unlike) == (0.0, 0.0)
    for balls, _ in run_zones(scores[0], Calibrated(zero(), calibration), CUT, UNBOUNDED):
        assert balls.radius[0, 1:] == pytest.approx(0.15)


def test_zones_as_run_read_the_spread_that_the_forecasts_state(scored):
    scores, calibration = scored(zero, 0.15)
    stated = replace(scores[0], std=np.full(scores[0].error_m.shape, 0.05))  # log1p(20 x 0.05)
    reads = replace(calibration, shape=None, scale=scale_of(spread=1.0))
    for balls, _ in run_zones(stated, Calibrated(zero(), reads), CUT, UNBOUNDED):
        assert balls.radius[0, 1:] == pytest.approx(0.30)


@pytest.mark.parametrize("rate_hz", [120.0, 30.0, 12.5, 8.0])
def test_past_errors_are_the_same_live_as_in_the_scores(scored, rate_hz):
    frames = round(3 * rate_hz)
    observed = np.random.default_rng(3).random((frames, COUNT)) < 0.95
    stamps = np.array([10**9 + round(k * 1e9 / rate_hz) for k in range(frames)])
    positions = np.where(observed[..., None], wandering(frames, rate_hz), 0.0)
    presence = Presence(stamps, positions, observed, rate_hz)
    entry = score_presence(constant(), "walking_9", "walking", presence)
    assert entry is not None
    _, calibration = scored(constant, 0.15)
    ran = run_zones(entry, Calibrated(constant(), calibration), CHECKED)
    live = np.concatenate([trust.error_m for _, trust in ran])
    # metres to 1e-15, interpolated and subtracted in the same order but for the age in seconds,
    # of which 1e-9 times a speed of a few m/s is the most
    np.testing.assert_allclose(live, entry.past_error_m, atol=1e-8)
    late = entry.origin_ns - entry.origin_ns[0] > 500_000_000
    share = np.isfinite(entry.past_error_m[late]).mean((0, 2))
    assert (share > 0.8).all()  # at every rate there is a forecast of each age


def test_about_a_forecast_that_moves_zones_are_somewhat_larger(scored):
    scores, calibration = scored(constant, 0.15)
    radii = as_calibrated(scores, calibration, CUT, CANONICAL)
    run = as_run(scores, Calibrated(constant(), calibration), CUT, UNBOUNDED)
    for of in ("joint", "body"):
        assert (run.held[of] >= radii.held[of]).all()
        assert (run.held[of] > radii.held[of]).any()
        assert np.array_equal(run.known[of], radii.known[of])


def test_the_cut_loses_nobody_who_keeps_the_limits(scored):
    # radii of 2 m would hold everybody, and what bodies can do is less than that, and does so, too
    scores, calibration = scored(constant, 2.0)
    run = as_run(scores, Calibrated(constant(), calibration), CUT)
    assert run.share("joint") == pytest.approx(np.ones(STEPS))
    balls, _ = run_zones(scores[0], Calibrated(constant(), calibration), CUT)[0]
    assert (balls.radius[0, 1] < 0.5).all()


def test_out_for_a_moment_is_out_for_that_step_alone(make_recording, scored):
    _, calibration = scored(zero, 0.1)
    positions = np.repeat(BODY[None], 200, axis=0)
    positions[100] += 1.0  # 1.0 s, at 100 Hz
    scores = score_recordings(zero(), [make_recording(positions, 100.0)])
    origin = int(np.flatnonzero(scores[0].origin_ns == 800_000_000)[0])
    alone = scores[0].only(slice(origin, origin + 1))
    run = as_run([alone], Calibrated(zero(), calibration), CUT, UNBOUNDED)
    assert run.held["body"][0].tolist() == [step != 4 for step in range(STEPS)]
    assert run.held["joint"][0].tolist() == [COUNT * (step != 4) for step in range(STEPS)]


def test_the_self_check_widens_what_falls_short(scored):
    scores, calibration = scored(zero, 0.15)
    off = as_run(scores, Calibrated(zero(), calibration), CUT, UNBOUNDED)
    on = as_run(scores, Calibrated(zero(), calibration), CHECKED, UNBOUNDED)
    assert on.widened > 0.2
    assert (on.held["joint"] >= off.held["joint"]).all()
    assert on.share("joint")[-1] > off.share("joint")[-1] + 0.1


def test_who_is_unlike_all_is_counted(scored):
    scores, calibration = scored(zero, 0.15)
    calibration.ranges["speed_m_s"].update(dict.fromkeys(calibration.joints, 0.2))
    on = as_run(scores, Calibrated(zero(), calibration), CHECKED, UNBOUNDED)
    assert on.unlike == 1.0  # all go at 1 m/s
    assert on.share("joint") == pytest.approx(np.ones(STEPS))  # 2 m/s hold them
    assert as_run(scores, Calibrated(zero(), calibration), CUT, UNBOUNDED).unlike == 0.0


# -- residual, live and from scores ---------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [20.0, 24.0, 25.0, 30.0, 100.0, 120.0])
@pytest.mark.parametrize("share_seen", [1.0, 0.8])
def test_the_residual_of_scores_is_the_live_one(make_recording, scored, rate_hz, share_seen):
    # Both take the forecast nearest to 0.4 s old, between its steps on a line; ticks are at origins
    # here. The node's own ticks may be at other captures: then it is of other forecasts.
    _, calibration = scored(constant, 0.2)
    frames = round(4 * rate_hz)
    observed = np.random.default_rng(3).random((frames, COUNT)) < share_seen
    positions = wandering(frames, rate_hz)
    positions[:, WRIST] += np.random.default_rng(5).normal(0, 0.05, (frames, 3))
    recording = make_recording(positions, rate_hz, observed=observed)
    entry = score_recordings(constant(), [recording])[0]
    run = run_zones(entry, Calibrated(constant(), calibration), CHECKED)
    live = np.array([t.residual_m[0] for _, t in run])
    assert np.isfinite(live).sum() > 0.7 * len(live)
    for balls, _ in run:  # every window rests on eight steps, so that radii are claimed
        assert balls.claimed is not None
        assert np.isfinite(balls.claimed).any()
    assert live == pytest.approx(entry.residual_m, abs=1e-6, nan_ok=True)
