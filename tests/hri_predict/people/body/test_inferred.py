"""Joints that a tracker never delivers move with the body, and the true ones are near enough."""

import csv
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.lab.calibration.inferred import read_poses
from hri_predict.lab.datasets.splits import in_pack, split
from hri_predict.people.body.inferred import Inference
from hri_sim.people.body import Body

DATA = Path(__file__).resolve().parents[5] / "shared" / "data"
MAPS = [name for name in map_names() if name != "bvh"]
ALL = np.ones(len(JOINTS), bool)
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.0))


def only(*names):
    return np.isin(JOINTS, names)


def of_map(name):
    return Inference(load_joint_map(name).mapped)


def filled_body(inference, body=BODY, observed=None):
    seen = ~inference.joints if observed is None else observed
    return inference.fill(np.where(seen[:, None], body, 0.0), seen)


def reflected(body):
    """The same body in a mirror, so that left is left again."""
    order = np.arange(len(JOINTS))
    for left, right in CANONICAL.left_right_pairs:
        order[[left, right]] = right, left
    return body[order] * [1, -1, 1]


@pytest.mark.parametrize("name", MAPS)
def test_what_a_map_delivers_is_never_inferred(name):
    delivered = load_joint_map(name).mapped
    inference = Inference(delivered)
    assert not (inference.joints & delivered).any()
    filled = filled_body(inference, observed=delivered)
    np.testing.assert_array_equal(filled.positions[delivered], BODY[delivered])
    np.testing.assert_array_equal(filled.within_m > 0, inference.joints)


def test_coco_lacks_nothing_that_is_not_inferred():
    inference = of_map("coco17")
    missing = {"torso", "head_top", "l_hand", "r_hand", "l_foot", "r_foot"}
    assert {j for j, there in zip(JOINTS, inference.joints, strict=True) if there} == missing


def test_where_the_anchors_do_not_suffice_nothing_is_inferred():
    assert not Inference(only("l_shoulder", "l_elbow")).joints.any()
    arms = of_map("assembly_arms")
    np.testing.assert_array_equal(arms.joints, only("l_hand", "r_hand"))


def test_midpoints_may_carry_others():
    inference = Inference(ALL & ~only("waist", "neck", "torso"))
    filled = filled_body(inference)
    hips = BODY[only("l_hip", "r_hip")].mean(0)
    # 2 roundings at a metre
    np.testing.assert_allclose(filled.positions[JOINTS.index("waist")], hips, atol=1e-12)
    assert filled.within_m[JOINTS.index("torso")] > 0


@given(
    name=st.sampled_from(MAPS),
    scale=st.floats(0.5, 2.0),
    angle=st.floats(-np.pi, np.pi),
    shift=st.tuples(*[st.floats(-20, 20)] * 3),
    noise=st.integers(0, 10_000),
)
def test_inferred_joints_move_and_grow_with_the_body(name, scale, angle, shift, noise):
    inference = of_map(name)
    body = BODY + np.random.default_rng(noise).normal(0, 0.05, BODY.shape)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    here = filled_body(inference, body)
    there = filled_body(inference, scale * body @ turn.T + shift)
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
    inference = of_map(name)
    body = BODY + np.random.default_rng(noise).normal(0, 0.05, BODY.shape)
    here, there = filled_body(inference, body), filled_body(inference, reflected(body))
    np.testing.assert_allclose(there.positions, reflected(here.positions), atol=1e-12)


@given(st.sampled_from(MAPS), st.lists(st.booleans(), min_size=21, max_size=21))
def test_an_inferred_joint_is_observed_only_with_all_that_it_rests_on(name, hidden):
    inference = of_map(name)
    seen = ~inference.joints & ~np.array(hidden)
    filled = filled_body(inference, observed=seen)
    for rule in inference.rules:
        anchors = [JOINTS.index(joint) for joint in rule.anchors]
        joint = JOINTS.index(rule.joint)
        assert not filled.observed[joint] or filled.observed[anchors].all()
    assert (filled.within_m[~filled.observed] == 0).all()
    assert np.isfinite(filled.positions).all()


def test_a_body_in_one_point_has_no_inferred_joint():
    inference = of_map("coco17")
    filled = filled_body(inference, np.zeros_like(BODY))
    assert not (filled.observed & inference.joints).any()


def unseen_recordings():
    """Recordings on which nothing was fitted: of the test lists, and of people in the tests."""
    yield from (in_pack(DATA, name) for name in split("test"))
    with (DATA / "motion" / "manifest.csv").open() as lines:
        for row in csv.DictReader(lines):
            if row["person_in_test"]:
                yield DATA / "motion" / row["set"] / f"{row['name']}.npz"


@pytest.mark.skipif(not (DATA / "motion").exists(), reason="needs ../shared/data")
@pytest.mark.parametrize("lacking", ["hand", "wrist", "foot", "hip", "torso", "head_top"])
def test_true_joints_of_people_who_were_not_fitted_are_within(lacking):
    lacks = np.array([joint.endswith(lacking) for joint in JOINTS])
    poses = np.concatenate(list(chain(map(read_poses, unseen_recordings()))))
    known = np.isfinite(poses).all(-1)
    inference = Inference(~lacks)
    filled = inference.fill(np.nan_to_num(poses), known & ~lacks)
    both = filled.observed & known & lacks
    off = np.linalg.norm(filled.positions - np.nan_to_num(poses), axis=-1)[both]
    assert len(off) > 1000
    assert np.mean(off <= filled.within_m[both]) >= 0.995
