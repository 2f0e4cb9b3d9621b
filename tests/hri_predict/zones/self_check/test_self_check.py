"""The self-check's factors, residual and comings and goings, against values worked by hand."""

import math

import numpy as np
import pytest

from hri_predict.contracts.predictor import Forecast
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.zones.self_check.driving import (
    JOINTS,
    STEP_S,
    checker,
    drive,
    forecast_off_by,
    radius,
    snapshot,
    still,
)


def test_factor_grows_by_the_stated_step():
    # level 0.99: tau = 5 / ln(1 / 0.01) = 1.0857; after one miss m = 1 - e^(-0.04 / 1.0857) =
    # 0.0362 > 0.01, so w = 4 x 0.04 x (1 - 0.01) = 0.1584 and then twice that: factors e^0.1584 =
    # 1.1716 and e^0.3168 = 1.3727. The errors are 0.2 over radii of 0.1: missed below a factor 2.
    trusts = drive(checker(), 4, 0.2)
    factors = [t.widen[0, 0] for t in trusts]
    np.testing.assert_allclose(factors, [1.0, 1.1716, 1.3727, 1.6083], atol=1e-4)
    assert trusts[2].reasons == (Reason.ZONES_WIDENED,)
    assert trusts[0].reasons == ()


def test_a_lower_level_waits_for_its_own_miss_rate():
    # level 0.9: tau = 5 / ln 10 = 2.1715, and m = 1 - e^(-n 0.04 / 2.1715) passes 0.1 at n = 6
    # (n > 2.1715 x 0.10536 / 0.04 = 5.72); then w = 4 x 0.04 x 0.9 = 0.144
    factors = [t.widen[0, 0] for t in drive(checker(level=0.9), 8, 0.2)]
    assert factors[:6] == [1.0] * 6
    np.testing.assert_allclose(factors[6:], np.exp([0.144, 0.288]))


def test_reaction_is_as_fast_as_stated():
    # ln(2) / (4 x 0.99) = 0.175 s: at the 5th judged capture, 0.2 s, the factor holds an error of
    # twice the radius; then it stays there, as the misses of the present factor cease
    factors = np.array([t.widen[0, 0] for t in drive(checker(), 40, 0.2)])
    assert factors[4] < 2
    assert (factors[5:] >= 2 - 0.05).all()
    assert factors.max() < 2 * math.exp(4 * 0.04)


def test_joint_counts_the_share_of_joints():
    # 7 of 21 joints miss: err = 1/3, w = 0.16 (1/3 - 0.01) = 0.05173
    check = checker(of="joint")
    snap = snapshot(0, still())
    check.check(snap)
    check.note(snap, forecast_off_by(0.2, 3, joints=slice(0, 7)), radius(0.1, 3))
    trust = check.check(snapshot(1, still()))
    assert trust.widen[0, 0] == pytest.approx(math.exp(0.16 * (1 / 3 - 0.01)))


def test_bands_are_apart_and_the_horizon_reacts_when_its_time_has_come():
    steps = 25
    check = checker(steps)
    off = forecast_off_by(0.0, steps)
    off.positions[:, 20:, :, 0] = 1.0  # wrong only from 0.84 s on
    factors = []
    for tick in range(40):
        snap = snapshot(tick, still())
        factors.append(check.check(snap).widen[0])
        check.note(snap, off, radius(0.1, steps))
    widened = np.array(factors)
    assert (widened[:, :20] == 1).all()  # 0.8 s: the fifth band ends
    assert (widened[:21, 20:] == 1).all()  # the oldest forecast is 20 steps old
    assert (widened[21:, 20:] > 1).all()
    assert (np.diff(widened[0:, 20:], axis=1) == 0).all()


@pytest.mark.parametrize("level", [0.9, 0.95, 0.99])
def test_returns_to_one_after_recover_s_of_good_coverage_and_not_before(level):
    check = checker(level=level, recover_s=2.0)
    drive(check, 400, 0.2)  # 16 s: the running miss rate is 1 - e^(-16 / tau), nearly 1
    trusts = drive(check, 60, 0.0, start=400)
    factors = np.array([t.widen[0, 0] for t in trusts])
    # the last wrong forecast is judged 3 steps on; m falls to 1 - level in 2 s = 50 captures
    assert (factors[:45] > 1).all()
    assert (factors[54:] == 1).all()


def test_at_its_bound_a_factor_that_still_misses_is_out_of_distribution():
    # ln 4 / (4 x 0.99 x 0.04) = 8.75: at the 9th judgement the factor is at 4, errors are 5 radii
    trusts = drive(checker(), 30, 0.5)
    assert not any(t.out_of_distribution[0] for t in trusts[:9])
    assert all(t.out_of_distribution[0] for t in trusts[9:])
    assert max(t.widen.max() for t in trusts) == pytest.approx(4.0)
    assert trusts[-1].reasons == (Reason.MOTION_UNLIKE,)


def test_the_report_tells_radii_in_use_from_those_that_were_not():
    check = checker()
    drive(check, 30, 0.5)
    report = check.report()
    # forecasts of ticks 0 to 28 are judged 3 times but the last two, 2 and 1 times, and tick 29's
    # not at all; those of ticks 0 to 8 were made before the bound was reached
    assert report["judged"] == 27 * 3 + 2 + 1
    assert report["judged_in_use"] == 9 * 3
    assert report["covered"] == 0.0
    assert report["covered_as_calibrated"] == 0.0
    assert report["ticks"] == 30
    assert report["ticks_unlike"] == 30 - 9
    assert report["ticks_widened"] == 29  # from the tick after the first forecast
    assert report["largest_factor"] == pytest.approx(4.0)
    assert report["mean_error_m"] == pytest.approx(0.5)
    first = report["horizons"][0]
    assert first["up_to_s"] == pytest.approx(0.12)
    assert first["judged"] == report["judged"]


def test_out_of_distribution_is_held_and_then_over():
    check = checker(hold_s=0.5, recover_s=1.0)
    assert drive(check, 30, 0.5)[-1].out_of_distribution[0]
    trusts = drive(check, 40, 0.0, start=30)
    out_of_distribution = [bool(t.out_of_distribution[0]) for t in trusts]
    # the wrong forecasts of ticks 27 to 29 are judged until tick 32: 0.5 s after it are 12 captures
    assert out_of_distribution[:15] == [True] * 15
    assert not any(out_of_distribution[16:])


def test_who_is_not_judged_while_out_of_distribution_comes_back_too():
    check = checker(hold_s=0.5)
    drive(check, 30, 0.5)
    trusts = drive(check, 60, 0.5, claimed=np.inf, start=30)
    assert not trusts[-1].out_of_distribution[0]
    assert trusts[-1].widen[0, 0] == pytest.approx(4.0)  # and nothing was won by it


def test_never_below_one_however_good():
    rng = np.random.default_rng(5)
    check = checker(level=0.9)
    for tick in range(300):
        trust = check.check(snap := snapshot(tick, rng.normal(0, 0.05, (1, JOINTS, 3))))
        check.note(snap, forecast_off_by(0.0, 3), radius(rng.uniform(0.01, 0.4), 3))
        assert (trust.widen >= 1).all()


# -- residual -------------------------------------------------------------------------------------


def test_residual_is_the_largest_error_at_the_age_of_400_ms():
    steps, check, seen = 25, checker(25), []
    for tick in range(45):
        snap = snapshot(tick, still())
        seen.append(check.check(snap).residual_m[0])
        off = 0.3 if tick == 5 else 0.1
        check.note(snap, forecast_off_by(off, steps), radius(1.0, steps))
    assert np.isnan(seen[:10]).all()  # none is 0.4 s = 10 steps old
    np.testing.assert_allclose(seen[10:15], 0.1)
    # the one of tick 5 is 10 steps old at tick 15, and is remembered until 10 steps later
    np.testing.assert_allclose(seen[15:26], 0.3)
    np.testing.assert_allclose(seen[26:], 0.1)


def test_residual_is_interpolated_and_tolerates_captures_at_30_hz_in_ticks_at_25():
    # a forecast that leaves along x at 1 m/s of somebody who stays errs by its age in metres
    steps, check, seen = 25, checker(25), []
    ahead = np.zeros((1, steps, JOINTS, 3))
    ahead[..., 0] = ((np.arange(steps) + 1) * STEP_S)[:, None]
    for tick in range(50):
        capture = math.floor(tick / 25 * 30 + 1e-9)
        snap = snapshot(capture, still(), hz=30.0)
        seen.append(check.check(snap).residual_m[0])
        check.note(snap, Forecast(ahead, None), radius(10.0, steps))
    known = np.array([value for value in seen if not np.isnan(value)])
    assert len(known) > 30
    # ages are multiples of 1/30 s, and 12 / 30 s = 0.4 s is one of them
    np.testing.assert_allclose(known, 0.4, atol=1e-6)


def test_of_two_forecasts_about_400_ms_old_the_nearer_counts():
    # captures 24.5 ms apart: ages 16 x 24.5 = 392 ms and 17 x 24.5 = 416.5 ms are both within half
    # a step; the forecast errs by its age in metres
    steps, check, hz = 25, checker(25), 1 / 0.0245
    ahead = np.zeros((1, steps, JOINTS, 3))
    ahead[..., 0] = ((np.arange(steps) + 1) * STEP_S)[:, None]
    for tick in range(60):
        snap = snapshot(tick, still(), hz=hz)
        residual = check.check(snap).residual_m[0]
        check.note(snap, Forecast(ahead, None), radius(10.0, steps))
    assert residual == pytest.approx(0.392)


def test_a_gap_between_captures_counts_as_a_tenth_of_a_second():
    steps, check = 25, checker(25)
    drive(check, 1, 0.2, steps=steps)
    trust = check.check(snapshot(20, still()))  # 0.8 s later, in the fifth band, horizons to 0.8 s
    assert trust.widen[0, 19] == pytest.approx(math.exp(4 * 0.1 * 0.99))


def test_nothing_is_judged_where_a_joint_was_not_seen_then_or_now():
    half = np.ones((1, JOINTS), bool)
    half[:, :10] = False
    for first, second in ((half, None), (None, half)):
        check = checker(steps=10)
        snap = snapshot(0, still(), observed=first)
        check.check(snap)
        check.note(snap, forecast_off_by(0.4, 10, joints=slice(0, 10)), radius(0.1, 10))
        trust = check.check(snapshot(10, still(), observed=second))
        assert trust.residual_m[0] == 0.0
        assert (trust.widen == 1).all()
        assert check.report()["judged"] == 1


# -- what is not a number -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("positions", "claimed"),
    [(np.nan, 0.1), (np.inf, 0.1), (0.0, np.nan), (0.0, -1.0), (0.0, 0.0), (0.0, -np.inf)],
)
def test_what_is_no_sane_number_is_a_miss(positions, claimed):
    check = checker(steps=12)
    body = still() + 0.01
    for tick in range(15):
        snap = snapshot(tick, body)
        trust = check.check(snap)
        check.note(snap, forecast_off_by(positions, 12), radius(claimed, 12))
    assert (trust.widen > 1).any()
    assert trust.residual_m[0] > 0
    assert math.isfinite(check.report()["mean_error_m"])


def test_a_joint_seen_at_no_number_is_a_miss():
    check = checker()
    drive(check, 5, 0.0)
    body = still()
    body[0, 3] = np.nan
    assert (check.check(snapshot(5, body)).widen > 1).any()


def test_infinite_radii_claim_nothing():
    check = checker()
    assert (drive(check, 30, 5.0, claimed=np.inf)[-1].widen == 1).all()
    assert check.report()["judged"] == 0
    assert check.report()["covered"] is None


def test_what_claimed_nothing_residuals_nobody():
    trusts = drive(checker(25), 20, 5.0, claimed=np.inf, steps=25)
    assert np.isnan([t.residual_m[0] for t in trusts]).all()
    assert drive(checker(25), 20, 5.0, steps=25)[-1].residual_m[0] == pytest.approx(5.0)


# -- people come and go ---------------------------------------------------------------------------


def test_people_are_kept_apart_whatever_their_order():
    check = checker()
    for tick in range(20):
        ids, off = ((7, 9), [0.0, 0.2]) if tick % 2 else ((9, 7), [0.2, 0.0])
        snap = snapshot(tick, still(2), ids=ids)
        trust = check.check(snap)
        forecast = forecast_off_by(0.0, 3, people=2)
        forecast.positions[..., 0] += np.array(off)[:, None, None]
        check.note(snap, forecast, radius(0.1, 3, people=2))
    assert (trust.widen[ids.index(7)] == 1).all()
    assert (trust.widen[ids.index(9)] > 1.5).all()
    people = check.report()["people"]
    assert people["7"]["covered"] == 1.0
    assert 0.5 < people["9"]["covered"] < 0.8
    assert people["9"]["covered_as_calibrated"] == 0.0


def test_an_id_is_remembered_for_the_longest_horizon_and_no_longer():
    for gone, remembered in ((3, True), (5, False)):
        check = checker()
        drive(check, 10, 0.2)
        nobody = np.zeros((0, JOINTS, 3))
        for tick in range(10, 10 + gone):  # the horizon is 3 steps
            trust = check.check(snapshot(tick, nobody, ids=()))
            assert trust.widen.shape == (0, 3)
            assert trust.reasons == ()
        widened = bool((check.check(snapshot(10 + gone, still())).widen > 1).any())
        assert widened == remembered
        assert check.report()["people"]["1"]["judged"] > 0


def test_more_people_than_can_be_remembered_are_out_of_distribution():
    check = checker(max_people=2)
    trust = check.check(snapshot(0, still(3), ids=(1, 2, 3)))
    assert trust.out_of_distribution.tolist() == [False, False, True]
    assert np.isnan(trust.residual_m).all()
    assert trust.reasons == (Reason.MOTION_UNLIKE,)
    assert not check.check(snapshot(1, still(), ids=(3,))).out_of_distribution[
        0
    ]  # takes the place of one gone


def test_who_takes_a_place_is_not_judged_by_the_forecasts_of_who_had_it():
    check = checker(max_people=1)
    drive(check, 1, 0.0)
    trust = check.check(snapshot(1, still() + 5.0, ids=(2,)))
    assert (trust.widen == 1).all()
    assert check.report()["judged"] == 0


@pytest.mark.parametrize(
    ("apart_m", "absent", "same"),
    [(0.0, 0, True), (0.1, 2, True), (0.5, 0, False), (0.0, 8, False)],
)
def test_a_body_that_gets_a_new_id_keeps_its_widening(apart_m, absent, same):
    """Its zones would shrink at once, although nothing about it has changed."""
    check = checker()
    drive(check, 40, 0.5)
    assert (check.check(snapshot(40, still())).widen > 1).any()
    moved = still() + np.array([apart_m, 0.0, 0.0])
    trust = check.check(snapshot(41 + absent, moved, ids=(2,)))
    assert bool((trust.widen > 1).any()) is same


def test_an_id_that_leaves_twice_is_counted_twice():
    check = checker()
    drive(check, 4, 0.0)  # 3 captures judge 1 + 2 + 3
    nobody = np.zeros((0, JOINTS, 3))
    for start in (20, 40):
        check.check(snapshot(start - 10, nobody, ids=()))
        drive(check, 4, 0.0, start=start)
    check.check(snapshot(60, nobody, ids=()))
    assert check.report()["people"]["1"]["judged"] == 3 * 6
    assert check.report()["judged"] == 3 * 6


def test_ids_that_flicker_do_not_fill_the_memory():
    check = checker()
    for tick in range(500):
        snap = snapshot(tick, still(), ids=(tick,))
        check.check(snap)
        check.note(snap, forecast_off_by(0.0, 3), radius(0.1, 3))
    assert len(check.report()["people"]) <= 64


def test_the_same_capture_twice_is_judged_once():
    once, twice = checker(), checker()
    for tick in range(12):
        for check, times in ((once, 1), (twice, 2)):
            for _ in range(times):
                snap = snapshot(tick, still())
                trust = check.check(snap)
                check.note(snap, forecast_off_by(0.2, 3), radius(0.1, 3))
            if check is once:
                kept = trust
    np.testing.assert_array_equal(kept.widen, trust.widen)
    assert once.report()["judged"] == twice.report()["judged"]


def test_a_tick_without_forecast_and_a_clock_that_goes_back_are_survived():
    check = checker()
    for tick in (0, 1, 2, 9, 3, 4):
        trust = check.check(snapshot(tick, still()))
        if tick != 1:
            check.note(snapshot(tick, still()), forecast_off_by(0.0, 3), radius(0.1, 3))
        assert (trust.widen == 1).all()


def test_levels_that_are_none_are_refused():
    for level in (0.0, 1.0, math.nan):
        with pytest.raises(ValueError, match="level"):
            checker(level=level)
