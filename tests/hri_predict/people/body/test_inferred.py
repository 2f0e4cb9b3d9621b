"""Joints that a tracker does not see move with the body, and the true ones are near enough."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.lab.calibration.body_model import HIDDEN, hidden_joints
from hri_predict.lab.calibration.inferred import read_poses
from hri_predict.lab.datasets.splits import in_pack, split
from hri_predict.people.body.body_model import body_model
from hri_predict.people.body.inferred import Inference, rule_of
from hri_predict.people.inferring import HIDDEN_ARM, hidden_arms
from hri_sim.people.body import Body
from tests.shared import DATA

MAPS = [name for name in map_names() if name != "bvh"]
ALL = np.ones(len(JOINTS), bool)
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.0))


def only(*names):
    return np.isin(JOINTS, names)


def of_map(name):
    return load_joint_map(name).mapped


def filled_body(seen, body=BODY, model=None):
    """A body of which some joints are seen, with those that can be inferred."""
    return Inference(model).fill(np.where(seen[:, None], body, 0.0), seen)


def reflected(body):
    """The same body in a mirror, so that left is left again."""
    order = np.arange(len(JOINTS))
    for left, right in CANONICAL.left_right_pairs:
        order[[left, right]] = right, left
    return body[order] * [1, -1, 1]


@pytest.mark.parametrize("model", [None, body_model()], ids=["rules", "postures"])
@pytest.mark.parametrize("name", MAPS)
def test_what_is_seen_is_never_inferred(name, model):
    delivered = of_map(name)
    filled = filled_body(delivered, model=model)
    np.testing.assert_array_equal(filled.positions[delivered], BODY[delivered])
    np.testing.assert_array_equal(filled.within_m > 0, filled.observed & ~delivered)


def test_rules_infer_all_that_coco_lacks():
    assert filled_body(of_map("coco17")).observed.all()


def test_where_the_anchors_do_not_suffice_nothing_is_inferred_by_rules():
    few = only("l_shoulder", "l_elbow")
    np.testing.assert_array_equal(filled_body(few).observed, few)
    arms = of_map("assembly_arms")
    np.testing.assert_array_equal(filled_body(arms).observed & ~arms, only("l_hand", "r_hand"))


def test_a_rule_is_named_for_each_joint_that_it_infers():
    for name in MAPS:
        seen = of_map(name)
        filled = filled_body(seen).observed & ~seen
        named = [rule_of(joint, seen) is not None and not there
                 for joint, there in zip(JOINTS, seen, strict=True)]  # fmt: skip
        np.testing.assert_array_equal(filled, named)


def test_midpoints_may_carry_others():
    filled = filled_body(ALL & ~only("waist", "neck", "torso"))
    hips = BODY[only("l_hip", "r_hip")].mean(0)
    # 2 roundings at a metre
    np.testing.assert_allclose(filled.positions[JOINTS.index("waist")], hips, atol=1e-12)
    assert filled.within_m[JOINTS.index("torso")] > 0


def test_an_inferred_joint_carries_no_other_unless_it_is_a_midpoint():
    """A wrist that was inferred carries no hand: its bone is no measure."""
    seen = ALL & ~only("l_wrist", "l_hand")
    filled = filled_body(seen)
    assert not filled.observed[JOINTS.index("l_hand")]
    assert filled_body(seen, model=body_model()).observed.all()


@given(
    name=st.sampled_from(MAPS),
    scale=st.floats(0.5, 2.0),
    angle=st.floats(-np.pi, np.pi),
    shift=st.tuples(*[st.floats(-20, 20)] * 3),
    noise=st.integers(0, 10_000),
)
def test_inferred_joints_move_and_grow_with_the_body(name, scale, angle, shift, noise):
    seen = of_map(name)
    body = BODY + np.random.default_rng(noise).normal(0, 0.05, BODY.shape)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    here = filled_body(seen, body)
    there = filled_body(seen, scale * body @ turn.T + shift)
    # 1e-16 of 20 m, over a bone of 0.05 m at least, and a side that is a tenth of its vector
    np.testing.assert_array_equal(here.observed, there.observed)
    moved = np.where(here.observed[:, None], scale * here.positions @ turn.T + shift, 0.0)
    np.testing.assert_allclose(there.positions, moved, atol=1e-10)
    # radii grow likewise, except where people's longest bones bound them already
    more, less = (there, here) if scale >= 1 else (here, there)
    most = less.within_m * max(scale, 1 / scale)
    assert (more.within_m <= most + 1e-10).all()
    assert (more.within_m >= less.within_m - 1e-10).all()
    small = most < 0.15
    np.testing.assert_allclose(more.within_m[small], most[small], atol=1e-10)


@given(name=st.sampled_from(MAPS), noise=st.integers(0, 10_000))
def test_left_and_right_are_inferred_alike(name, noise):
    seen = of_map(name)
    body = BODY + np.random.default_rng(noise).normal(0, 0.05, BODY.shape)
    here, there = filled_body(seen, body), filled_body(seen, reflected(body))
    np.testing.assert_allclose(there.positions, reflected(here.positions), atol=1e-12)


@given(st.sampled_from(MAPS), st.lists(st.booleans(), min_size=21, max_size=21))
def test_a_joint_is_inferred_only_with_all_that_it_rests_on(name, hidden):
    seen = of_map(name) & ~np.array(hidden)
    filled = filled_body(seen)
    for index in np.flatnonzero(filled.observed & ~seen):
        rule = rule_of(JOINTS[index], seen)
        assert rule is not None
        assert filled.observed[only(*rule.anchors)].all()
    assert (filled.within_m[~filled.observed] == 0).all()
    assert np.isfinite(filled.positions).all()


@given(st.lists(st.booleans(), min_size=21, max_size=21), st.integers(0, 10_000))
def test_whatever_is_seen_what_is_filled_is_a_number(hidden, noise):
    body = BODY + np.random.default_rng(noise).normal(0, 0.05, BODY.shape)
    seen = ~np.array(hidden)
    filled = filled_body(seen, body, body_model())
    assert np.isfinite(filled.positions).all()
    np.testing.assert_array_equal(filled.within_m > 0, filled.observed & ~seen)
    # what rules place, they place with the postures too
    by_rules = filled_body(seen, body)
    np.testing.assert_array_equal(
        filled.positions[by_rules.observed], by_rules.positions[by_rules.observed]
    )


@pytest.mark.parametrize("model", [None, body_model()], ids=["rules", "postures"])
def test_a_body_in_one_point_has_no_inferred_joint(model):
    seen = of_map("coco17")
    filled = filled_body(seen, np.zeros_like(BODY), model)
    np.testing.assert_array_equal(filled.observed, seen)


def test_people_and_steps_are_filled_as_each_alone():
    rng = np.random.default_rng(8)
    bodies = BODY + rng.normal(0, 0.03, (2, 5, *BODY.shape))
    seen = rng.random(bodies.shape[:-1]) < 0.7
    inference = Inference(body_model())
    together = inference.fill(bodies, seen)
    for person, step in np.ndindex(2, 5):
        alone = inference.fill(bodies[person, step], seen[person, step])
        np.testing.assert_array_equal(alone.observed, together.observed[person, step])
        for name in ("positions", "within_m"):
            among = getattr(together, name)[person, step]
            np.testing.assert_allclose(getattr(alone, name), among, atol=1e-12)


def unseen_recordings():
    """Recordings on which nothing was fitted: of the test lists, and of people in the tests."""
    yield from (in_pack(DATA, name) for name in split("test"))
    with (DATA / "motion" / "manifest.csv").open() as lines:
        for row in csv.DictReader(lines):
            if row["person_in_test"]:
                yield DATA / "motion" / row["set"] / f"{row['name']}.npz"


@pytest.fixture(scope="module")
def poses():
    return [read_poses(path) for path in unseen_recordings()]


needs_data = pytest.mark.skipif(not (DATA / "motion").exists(), reason="needs ../shared/data")


@needs_data
@pytest.mark.parametrize("lacking", ["hand", "wrist", "foot", "hip", "torso", "head_top"])
def test_true_joints_of_people_who_were_not_fitted_are_within(poses, lacking):
    lacks = np.array([joint.endswith(lacking) for joint in JOINTS])
    held = np.concatenate([share_held(pose, lacks, Inference()) for pose in poses])
    assert len(held) > 1000
    assert np.mean(held) >= 0.995


@needs_data
@pytest.mark.parametrize("hidden", HIDDEN)
def test_true_joints_are_within_what_postures_say(poses, hidden):
    """Each recording counts once: poses of one resemble each other. Stated are 99 %."""
    lacks, listed = hidden_joints(HIDDEN[hidden]), poses[: len(split("test"))]
    held = [share_held(pose, lacks, Inference(body_model())) for pose in listed]
    shares = [each.mean() for each in held if len(each) > 100]
    assert len(shares) > 5
    assert np.mean(shares) >= 0.97


def share_held(pose, lacks, inference):
    """Of each inferred joint that is known, whether it is within, as of a body that stays so."""
    known = np.isfinite(pose).all(-1)
    filled = inference.fill(np.nan_to_num(pose), known & ~lacks)
    both = filled.observed & known & lacks
    off = np.linalg.norm(filled.positions - np.nan_to_num(pose), axis=-1)
    arms = np.where(hidden_arms((known & ~lacks)[:, None]), HIDDEN_ARM, 1.0)
    return (off <= arms * filled.within_m)[both]
