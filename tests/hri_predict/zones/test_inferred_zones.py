"""Zones of bodies with inferred joints: tighter than the skeleton's reach, never too tight."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.predictor import Forecast
from hri_predict.lab.calibration.body_model import HIDDEN, hidden_joints
from hri_predict.people.body.body_model import body_model
from hri_predict.people.body.inferred import Inference
from hri_predict.people.inferring import with_inferred
from hri_predict.people.snapshot import RecentCaptures
from hri_predict.zones.body_zones import ZoneBuilder
from hri_predict.zones.calibration import load_calibration, shipped_calibration
from hri_predict.zones.human_speed import velocities_in
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants, Trust
from hri_predict.zones.settings import CoverageSettings, HumanLimits
from hri_sim.people.body import Body
from tests.hri_predict.lost_person import lost_person
from tests.hri_predict.zones.conftest import scale_of
from tests.hri_predict.zones.test_body_zones import snapshot_of

RATE_HZ, STEPS = 25.0, 25
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.0))
COCO = load_joint_map("coco17").mapped
MAPS = ("coco17", "mediapipe33", "xsens23", "assembly_arms")
SEEN = {name: load_joint_map(name).mapped for name in MAPS} | {
    name: ~hidden_joints(HIDDEN[name]) for name in ("legs below the hips", "forearms", "left arm")
}
# one scale for all: what the network reads of other joints is not what is tested here
CALIBRATION = replace(load_calibration(shipped_calibration("zero_velocity")), scale=scale_of())
SURE = Trust(
    residual_m=np.zeros(1),
    error_m=np.zeros((1, 2, len(JOINTS))),
    widen=np.ones((1, STEPS)),
    out_of_distribution=np.zeros(1, np.bool_),
)


def builder(calibrated=True):
    radii = Radii(CALIBRATION, CoverageSettings(), CANONICAL, STEPS) if calibrated else None
    return ZoneBuilder(
        skeleton=CANONICAL,
        absent_parts=(),
        limits=HumanLimits(),
        rate_hz=RATE_HZ,
        horizon_steps=STEPS,
        radii=radii,
    )


def seen_by(delivered, path=None, infers=True):
    """One person's snapshot, whose last steps are ``path`` (T, J, 3)."""
    path = np.repeat(BODY[None], 10, axis=0) if path is None else path
    whole = snapshot_of(path[None, -1], [0.0])
    snapshot = replace(
        whole,
        history=np.where(delivered[:, None], path, 0.0)[None],
        observed=np.broadcast_to(delivered, path.shape[:2])[None],
        last_positions=np.where(delivered[:, None], path[-1], np.nan)[None],
        joint_age_s=np.where(delivered, 0.0, np.inf)[None],
    )
    recent = RecentCaptures.of_history(snapshot.history, snapshot.observed, RATE_HZ)
    snapshot = replace(snapshot, recent=recent)
    return with_inferred(snapshot, Inference(body_model()), RATE_HZ) if infers else snapshot


def standing_still(snapshot):
    last = np.nan_to_num(snapshot.last_positions)
    return Forecast(np.repeat(last[:, None], STEPS, axis=1), None)


def zones_of(snapshot, calibrated=True, forecast=True):
    ahead = standing_still(snapshot) if forecast else None
    built = builder(calibrated).build(snapshot, ahead, trust=SURE if calibrated else None)
    return built.zones


def radius(zones, segment, step=0):
    return float(zones.capsules.radius[0, step, zones.segments.index(segment)])


@pytest.mark.long
def test_coco_bodies_are_no_longer_inflated():
    bounded, inferred = zones_of(seen_by(COCO, infers=False)), zones_of(seen_by(COCO))
    trunk_m = np.linalg.norm(BODY[JOINTS.index("neck")] - BODY[JOINTS.index("waist")])
    forearm_m = np.linalg.norm(BODY[JOINTS.index("l_wrist")] - BODY[JOINTS.index("l_elbow")])
    assert radius(bounded, "thorax") > 0.6
    own = next(s.radius for s in CANONICAL.segments if s.name == "thorax")
    assert radius(inferred, "thorax") == pytest.approx(own + 0.251 * trunk_m)
    assert radius(bounded, "l_hand") > 0.37
    assert radius(inferred, "l_hand") == pytest.approx(0.1 + 0.534 * forearm_m)


def test_a_joint_that_was_just_hidden_is_no_farther_than_one_that_was_never_seen():
    # Calibrated zones of a hidden trunk joint grow at 10 m/s, so its reach from a joint that is
    # seen soon bounds it, however recently it was seen.
    shoulders = [JOINTS.index(name) for name in ("l_shoulder", "r_shoulder")]
    delivered = ~np.isin(np.arange(len(JOINTS)), [*shoulders, JOINTS.index("neck")])
    never = seen_by(delivered & (np.arange(len(JOINTS)) != JOINTS.index("waist")), infers=False)
    just = replace(
        never,
        last_positions=np.where(
            np.isin(np.arange(len(JOINTS)), shoulders)[:, None], BODY, never.last_positions
        ),
        joint_age_s=np.where(np.isin(np.arange(len(JOINTS)), shoulders), 0.04, never.joint_age_s),
    )
    hidden, unknown = zones_of(just), zones_of(never)
    assert radius(hidden, "shoulders") < radius(unknown, "shoulders")  # at the capture
    for step in range(1, STEPS + 1):
        assert radius(hidden, "shoulders", step) <= radius(unknown, "shoulders", step) + 1e-9


def true_body(snapshot, seed):
    """A body that has its inferred joints anywhere within what is stated of them."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=BODY.shape)
    direction *= rng.uniform(0, 1, len(BODY))[:, None] / norm(direction)[:, None]
    known = np.isfinite(snapshot.last_positions[0])
    here = np.where(known, snapshot.last_positions[0], BODY)
    return here + direction * snapshot.inferred.within_m[0][:, None]


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("forecast", [True, False])
@pytest.mark.parametrize("name", SEEN)
def test_a_zone_is_never_smaller_than_with_the_joint_seen(calibrated, forecast, name):
    snapshot = seen_by(SEEN[name])
    inferred = zones_of(snapshot, calibrated, forecast)
    for seed in range(5):
        path = np.repeat(true_body(snapshot, seed)[None], 10, axis=0)
        whole = zones_of(seen_by(np.ones(len(JOINTS), bool), path), calibrated, forecast)
        # 1e-9: sums of a few metres
        assert (inferred.capsules.radius >= whole.capsules.radius - 1e-9).all()


@given(st.integers(0, 10_000), st.sampled_from(list(SEEN)))
def test_the_zone_at_capture_holds_the_true_body_wherever_the_joint_is(seed, name):
    """The true hand, foot, trunk is anywhere within what is inferred."""
    snapshot = seen_by(SEEN[name])
    true = true_body(snapshot, seed)
    zones = zones_of(snapshot)
    for index, segment in enumerate(CANONICAL.segments):
        ends = true[[segment.joint_a, segment.joint_b]]
        a, b = zones.capsules.a[0, 0, index], zones.capsules.b[0, 0, index]
        along = np.clip((ends - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
        off = np.linalg.norm(ends - a - along[:, None] * (b - a), axis=1)
        assert (off + segment.radius <= zones.capsules.radius[0, 0, index] + 1e-9).all()


def test_legs_behind_a_bench_are_no_longer_bounded_by_reach():
    seen = SEEN["legs below the hips"]
    bounded, inferred = zones_of(seen_by(seen, infers=False)), zones_of(seen_by(seen))
    for segment in ("l_shank", "r_foot"):
        assert radius(inferred, segment) < 0.7 * radius(bounded, segment)


def test_the_radius_of_an_inferred_joint_adds_two_errors():
    """Those of its place and of its forecast: 1.15 times the root of the sum of both squares."""
    snapshot, foot = seen_by(SEEN["legs below the hips"]), JOINTS.index("l_foot")
    spheres = builder().joints.build(
        snapshot, standing_still(snapshot), capture_ns=snapshot.now_ns, trust=SURE
    )
    within = snapshot.inferred.within_m[0, foot]
    assert within > 0.1
    for step in (1, 3, 10, STEPS):
        both = 1.15 * np.hypot(spheres.claimed[0, step - 1, foot], within)
        assert spheres.radius[0, step, foot] == pytest.approx(both)
    assert spheres.radius[0, 0, foot] == pytest.approx(within)  # at the capture


def test_an_inferred_joint_has_no_measured_speed_but_lets_its_zone_grow_with_it():
    hand = JOINTS.index("l_hand")
    arm = np.isin(JOINTS, ("l_elbow", "l_wrist", "l_hand"))
    times = np.arange(-9, 1) / RATE_HZ
    path = BODY + 3.0 * times[:, None, None] * arm[:, None] * np.array([1.0, 0, 0])
    snapshot = seen_by(COCO, path)
    _, measured = velocities_in(snapshot, RATE_HZ)
    np.testing.assert_array_equal(measured[0], COCO)
    built = builder(calibrated=False).build(snapshot, None)
    assert built.speeds.fast[0]
    assert built.speeds.fastest_joint[0] != hand
    grown = built.zones.capsules.radius[0, 10, built.zones.segments.index("l_hand")]
    assert grown > 3.0 * 10 / RATE_HZ  # as fast as the arm


def test_an_inferred_hand_may_turn_as_fast_as_a_body_can():
    built = builder(calibrated=False).build(seen_by(COCO), None)
    own = dict(zip(built.zones.segments, built.segments_m_s[0], strict=True))
    reach = HumanLimits().reach
    assert own["l_hand"] == own["r_hand"] == reach["arm"].speed_m_s
    assert own["l_foot"] == reach["leg"].speed_m_s
    assert own["l_forearm"] == own["thorax"] == pytest.approx(0.0, abs=1e-9)
    whole = builder(calibrated=False).build(seen_by(np.ones(len(JOINTS), bool)), None)
    assert whole.segments_m_s == pytest.approx(0.0, abs=1e-9)


def test_a_lost_person_s_inferred_joints_are_larger_by_what_is_uncertain():
    here = seen_by(COCO)
    unsure = here.inferred.within_m[0]
    lost = replace(lost_person(1, here.last_positions[0], here.now_ns), inferred_m=unsure)
    sure = replace(lost, inferred_m=None)
    empty = snapshot_of(np.zeros((0, len(JOINTS), 3)), [])
    radii = [
        builder(False).joints.build(replace(empty, lost=(p,)), None, capture_ns=None, trust=None)
        for p in (lost, sure)
    ]
    for which in ("radius", "inflation"):
        more = getattr(radii[0], which) - getattr(radii[1], which)
        np.testing.assert_allclose(more[0], np.broadcast_to(unsure, more[0].shape), atol=1e-12)


def test_inferred_joints_never_judge_a_forecast():
    check = SelfCheck(
        SelfCheckConstants(), level=0.9, of="joint", rate_hz=RATE_HZ, horizon_steps=STEPS,
        ranges=None,
    )  # fmt: skip
    radius_m = np.full((1, STEPS, len(JOINTS)), 0.1)
    snapshot = seen_by(COCO)
    forecast = standing_still(snapshot)
    for _ in range(40):
        snapshot = replace(
            snapshot,
            now_ns=snapshot.now_ns + 40_000_000,
            capture_ns=snapshot.capture_ns + 40_000_000,
        )
        check.check(snapshot)
        # forecasts that fail in every inferred joint
        wrong = forecast.positions + (5.0 * ~COCO)[:, None]
        check.note(snapshot, Forecast(wrong, None), radius_m)
    trust = check.check(snapshot)
    assert (trust.widen == 1.0).all()
    assert trust.residual_m[0] < 1e-9
