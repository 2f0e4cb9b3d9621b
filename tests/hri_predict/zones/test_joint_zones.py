"""Joint zones: which radius holds when, what widens it, and where nothing is claimed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones import joint_zones
from hri_predict.zones.human_speed import velocities_in
from hri_predict.zones.joint_zone_arrays import spheres_by_arrays
from hri_predict.zones.joint_zones import SETTLED_STEPS, JointZones
from hri_predict.zones.radii import Radii
from hri_predict.zones.reach import BONE_FACTOR, BONE_MARGIN_M
from hri_predict.zones.self_check.self_check import Trust
from hri_predict.zones.settings import CoverageSettings, HumanLimits, Reach
from hri_predict.zones.toward import BINS
from tests.hri_predict.lost_person import lost_person
from tests.hri_predict.zones.conftest import scale_of

RATE_HZ = 25.0
STEPS = 25
COUNT = len(JOINTS)
NOW_NS = 5_000_000_000
FAR = Reach(speed_m_s=50, burst_m_s=50)
UNBOUNDED = HumanLimits(reach={"trunk": FAR, "arm": FAR, "leg": FAR})
JOINT = CoverageSettings(level=0.9, of="joint")
WAIST, WRIST, HAND, ELBOW = (JOINTS.index(n) for n in ("waist", "l_wrist", "l_hand", "l_elbow"))


def standing():
    """(J, 3) a body whose bones are 0.2 m long, each along a way of its own."""
    places = np.zeros((COUNT, 3))
    rng = np.random.default_rng(6)
    for joint, parent in enumerate(CANONICAL.parents):
        away = rng.normal(size=3)
        if parent >= 0:
            places[joint] = places[parent] + 0.2 * away / np.linalg.norm(away)
    return places


def seen(age_s=0.0, velocity=(0.0, 0.0, 0.0), observed=None, people=1, lost=()):
    """People who move in one piece, captured ``age_s`` ago."""
    time = np.arange(1 - STEPS, 1)[:, None, None] / RATE_HZ
    history = np.repeat((standing() + time * np.array(velocity))[None], people, axis=0)
    known = np.ones((people, STEPS, COUNT), bool) if observed is None else observed
    capture = NOW_NS - round(age_s * 1e9)
    return PeopleSnapshot(
        now_ns=NOW_NS,
        ids=tuple(range(people)),
        history=history,
        observed=known,
        capture_ns=np.full(people, capture),
        last_positions=history[:, -1],
        joint_age_s=np.where(known[:, -1], 0.0, 0.2),
        lost=lost,
        reasons=(),
        newest_capture_ns=capture,
        captures=1,
        counters={},
    )


def staying(snapshot, velocity=(0.0, 0.0, 0.0)):
    ahead = np.arange(1, STEPS + 1)[:, None, None] / RATE_HZ * np.array(velocity)
    return Forecast(snapshot.history[:, -1][:, None] + ahead, None)


def trusted(people=1, residual=0.0, widen=1.0, out_of_distribution=False, error=0.0):
    return Trust(
        residual_m=np.full(people, residual),
        error_m=np.full((people, 2, COUNT), error),
        widen=np.broadcast_to(np.asarray(widen, float), (people, STEPS)),
        out_of_distribution=np.broadcast_to(np.asarray(out_of_distribution, bool), (people,)),
    )


def zones(calibration, limits=UNBOUNDED, coverage=JOINT):
    radii = Radii(calibration, coverage, CANONICAL, STEPS)
    return JointZones(
        skeleton=CANONICAL,
        limits=limits,
        rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        times_s=np.arange(STEPS + 1) / RATE_HZ,
        radii=radii,
    )


def follows(zones):
    """(P, J) whether the joint follows the forecast, of people who stay: its path does not grow."""
    return zones.inflation[:, -1] < 1e-9  # rounding of coordinates of a few metres


def built(calibration, snapshot, trust, forecast=None, **kwargs):
    forecast = staying(snapshot) if forecast is None else forecast
    capture = int(snapshot.capture_ns[0])
    return zones(calibration, **kwargs).build(snapshot, forecast, capture_ns=capture, trust=trust)


@pytest.fixture
def calibration(make_calibration):
    return make_calibration()


def table(calibration, speed_class=0, level=0):
    """(H, J) its radii of one class: the scale is 1 m, so they are the factors."""
    of = calibration.estimated["joint"][level, speed_class]
    return np.repeat(of[:, None], COUNT, axis=1)


# -- which radius ---------------------------------------------------------------------------------


def test_at_the_capture_each_interval_has_the_radius_of_the_step_that_ends_it(calibration):
    snapshot = seen()
    spheres = built(calibration, snapshot, trusted())
    assert spheres.radius.shape == (1, STEPS + 1, COUNT)
    assert spheres.radius[0, 1:] == pytest.approx(table(calibration))
    assert not spheres.radius[0, 0].any()  # as captured
    assert spheres.mid[0] == pytest.approx(np.repeat(snapshot.history[0, -1:], STEPS + 1, axis=0))
    assert follows(spheres).all()


@pytest.mark.parametrize(("age_s", "shift"), [(0.01, 1), (0.03, 1), (0.04, 1), (0.05, 2)])
def test_intervals_that_end_between_steps_have_the_later_step(calibration, age_s, shift):
    # at an age of 30 ms interval k ends at 30 + 40 k ms after the capture: after step k
    spheres = built(calibration, seen(age_s), trusted())
    wanted = table(calibration)
    assert spheres.radius[0, 1 : STEPS + 1 - shift] == pytest.approx(wanted[shift:])
    # what is past the last step grows at the physical speed, 2 m/s
    over = age_s + np.arange(STEPS + 1 - shift, STEPS + 1) / RATE_HZ - 1.0
    assert spheres.radius[0, STEPS + 1 - shift :] == pytest.approx(wanted[-1] + 2 * over[:, None])


def test_radii_are_those_of_how_people_move(calibration):
    for speed, wanted in ((0.0, 0), (0.5, 1), (1.5, 2)):
        spheres = built(calibration, seen(velocity=(speed, 0.0, 0.0)), trusted())
        assert spheres.claimed[0] == pytest.approx(table(calibration, wanted))
    coverage = CoverageSettings(level=0.99, of="body")
    high = built(calibration, seen(), trusted(), coverage=coverage)
    assert high.claimed[0] == pytest.approx(1.0 + table(calibration, level=2))


def test_no_radius_is_smaller_than_twice_the_stated_deviation(calibration):
    """Beyond the deviations of the fit the learned scale does not grow with them."""
    snapshot = seen()
    std = np.full((1, STEPS, COUNT), 1e-3)
    std[0, 5:] = 1.0
    forecast = Forecast(staying(snapshot).positions, std)
    spheres = built(calibration, snapshot, trusted(), forecast)
    assert spheres.claimed[0, :5] == pytest.approx(table(calibration)[:5])
    assert (spheres.claimed[0, 5:] == 2.0).all()
    assert spheres.radius[0, 6:] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("steps", "decides"), [(slice(5, None), slice(6, None)), (slice(5, 6), slice(6, 8))]
)
def test_where_the_deviation_decides_no_direction_is_nearer(calibration, steps, decides):
    shares = np.full((3, 3, STEPS, BINS), 0.4)
    own = replace(calibration, toward=shares)
    snapshot, builder = seen(), zones(own)
    std = np.full((1, STEPS, COUNT), 1e-3)
    std[0, steps, HAND] = 1.0
    forecast = Forecast(staying(snapshot).positions, std)
    stage = {"trust": trusted(), "velocities": velocities_in(snapshot, RATE_HZ)}
    spheres = builder.build(snapshot, forecast, capture_ns=NOW_NS, **stage)
    found = builder.toward(snapshot, forecast, spheres=spheres, **stage)
    assert found is not None
    at = np.arange(STEPS + 1)[decides]  # both ends of an interval count
    assert np.isinf(found.rest[0, at, HAND]).all()
    assert np.isfinite(np.delete(found.rest[0, :, HAND], [0, *at])).all()
    assert np.isfinite(found.rest[0, 1:, WAIST]).all()


def test_past_errors_reach_the_scale_of_each_joint(make_calibration):
    # an input adds its own value here: log(1 + 20 error); the body's mean adds to everybody's
    network = scale_of(error_short=1.0, no_long=0.5, residual=2.0)
    own = make_calibration(scale=network)
    plain = table(own)
    wrong = replace(trusted(), error_m=np.zeros((1, 2, COUNT)))
    wrong.error_m[0, 0, WRIST] = 0.05  # 1 + 20 x 0.05 = 2
    found = built(own, seen(), wrong).claimed[0]
    assert found[:, WRIST] == pytest.approx(2.0 * plain[:, WRIST])
    assert np.delete(found, WRIST, 1) == pytest.approx(np.delete(plain, WRIST, 1))
    unknown = replace(trusted(), error_m=np.full((1, 2, COUNT), np.nan))
    assert built(own, seen(), unknown).claimed[0] == pytest.approx(np.exp(0.5) * plain)
    surprising = built(own, seen(), trusted(residual=0.05)).claimed[0]
    assert surprising == pytest.approx(2.0**2 * plain)


def test_a_zone_holds_the_forecast_during_the_whole_interval(calibration):
    # 0.5 m/s: interval k goes from k - 1 to k steps, so its middle is half a step back, +- 0.01 m
    snapshot = seen(velocity=(0.5, 0.0, 0.0))
    spheres = built(calibration, snapshot, trusted(), staying(snapshot, (0.5, 0.0, 0.0)))
    ahead = spheres.mid[0, 1:] - snapshot.history[0, -1]
    assert ahead[:, WAIST, 0] == pytest.approx(0.5 * (np.arange(1, STEPS + 1) - 0.5) / RATE_HZ)
    assert spheres.radius[0, 1:] == pytest.approx(table(calibration, 1) + 0.01)


# -- widening, and what is not trusted ------------------------------------------------------------


def test_widening_is_by_step(calibration):
    widen = np.linspace(1, 4, STEPS)
    spheres = built(calibration, seen(), trusted(widen=widen))
    assert spheres.radius[0, 1:] == pytest.approx(table(calibration) * widen[:, None])
    assert spheres.claimed[0] == pytest.approx(table(calibration))  # before widening


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.03]),
    st.floats(1, 3),
    st.floats(1, 2),
    st.booleans(),
)
def test_zones_never_shrink_when_they_are_widened(make_calibration, seed, age_s, widen, more, held):
    rng = np.random.default_rng(seed)
    velocity = rng.normal(size=3)
    snapshot = seen(age_s, velocity)  # who goes on as forecast: nothing contradicts the forecast
    forecast = staying(snapshot, velocity)
    limits = HumanLimits() if held else UNBOUNDED  # cut to what bodies can do, or not
    calibration = make_calibration(step_m=0.03)
    narrow = built(calibration, snapshot, trusted(widen=widen), forecast, limits=limits)
    wide = built(calibration, snapshot, trusted(widen=widen * more), forecast, limits=limits)
    assert (wide.radius >= narrow.radius - 1e-9).all()


def assert_physical(spheres, joints=slice(None), age_s=0.0):
    """Those joints are about where they were seen, and come as far as ``FAR`` lets them: 50 m/s."""
    t = age_s + np.arange(1, STEPS + 1) / RATE_HZ
    assert not follows(spheres)[0, joints].any()
    radius = spheres.radius[0, 1:][:, joints]
    assert radius == pytest.approx(np.broadcast_to(50.0 * t[:, None], radius.shape))


def test_who_is_out_of_distribution_has_physical_limits_and_the_others_do_not(calibration):
    snapshot = seen(0.03, people=2)
    trust = replace(trusted(2), out_of_distribution=np.array([True, False]))
    elsewhere = staying(snapshot, (3.0, 0.0, 0.0))
    spheres = built(calibration, snapshot, trust, elsewhere)
    assert_physical(spheres, age_s=0.03)
    assert (spheres.mid[0] == snapshot.last_positions[0]).all()
    assert (spheres.path[1, -1] - snapshot.last_positions[1] > [2.5, -0.01, -0.01]).all()
    assert np.isfinite(spheres.claimed).all()  # so that the self-check can see them come back


def test_without_trust_nothing_is_claimed_and_the_uncalibrated_rule_serves(calibration):
    # at 0.2 s: min(1.6 x 0.2, 30 x 0.2^2 / 2 + 1.6 x 0.2) = 0.32; an arm 2 x 0.2
    spheres = built(calibration, seen(), None)
    assert np.isinf(spheres.claimed).all()
    assert spheres.radius[0, 5, [WAIST, WRIST]] == pytest.approx([0.32, 0.4])


def test_without_a_forecast_there_are_physical_limits(calibration):
    snapshot = seen(0.03)
    spheres = zones(calibration).build(
        snapshot, None, capture_ns=int(snapshot.capture_ns[0]), trust=trusted()
    )
    assert_physical(spheres, age_s=0.03)
    assert spheres.claimed is None


def test_physical_limits_are_about_where_a_body_is_going(calibration):
    # who runs at 5 m/s, 0.4 s later: the interval's middle is 0.38 s, so about 1.9 m ahead, within
    # (2 + 8.3 x 0.4 / 2) x 0.4 = 1.464, and 5 x 0.02 = 0.1 for the interval; 10 m/s x 0.4 are more
    snapshot = seen(velocity=(5.0, 0.0, 0.0))
    spheres = built(calibration, snapshot, trusted(out_of_distribution=True), limits=HumanLimits())
    ahead = spheres.mid[0, 10, WAIST] - snapshot.last_positions[0, WAIST]
    assert ahead == pytest.approx([1.9, 0.0, 0.0])
    assert spheres.radius[0, 10, WAIST] == pytest.approx(1.564)


@pytest.mark.parametrize(("steps", "settled"), [(7, False), (8, True)])
def test_a_joint_is_settled_that_was_seen_in_half_of_the_last_steps(calibration, steps, settled):
    assert SETTLED_STEPS == 8
    observed = np.ones((1, STEPS, COUNT), bool)
    observed[0, :-steps, WAIST] = False
    spheres = built(calibration, seen(observed=observed), trusted())
    assert follows(spheres)[0, WAIST] == settled
    assert follows(spheres)[0].sum() == COUNT - 1 + settled
    assert np.isfinite(spheres.claimed[0, :, WAIST]).all() == settled
    if not settled:
        assert_physical(spheres, [WAIST])


def since(steps):
    """Somebody who stands there since so many steps."""
    observed = np.zeros((1, STEPS, COUNT), bool)
    observed[0, -steps:] = True
    return seen(observed=observed)


@pytest.mark.parametrize("steps", [1, 5, 7])
def test_who_just_appeared_has_physical_limits(calibration, steps):
    spheres = built(calibration, since(steps), trusted(residual=np.nan))
    assert_physical(spheres)
    assert np.isinf(spheres.claimed).all()


def test_who_is_there_for_eight_steps_has_calibrated_radii(calibration):
    spheres = built(calibration, since(8), trusted(residual=np.nan, error=np.nan))
    assert follows(spheres).all()
    assert spheres.claimed[0] == pytest.approx(table(calibration))
    assert spheres.radius[0, 1:] == pytest.approx(table(calibration))


def test_a_joint_that_is_not_seen_now_is_not_forecast(calibration):
    observed = np.ones((1, STEPS, COUNT), bool)
    observed[0, -1, HAND] = False
    spheres = built(calibration, seen(observed=observed), trusted())
    # 50 m/s over 0.2 s and more may be anywhere: it hangs on the wrist, by the longest of bones
    wrist = table(calibration)[:, WRIST]
    assert spheres.radius[0, 1:, HAND] == pytest.approx(wrist + CANONICAL.reach[HAND, WRIST])
    assert spheres.mid[0, 1:, HAND] == pytest.approx(spheres.mid[0, 1:, WRIST])
    assert follows(spheres)[0].sum() == COUNT - 1


# -- what was not calibrated ----------------------------------------------------------------------


def test_a_joint_that_was_not_calibrated_hangs_on_its_parent(make_calibration):
    names = tuple(n for n in make_calibration().joints if n != "hand")
    spheres = built(make_calibration(joints=names), seen(), trusted())
    assert not follows(spheres)[0, HAND]
    assert follows(spheres)[0, WRIST]
    wrist = table(make_calibration())[:, WRIST]
    # the sphere about the wrist, and the bone as seen, lie within what 50 m/s allow from the first
    bound = wrist + BONE_FACTOR * 0.2 + BONE_MARGIN_M
    assert spheres.radius[0, 1:, HAND] == pytest.approx(bound)
    assert spheres.mid[0, 1:, HAND] == pytest.approx(spheres.mid[0, 1:, WRIST])


@pytest.mark.parametrize("widen", [1.0, 2.0])
def test_past_the_calibrated_steps_zones_grow_at_the_physical_speed(make_calibration, widen):
    short = make_calibration(steps=10)
    spheres = built(short, seen(), trusted(widen=widen))
    assert follows(spheres).all()
    own = widen * table(short)
    assert spheres.radius[0, 1:11] == pytest.approx(own)
    over = np.arange(1, STEPS - 9)[:, None] / RATE_HZ
    assert spheres.radius[0, 11:] == pytest.approx(own[-1] + 2.0 * over)


@pytest.mark.parametrize("compiled", [True, False])
def test_past_the_calibrated_steps_zones_do_not_follow_the_forecast(
    make_calibration, monkeypatch, compiled
):
    if not compiled:
        monkeypatch.setattr(joint_zones, "_spheres", spheres_by_arrays)
    snapshot, short = seen(), make_calibration(steps=10)
    spheres = built(short, snapshot, trusted(), staying(snapshot, (3.0, 0.0, 0.0)))
    last = snapshot.last_positions[0] + (3.0 * 10 / RATE_HZ, 0.0, 0.0)
    # a body that was where it was forecast, and then turned round, is held
    for k in range(11, STEPS + 1):
        back = last - (2.0 * (k - 10) / RATE_HZ, 0.0, 0.0)
        apart = np.linalg.norm(back - spheres.mid[0, k], axis=-1)
        assert (apart <= spheres.radius[0, k] + 1e-9).all()


# -- the cut, and the lost ------------------------------------------------------------------------


def test_no_zone_exceeds_what_bodies_can_do(make_calibration):
    # body radii of the fixture are over 1 m: from rest a trunk's 40 ms are (2 + 8.3 x 0.02) 0.04
    coverage = CoverageSettings(level=0.9, of="body")
    spheres = built(make_calibration(), seen(), trusted(), limits=HumanLimits(), coverage=coverage)
    assert spheres.radius[0, 1, WAIST] == pytest.approx((2 + 8.3 * 0.02) * 0.04)
    assert spheres.radius[0, 1, ELBOW] == pytest.approx((4.5 + 8.3 * 0.02) * 0.04)
    free = built(make_calibration(), seen(), trusted(), coverage=coverage)
    assert (spheres.radius <= free.radius + 1e-9).all()
    assert spheres.radius[0, -1, WAIST] == pytest.approx(free.radius[0, -1, WAIST])  # 1.25 m of 6


def test_a_forecast_that_no_body_can_follow_gives_way_to_what_bodies_can_do(calibration):
    # 10 m off at once: the surer bound is the body's, from rest (2 + 8.3 x 0.02) 0.04 for a trunk
    snapshot = seen()
    away = Forecast(staying(snapshot).positions + np.array([10.0, 0.0, 0.0]), None)
    spheres = built(calibration, snapshot, trusted(), away, limits=HumanLimits())
    assert spheres.radius[0, 1, WAIST] == pytest.approx((2 + 8.3 * 0.02) * 0.04)
    assert spheres.mid[0, 1, WAIST] == pytest.approx(snapshot.last_positions[0, WAIST])


def test_a_lost_person_walks_from_where_they_were_beside_one_who_is_here(calibration):
    lost = lost_person(9, standing(), NOW_NS - 500_000_000)
    snapshot = seen(lost=(lost,))
    spheres = built(calibration, snapshot, trusted())
    assert spheres.radius.shape == (2, STEPS + 1, COUNT)
    assert spheres.radius[0, 1:] == pytest.approx(table(calibration))
    t = 0.5 + np.arange(STEPS + 1) / RATE_HZ
    assert spheres.radius[1, :, WAIST] == pytest.approx(2.0 * t)
    assert spheres.radius[1, :, WRIST] == pytest.approx(2.0 * t)
    assert spheres.claimed.shape == (1, STEPS, COUNT)
    assert not follows(spheres)[1].any()
