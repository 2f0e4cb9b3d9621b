"""The canonical skeleton: its tree, its body, its reach."""

import math
from itertools import pairwise

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import (
    CANONICAL,
    JOINTS,
    PARENTS,
    generations,
    make_skeleton,
    neighbours,
)

SIDED = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")


def test_tree_is_ordered_from_one_root():
    assert len(JOINTS) == len(set(JOINTS)) == len(PARENTS) == 21
    assert [i for i, p in enumerate(PARENTS) if p < 0] == [0]
    assert all(parent < joint for joint, parent in enumerate(PARENTS))


def test_seventeen_segments_by_name():
    expected = {"pelvis", "abdomen", "thorax", "shoulders", "head"}
    expected |= {f"{side}_{name}" for side in "lr" for name in SIDED}
    assert set(CANONICAL.segment_names) == expected
    assert len(CANONICAL.segments) == 17


def test_every_joint_is_in_one_part_and_every_segment_in_a_known_one():
    assert sorted(sum(CANONICAL.parts.values(), ())) == list(range(21))
    assert {s.part for s in CANONICAL.segments} == set(CANONICAL.parts)
    for segment in CANONICAL.segments:
        if segment.part != "torso":
            assert {segment.joint_a, segment.joint_b} <= set(CANONICAL.parts[segment.part])


def test_left_and_right_mirror_each_other():
    mirror = {a: b for pair in CANONICAL.left_right_pairs for a, b in (pair, pair[::-1])}
    assert len(mirror) == 16
    by_name = {s.name: s for s in CANONICAL.segments}
    for name in SIDED:
        left, right = by_name[f"l_{name}"], by_name[f"r_{name}"]
        assert (mirror[left.joint_a], mirror[left.joint_b]) == (right.joint_a, right.joint_b)
        assert left.radius == right.radius
        assert left.part.replace("left", "right") == right.part
    np.testing.assert_array_equal(
        CANONICAL.reach,
        CANONICAL.reach[np.ix_(*[[mirror.get(j, j) for j in range(21)]] * 2)],
    )


# ANSUR II (NATICK/TR-15/007, public data), both sexes: mean and SD in mm of circumferences, and
# of breadths or depths that the capsule must hold as well.
@pytest.mark.parametrize(
    ("segment", "circumference", "breadth"),
    [
        ("pelvis", (1020.08, 76.42), (241.62, 26.48)),
        ("abdomen", (914.50, 114.27), (317.75, 36.36)),
        ("thorax", (1022.10, 100.67), (282.86, 20.66)),
        ("head", (570.04, 18.29), (196.33, 8.49)),
        ("l_upper_arm", (340.93, 41.52), None),
        ("l_forearm", (295.01, 30.05), None),
        ("l_hand", (203.86, 15.55), (84.95, 6.35)),
        ("l_thigh", (622.20, 57.75), None),
        ("l_shank", (386.04, 30.65), None),
        ("l_foot", (332.62, 22.46), (98.87, 6.66)),
    ],
)
def test_radius_holds_a_large_person(segment, circumference, breadth):
    radius = next(s.radius for s in CANONICAL.segments if s.name == segment)
    assert radius >= (circumference[0] + 3 * circumference[1]) / (2 * math.pi) / 1000
    if breadth is not None:
        assert radius >= (breadth[0] + 3 * breadth[1]) / 2 / 1000


def test_reach_is_a_metric_and_adds_up_along_the_tree():
    reach = CANONICAL.reach
    assert np.all(np.isfinite(reach))
    np.testing.assert_array_equal(np.diag(reach), 0)
    np.testing.assert_allclose(reach, reach.T)
    assert np.all(reach[:, :, None] <= reach[:, None, :] + reach[None, :, :] + 1e-12)
    wrist, hand, waist = (CANONICAL.index(j) for j in ("l_wrist", "l_hand", "waist"))
    assert reach[waist, hand] == pytest.approx(reach[waist, wrist] + reach[wrist, hand])


@pytest.mark.parametrize(
    ("a", "b", "longest"),
    [
        # maxima of ANSUR II, metres: forearmhandlength, handlength, shoulderelbowlength,
        # sittingheight, stature, span
        ("l_elbow", "l_hand", 0.574),
        ("l_wrist", "l_hand", 0.239),
        ("l_shoulder", "l_elbow", 0.423),
        ("waist", "head_top", 1.039),
        ("l_foot", "head_top", 1.993),
        ("l_hand", "r_hand", 2.121),
    ],
)
def test_reach_exceeds_the_longest_measured(a, b, longest):
    assert CANONICAL.reach[CANONICAL.index(a), CANONICAL.index(b)] > longest


def test_index_names_the_nearest():
    assert CANONICAL.index("r_foot") == 20
    with pytest.raises(ConfigError, match="no joint 'l_wirst'; did you mean 'l_wrist'"):
        CANONICAL.index("l_wirst")


def test_without_parts():
    assert CANONICAL.without([]) == tuple(range(17))
    left = [CANONICAL.segments[i].name for i in CANONICAL.without(["left_leg", "right_leg"])]
    assert len(left) == 11
    assert not {"l_thigh", "r_shank", "l_foot"} & set(left)
    with pytest.raises(ConfigError, match="'left_legs'; did you mean 'left_leg'"):
        CANONICAL.without(["left_legs"])


def test_neighbours_go_outwards_along_bones():
    order = neighbours(PARENTS)
    hops = make_skeleton("hops", JOINTS, PARENTS, bone_lengths=[1.0] * 21).reach
    np.testing.assert_array_equal(order[:, 0], np.arange(21))
    np.testing.assert_array_equal(np.sort(order, axis=1), np.arange(21)[None].repeat(21, 0))
    assert np.all(np.diff(np.take_along_axis(hops, order, axis=1), axis=1) >= 0)
    assert JOINTS[order[CANONICAL.index("l_hand"), 1]] == "l_wrist"


def test_unknown_bones_and_trees_apart_reach_infinitely_far():
    skeleton = make_skeleton("two", ["a", "b", "c"], [-1, 0, -1])
    assert np.isinf(skeleton.reach[0, 1])
    assert np.isinf(skeleton.reach[0, 2])
    np.testing.assert_array_equal(neighbours(skeleton.parents)[2], [2, 0, 1])


def test_generations_go_from_the_root_outwards():
    found = generations(PARENTS)
    names = [sorted(JOINTS[j] for j in level) for level in found]
    assert names[:3] == [["waist"], ["l_hip", "r_hip", "torso"], ["l_knee", "neck", "r_knee"]]
    assert sorted(j for level in found for j in level) == list(range(len(JOINTS)))
    for above, below in pairwise(found):
        assert {PARENTS[j] for j in below} <= set(above)
