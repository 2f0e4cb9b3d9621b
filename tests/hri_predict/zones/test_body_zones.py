"""Zones hold every body that keeps the limits, whatever of it was seen."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import Capsules
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.snapshot import LostPerson, PeopleSnapshot
from hri_predict.zones.body_zones import BodyZones, ZoneBuilder
from hri_predict.zones.settings import HumanLimits, Reach
from hri_predict.zones.trust import Trust
from tests.hri_predict.lost_person import lost_person

RATE_HZ = 25.0
STEPS = 10
NOW_NS = 5_000_000_000
LIMITS = HumanLimits(velocity_error_m_s=0.4)
FAR = Reach(speed_m_s=50, burst_m_s=50)
UNBOUNDED = LIMITS.model_copy(update={"reach": {"trunk": FAR, "arm": FAR, "leg": FAR}})
ARMS = [i for part in ("left_arm", "right_arm") for i in CANONICAL.parts[part]]
HAND, WRIST = JOINTS.index("r_hand"), JOINTS.index("r_wrist")


def body(x: float = 0.0) -> Floats:
    """A standing body, arms down; every bone within the skeleton's reach."""
    place = {"waist": (0.0, 1.0), "torso": (0.0, 1.2), "neck": (0.0, 1.45), "head": (0.0, 1.6)}
    place["head_top"] = (0, 1.75)
    for side, y in (("l_", 0.15), ("r_", -0.15)):
        for joint, z in (("shoulder", 1.4), ("elbow", 1.1), ("wrist", 0.85), ("hand", 0.68)):
            place[side + joint] = (y, z)
        for joint, z in (("hip", 0.95), ("knee", 0.5), ("ankle", 0.1), ("foot", 0.03)):
            place[side + joint] = (y / 2, z)
    return np.array([(x, *place[joint]) for joint in JOINTS], dtype=float)


def snapshot_of(
    last: Floats,
    ages_s: list[float],
    joint_age: Floats | None = None,
    lost: tuple[LostPerson, ...] = (),
) -> PeopleSnapshot:
    people, joints = last.shape[:2]
    captures = NOW_NS - np.round(np.array(ages_s) * 1e9).astype(np.int64)
    return PeopleSnapshot(
        now_ns=NOW_NS,
        ids=tuple(range(people)),
        history=np.repeat(np.nan_to_num(last[:, None]), 6, axis=1),  # they have stood there
        observed=np.ones((people, 6, joints), bool),
        capture_ns=captures,
        last_positions=last,
        joint_age_s=np.zeros((people, joints)) if joint_age is None else joint_age,
        lost=lost,
        reasons=(),
        newest_capture_ns=int(captures.max()) if people else NOW_NS,
        captures=1,
        counters={},
    )


def builder(limits: HumanLimits = LIMITS, absent: tuple[str, ...] = (), steps: int | None = None):
    return ZoneBuilder(
        skeleton=CANONICAL,
        absent_parts=absent,
        limits=limits,
        rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        steps=steps,
    )


def on_path(knots: Floats, t: float) -> Floats:
    """Oracle: the piecewise linear path (N, J, 3) at ``t``, resting at its last knot."""
    times = np.arange(len(knots)) / RATE_HZ
    flat = knots.reshape(len(knots), -1)
    return np.array([np.interp(t, times, column) for column in flat.T]).reshape(-1, 3)


def allowed(t: float, limits: HumanLimits = LIMITS) -> Floats:
    """Oracle: (J,) the stated growth rule, joint by joint."""
    end = STEPS / RATE_HZ
    result = []
    for joint in range(len(JOINTS)):
        arm = joint in ARMS
        v = limits.arm_speed_m_s if arm else limits.body_speed_m_s
        a = limits.arm_acceleration_m_s2 if arm else limits.body_acceleration_m_s2
        inside = min(t, end)
        near = min(v * inside, a * inside**2 / 2 + limits.velocity_error_m_s * inside)
        result.append(near + limits.physical_speed_m_s * max(0.0, t - end))
    return np.array(result)


def depth(points: Floats, zones: Capsules, person: int, step: int, segment: int) -> float:
    """How far the farthest of (M, 3) points sticks out of a zone's axis, less its radius."""
    a, b = zones.a[person, step, segment], zones.b[person, step, segment]
    axis = b - a
    length = float(axis @ axis)
    s = np.clip((points - a) @ axis / length, 0, 1)[:, None] if length > 0 else 0.0
    return float(
        np.linalg.norm(points - a - s * axis, axis=1).max() - zones.radius[person, step, segment]
    )


def assert_holds(zones: BodyZones, person: int, step: int, joints: Floats, rng) -> None:
    """Every segment of the body whose joints (J, 3) are given lies in its zone."""
    for index, segment in enumerate(CANONICAL.segments):
        a, b = joints[segment.joint_a], joints[segment.joint_b]
        skin = rng.normal(size=(8, 3))
        skin *= segment.radius / np.linalg.norm(skin, axis=1, keepdims=True)
        points = a + rng.random((8, 1)) * (b - a) + skin
        points = np.concatenate([points, a + skin, b + skin])
        assert depth(points, zones.zones.capsules, person, step, index) < 1e-9, segment.name


@given(
    seed=st.integers(0, 2**32 - 1),
    ages=st.lists(st.sampled_from([0.0, 0.013, 0.04, 0.08, 0.117]), min_size=1, max_size=3),
    speed=st.floats(0, 3),
)
def test_zones_hold_bodies_whose_deviation_keeps_the_limits(seed, ages, speed):
    rng = np.random.default_rng(seed)
    people = len(ages)
    last = np.array([body(float(p)) for p in range(people)])
    # The whole body moves and strays as one, so that its bones keep their lengths.
    moves = rng.normal(size=(people, STEPS, 1, 3)) * speed / RATE_HZ
    forecast = last[:, None] + np.cumsum(moves, axis=1)
    zones = builder(UNBOUNDED, steps=STEPS + 4).build(
        snapshot_of(last, ages), Forecast(forecast, None)
    )
    knots = np.concatenate([last[:, None], forecast], axis=1)
    for p, age in enumerate(ages):
        for step in range(1, STEPS + 5):
            begin, end = zones.zones.times_s[step - 1 : step + 1]
            for t in (begin, end, rng.uniform(begin, end)):
                stray = rng.normal(size=3)
                stray *= allowed(age + t).min() / np.linalg.norm(stray)
                assert_holds(zones, p, step, on_path(knots[p], age + t) + stray, rng)


@given(seed=st.integers(0, 2**32 - 1), with_forecast=st.booleans())
def test_zones_hold_a_moving_body_of_which_joints_were_not_seen_lately(seed, with_forecast):
    rng = np.random.default_rng(seed)
    last = body()[None]
    joint_age = rng.choice([0.0, 0.04, 0.5, np.inf], size=(1, len(JOINTS)))
    joint_age[0, 0] = 0.0
    seen = np.where(np.isinf(joint_age)[..., None], np.nan, last)
    forecast = Forecast(np.repeat(last[:, None], STEPS, axis=1), None) if with_forecast else None
    zones = builder().build(snapshot_of(seen, [0.03], joint_age), forecast)
    for step in range(1, STEPS + 1):
        t = 0.03 + zones.zones.times_s[step]
        far = allowed(t).min() if with_forecast else 2.0 * t
        stray = rng.normal(size=3)
        assert_holds(zones, 0, step, last[0] + far * stray / np.linalg.norm(stray), rng)


def test_a_joint_not_seen_in_the_capture_grows_from_where_it_was_seen():
    last = body()[None]
    joint_age = np.zeros((1, len(JOINTS)))
    joint_age[0, HAND] = 0.1
    forecast = Forecast(np.repeat(last[:, None], STEPS, axis=1), None)
    zones = builder().build(snapshot_of(last, [0.0], joint_age), forecast).zones
    segment = CANONICAL.segments[(index := zones.segments.index("r_hand"))]
    expected = segment.radius + 2.0 * (0.1 + zones.times_s)
    assert np.allclose(zones.capsules.radius[0, :, index], expected)


def test_an_unseen_end_is_bounded_by_the_reach_from_a_joint_that_is_seen():
    rng = np.random.default_rng(1)
    last = body()[None].copy()
    last[0, HAND] = np.nan
    joint_age = np.zeros((1, len(JOINTS)))
    joint_age[0, HAND] = np.inf
    zones = builder().build(
        snapshot_of(last, [0.0], joint_age),
        Forecast(np.repeat(np.nan_to_num(last)[:, None], STEPS, axis=1), None),
    )
    index = [s.name for s in CANONICAL.segments].index("r_hand")
    capsule = zones.zones.capsules
    assert np.allclose(capsule.a[0, :, index], last[0, WRIST])
    for _ in range(50):
        hand = rng.normal(size=3)
        hand *= CANONICAL.reach[WRIST, HAND] / np.linalg.norm(hand)
        points = last[0, WRIST] + np.linspace(0, 1, 5)[:, None] * hand
        assert depth(points, capsule, 0, 0, index) <= -CANONICAL.segments[index].radius + 1e-9
    assert np.isfinite(capsule.radius).all()
    assert np.isfinite(capsule.a).all()
    assert capsule.radius[0, 0].max() < 1.0


def test_a_person_of_whom_nothing_was_seen_may_be_anywhere():
    last = np.full((1, len(JOINTS), 3), np.nan)
    zones = (
        builder()
        .build(snapshot_of(last, [0.0], np.full((1, len(JOINTS)), np.inf)), None)
        .zones.capsules
    )
    far = np.array([[50.0, -80.0, 2.0]])
    assert all(depth(far, zones, 0, 0, s) < 0 for s in range(len(CANONICAL.segments)))
    assert np.isfinite(zones.radius).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200])
def test_absurd_positions_count_as_never_seen(value):
    last = body()[None].copy()
    last[0] = value
    zones = builder().build(snapshot_of(last, [0.0]), None).zones.capsules
    assert np.isfinite(zones.a).all()
    assert (zones.radius > 100).all()


def test_without_a_forecast_everything_grows_at_the_physical_speed():
    zones = builder().build(snapshot_of(body()[None], [0.1]), None).zones
    radii = np.array([s.radius for s in CANONICAL.segments])
    expected = radii + 2.0 * (0.1 + zones.times_s[1:, None])
    assert np.allclose(zones.capsules.radius[0, 1:], expected)
    assert np.allclose(zones.capsules.radius[0, 0], radii)


def test_entry_0_is_the_body_as_captured():
    last = body()[None]
    forecast = Forecast(np.repeat(last[:, None] + 1.0, STEPS, axis=1), None)
    zones = builder().build(snapshot_of(last, [0.1]), forecast).zones.capsules
    for index, segment in enumerate(CANONICAL.segments):
        assert np.allclose(zones.a[0, 0, index], last[0, segment.joint_a])
        assert np.allclose(zones.b[0, 0, index], last[0, segment.joint_b])
        assert zones.radius[0, 0, index] == pytest.approx(segment.radius)


def test_a_lost_person_walks_from_where_they_were_last_seen():
    lost = lost_person(9, body(2.0), NOW_NS - 1_000_000_000)
    bodies = builder().build(snapshot_of(body()[None], [0.1], lost=(lost,)), None)
    zones = bodies.zones
    assert zones.ids == (0, 9)
    assert bodies.lost.tolist() == [False, True]
    speed = 2.0
    radii = np.array([s.radius for s in CANONICAL.segments])
    assert np.allclose(zones.capsules.radius[1, 0], radii + speed * 0.9)
    assert np.allclose(zones.capsules.radius[1, 3], radii + speed * (1.0 + zones.times_s[3]))
    assert bodies.age_s == pytest.approx(0.1)


@given(st.integers(0, 2**32 - 1))
def test_a_zone_does_not_shrink_at_the_instant_of_loss(seed):
    """Whatever joints were last seen long ago, and however fast the person was."""
    rng = np.random.default_rng(seed)
    joint_age = np.where(rng.random(len(JOINTS)) < 0.4, rng.uniform(0.0, 5.0, len(JOINTS)), 0.0)
    joint_age[rng.integers(len(JOINTS))] = 0.0
    here = builder().build(snapshot_of(body()[None], [0.1], joint_age[None]), None).zones.capsules
    lost = lost_person(1, body(), NOW_NS - 100_000_000, joint_age_s=joint_age)
    nobody = np.zeros((0, len(JOINTS), 3))
    gone = builder().build(snapshot_of(nobody, [], lost=(lost,)), None)
    then = gone.zones.capsules
    for k in range(1, STEPS):
        assert (then.radius[0, k] >= here.radius[0, k] - 1e-9).all()
        assert then.a[0, k] == pytest.approx(here.a[0, k])


def test_a_lost_runner_goes_on_as_fast_and_counts_as_fast():
    zones = {}
    for speed in (1.6, 6.0):
        lost = lost_person(9, body(2.0), NOW_NS - 500_000_000, speed_m_s=speed)
        zones[speed] = builder().build(snapshot_of(body()[None], [0.1], lost=(lost,)), None)
    walker, runner = zones[1.6], zones[6.0]
    gain = runner.zones.capsules.radius[1, 5] - walker.zones.capsules.radius[1, 5]
    assert gain == pytest.approx((6.0 - 2.0) * (0.5 + walker.zones.times_s[5]))
    assert runner.speeds.fast.tolist() == [False, True]
    assert (runner.speeds.beyond_standard_m_s[1] == 6.0).all()
    assert walker.speeds.fast.tolist() == [False, False]
    assert not runner.as_assumed[1]


@pytest.mark.parametrize(("widen", "unlike"), [(1.0, False), (3.0, False), (1.0, True)])
def test_the_standard_keeps_its_say_about_who_moves_as_it_assumes(widen, unlike):
    """Its assumption is about speeds, not about forecasts: a wrong one takes nothing from it."""
    trust = Trust(
        residual_m=np.zeros(2),
        error_m=np.zeros((2, 2, len(JOINTS))),
        widen=np.full((2, STEPS), widen),
        out_of_distribution=np.full(2, unlike),
    )
    people = snapshot_of(np.array([body(), body(2.0)]), [0.1, 0.1])
    history = np.repeat(people.history[:, -1:], 26, axis=1)
    way_m = 3.0 * np.clip(np.arange(26) - 10, 0, 5) / RATE_HZ
    history[1, ..., 0] += way_m[:, None]
    people = replace(people, history=history, observed=np.ones(history.shape[:3], bool))
    found = builder().build(people, None, trust=trust)
    assert found.as_assumed.tolist() == [True, False]  # a body that was fast 0.4 s ago
    assert not found.speeds.fast.any()


def test_a_fast_limb_gets_an_arms_length_ahead_of_its_body():
    limbs = np.zeros(len(JOINTS))
    limbs[HAND] = 6.0
    plain, kicks = (
        builder().build(
            snapshot_of(
                body()[None],
                [0.1],
                lost=(lost_person(9, body(2.0), NOW_NS - 100_000_000, limbs_m_s=speeds),),
            ),
            None,
        )
        for speeds in (np.zeros(len(JOINTS)), limbs)
    )
    hand = [i for i, s in enumerate(CANONICAL.segments) if HAND in (s.joint_a, s.joint_b)]
    ahead = kicks.zones.capsules.radius[1] - plain.zones.capsules.radius[1]
    assert ahead[1, hand] == pytest.approx(6.0 * 0.14)
    assert ahead[-1, hand] == pytest.approx(0.85)


def test_who_is_known_to_be_in_some_places_has_upright_zones_about_them():
    places = np.array([[1.0, 0.0, 0.3], [2.0, 1.0, 0.5]])
    lost = lost_person(9, body(2.0), NOW_NS - 10**9, places=places, places_ns=NOW_NS - 100_000_000)
    found = builder().build(snapshot_of(body()[None], [0.1], lost=(lost,)), None)
    zones, times = found.zones.capsules, found.zones.times_s
    assert zones.a[1, 0, 0] == pytest.approx([1.0, 0.0, 0.0])
    assert zones.radius[1, 0, :2] == pytest.approx([0.3 + 0.85, 0.5 + 0.85])
    assert zones.radius[1, 4, 0] == pytest.approx(0.3 + 0.85 + 1.6 * (0.1 + times[4]))
    assert zones.b[1, 0, 0, 2] + zones.radius[1, 0, 0] >= 2.5  # whoever reaches up is in it


def test_zones_rest_on_the_oldest_capture():
    bodies = builder().build(snapshot_of(np.array([body(), body(1.0)]), [0.02, 0.09]), None)
    assert bodies.age_s == pytest.approx(0.09)
    assert bodies.capture_ns == NOW_NS - 90_000_000


def test_std_widens_where_asked():
    last = body()[None]
    forecast = Forecast(
        np.repeat(last[:, None], STEPS, axis=1), np.full((1, STEPS, len(JOINTS)), 0.5)
    )
    # 1.5 m is farther than bodies come in the first steps: it is asked for without that cut
    plain = builder().build(snapshot_of(last, [0.0]), forecast).zones.capsules.radius
    wide = builder(UNBOUNDED.model_copy(update={"std_factor": 3.0}))
    wider = wide.build(snapshot_of(last, [0.0]), forecast).zones.capsules.radius
    assert np.allclose(wider[0, 1:], np.array([s.radius for s in CANONICAL.segments]) + 1.5)
    assert (wider[0, 1:] > plain[0, 1:]).all()


def test_absent_parts_have_no_zones():
    zones = builder(absent=("left_leg", "right_leg")).build(snapshot_of(body()[None], [0.0]), None)
    assert not any("shank" in name or "foot" in name for name in zones.zones.segments)
    assert zones.zones.capsules.radius.shape[2] == len(zones.zones.segments) == 11
    with pytest.raises(ConfigError, match="left_arm"):
        builder(absent=("left_amr",))
    with pytest.raises(ConfigError, match="no segment"):
        builder(absent=tuple(CANONICAL.parts))


def test_nobody_gives_empty_zones():
    empty = replace(snapshot_of(np.zeros((0, len(JOINTS), 3)), []), newest_capture_ns=NOW_NS)
    zones = builder().build(empty, None)
    assert zones.zones.capsules.radius.shape == (0, STEPS + 1, len(CANONICAL.segments))
    assert zones.age_s == 0.0
