"""How near a body may come by direction: classes, and that bodies are held for the whole step."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.body.standing import standing_body
from hri_predict.people.snapshot import Inferred, RecentCaptures
from hri_predict.risk.separation.search_loops import extent
from hri_predict.zones.body_zones import ZoneBuilder
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import Trust
from hri_predict.zones.settings import LEVELS, CoverageSettings, HumanLimits
from hri_predict.zones.toward import BINS, STEEP, STILL_M, direction_class, ways
from tests.hri_predict.zones.conftest import calibration_of
from tests.hri_predict.zones.test_body_zones import snapshot_of

RATE_HZ, STEPS, COUNT = 25.0, 25, len(JOINTS)
SHARES = np.broadcast_to(  # of all levels and speeds alike; at random over the steps
    np.random.default_rng(7).uniform(0.3, 1.0, (STEPS, BINS)), (len(LEVELS), 3, STEPS, BINS)
)
CALIBRATION = calibration_of(step_m=0.01, toward=SHARES)


# -- classes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [(0, 6), (21, 6), (22, 5), (41, 5), (42, 4), (75, 4), (76, 3), (104, 3), (105, 2), (138, 2),
     (139, 1), (180, 1)],
)  # fmt: skip
def test_the_class_is_that_of_the_angle_to_the_motion(degrees, expected):
    angle = np.radians(degrees)
    direction = np.array([np.cos(angle), np.sin(angle), 0.0])
    assert direction_class(direction, np.array([1.0, 0.0, 0.0])) == expected


def test_still_joints_and_steep_directions_have_their_own_class():
    level, steep = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.6, 0.8])
    for sign in (1, -1):
        assert direction_class(sign * level, np.zeros(3)) == 0
        for way in (np.zeros(3), np.array([0.0, 0.0, 1.0])):
            assert direction_class(sign * steep, way) == BINS - 1
    just_level = np.array([np.sqrt(1 - STEEP**2), 0.0, STEEP - 1e-9])
    assert direction_class(just_level, np.zeros(3)) == 0


@given(st.integers(0, 10_000))
def test_turning_a_body_and_a_robot_leaves_the_class(seed):
    rng = np.random.default_rng(seed)
    direction, way = rng.normal(size=(2, 20, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    way /= np.linalg.norm(way, axis=1)[:, None]
    cosine, sine = np.cos(angle := rng.uniform(0, 6)), np.sin(angle)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    found = direction_class(direction @ turn.T, way @ turn.T)
    np.testing.assert_array_equal(found, direction_class(direction, way))


def test_a_joint_that_hardly_moves_has_no_way():
    moved = np.array([[0.0, 0, 0], [STILL_M * 0.999, 0, 0], [0, STILL_M, 0], [0, 0, -3.0]])
    np.testing.assert_allclose(ways(moved), [[0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, -1]])


# -- bodies ------------------------------------------------------------------------------------


def builder(calibration=CALIBRATION, coverage=None, **limits):
    return ZoneBuilder(
        skeleton=CANONICAL,
        absent_parts=(),
        limits=HumanLimits(**limits),
        rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        radii=Radii(calibration, coverage or CoverageSettings(), CANONICAL, STEPS),
    )


def trust_in(people, widen=1.0, unlike=False):
    return Trust(
        residual_m=np.zeros(people),
        error_m=np.zeros((people, 2, COUNT)),
        widen=np.full((people, STEPS), widen),
        out_of_distribution=np.full(people, unlike),
    )


def walking(seed, people=1, age_s=0.1):
    """People who walk along curves, and the forecast of it."""
    rng = np.random.default_rng(seed)
    start = standing_body() + rng.uniform(-2, 2, (people, 1, 3)) * [1, 1, 0]
    velocity = rng.normal(0, 1, (people, COUNT, 3)) * rng.choice([0, 0.3, 1.5], (people, 1, 1))
    times = (np.arange(STEPS) + 1)[:, None, None] / RATE_HZ
    bend = rng.normal(0, 0.5, (people, 1, COUNT, 3))
    ahead = start[:, None] + velocity[:, None] * times + bend * times**2
    snapshot = snapshot_of(start, [age_s] * people)
    recent = RecentCaptures.of_history(snapshot.history, snapshot.observed, RATE_HZ)
    return replace(snapshot, recent=recent), Forecast(ahead, None)


def knots_of(snapshot, forecast):
    return np.concatenate([snapshot.last_positions[:, None], forecast.positions], axis=1)


@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.03, 0.1]), st.sampled_from([1.0, 1.7]))
def test_a_segment_reaches_as_far_as_its_joints_may_at_any_time_of_a_step(seed, age_s, widen):
    """True joints are off the forecast by their share of the radius along n, and a lot across."""
    snapshot, forecast = walking(seed, age_s=age_s)
    build = builder()
    bodies = build.build(snapshot, forecast, trust=trust_in(1, widen))
    toward, knots = bodies.toward, knots_of(snapshot, forecast)[0]
    rng = np.random.default_rng(seed)
    for _ in range(20):
        n = rng.normal(size=3) * rng.choice([0.2, 1.0], 3)
        n /= np.linalg.norm(n)
        segment, entry = int(rng.integers(len(build.segment_names))), int(rng.integers(1, 20))
        far = extent(toward, (0, entry, segment), tuple(n)) - toward.extra[0, segment]
        time = age_s + (entry - rng.uniform(0, 1)) / RATE_HZ
        before = min(int(time * RATE_HZ), STEPS - 1)
        on_way = time * RATE_HZ - before
        ends = toward.ends[0, segment]
        place = knots[before, ends] * (1 - on_way) + knots[before + 1, ends] * on_way
        which = direction_class(np.array([n, n]), toward.way[0, entry, ends])
        claim = bodies.claimed[0, before, ends] * widen
        share = SHARES[0, 0, before, which]
        true = place + (share * claim)[:, None] * n
        inside = (
            np.linalg.norm(true - toward.mid[0, entry, ends], axis=1)
            <= toward.radius[0, entry, ends]
        )  # where reach and bones cut, they count
        assert ((true @ n)[inside] <= far + 1e-9).all()


@given(st.integers(0, 10_000))
def test_by_direction_a_segment_never_reaches_farther_than_its_zone(seed):
    snapshot, forecast = walking(seed, people=2)
    bodies = builder().build(snapshot, forecast, trust=trust_in(2))
    rng, capsules = np.random.default_rng(seed), bodies.zones.capsules
    less = 0
    for _ in range(40):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        at = (int(rng.integers(2)), int(rng.integers(STEPS + 1)), int(rng.integers(17)))
        zone = max(capsules.a[at] @ n, capsules.b[at] @ n) + capsules.radius[at]
        far = extent(bodies.toward, at, tuple(n))
        assert far <= zone + 1e-9
        less += far < zone - 0.01
    assert less > 0


def support(snapshot, forecast, trust, **own):
    return builder(**own).build(snapshot, forecast, trust=trust).toward


def test_without_a_claim_of_single_joints_balls_count():
    snapshot, forecast = walking(1)
    trust = trust_in(1)
    assert support(snapshot, forecast, trust) is not None
    assert support(snapshot, None, trust) is None
    assert support(snapshot, forecast, trust, calibration=calibration_of()) is None
    for coverage in (CoverageSettings(of="body"), CoverageSettings(basis="guaranteed")):
        assert support(snapshot, forecast, trust, coverage=coverage) is None


@pytest.mark.parametrize("why", ["unlike", "hidden", "no radius"])
def test_joints_that_follow_no_forecast_extend_as_their_balls(why):
    snapshot, forecast = walking(2)
    joints = np.ones(COUNT, bool)
    calibration = CALIBRATION
    if why == "hidden":
        joints = np.isin(JOINTS, ("l_hand", "r_foot"))
        age = np.where(joints, 0.12, 0.0)[None]
        snapshot = replace(snapshot, joint_age_s=age)
    if why == "no radius":
        estimated = {of: np.where(np.arange(STEPS) > 9, np.inf, t) for of, t in
                     calibration.estimated.items()}  # fmt: skip
        calibration = replace(calibration, estimated=estimated)
    found = support(
        snapshot, forecast, trust_in(1, unlike=why == "unlike"), calibration=calibration
    )
    assert np.isinf(found.rest[0][:, joints]).all()
    assert np.isfinite(found.rest[0, 1:][:, ~joints]).all()


def test_at_the_capture_balls_count():
    snapshot, forecast = walking(3)
    found = support(snapshot, forecast, trust_in(1))
    assert np.isinf(found.rest[:, 0]).all()
    assert np.isfinite(found.rest[:, 1:]).all()


def test_beyond_the_trusted_steps_joints_may_be_as_fast_as_people_can():
    short = replace(
        CALIBRATION,
        estimated={of: t[..., :10] for of, t in CALIBRATION.estimated.items()},
        guaranteed={of: t[..., :10] for of, t in CALIBRATION.guaranteed.items()},
        toward=SHARES[:, :, :10],
    )
    snapshot, forecast = walking(4, age_s=0.0)
    found = support(snapshot, forecast, trust_in(1), calibration=short)
    fast = HumanLimits().physical_speed_m_s
    more = found.rest[0, 10:, 0] - found.rest[0, 10, 0]
    over = np.arange(16) / RATE_HZ
    assert (more >= fast * over - 0.5).all()
    assert found.rest[0, -1, 0] >= fast * over[-1]


def test_an_inferred_joint_s_place_counts_in_all_directions():
    snapshot, forecast = walking(5)
    joints = np.isin(JOINTS, ("l_ankle", "l_foot"))[None]
    within = np.where(joints, 0.3, 0.0)
    inferred = Inferred(
        joints, within, np.broadcast_to(~joints[:, None], snapshot.observed.shape), ~joints
    )
    hidden = replace(snapshot, inferred=inferred)
    seen, unseen = (support(s, forecast, trust_in(1)) for s in (snapshot, hidden))
    np.testing.assert_array_equal(unseen.within, within)
    np.testing.assert_allclose(unseen.rest, seen.rest, atol=1e-12)
    foot = [s.name for s in CANONICAL.segments].index("l_foot")
    for n in np.vstack([np.eye(3), -np.eye(3)]):
        at = (0, 10, foot)
        here, there = (extent(of, at, tuple(n)) for of in (seen, unseen))
        assert there >= here
        assert there - max(unseen.mid[0, 10, j] @ n for j in unseen.ends[0, foot]) > 0.3
