import json

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL, Segment, make_skeleton
from hri_predict.predictors.process.description import Description

STICK = make_skeleton(
    "stick",
    ["foot", "head", "hat"],
    [-1, 0, 1],
    segments=[Segment(name="body", joint_a=0, joint_b=1, radius=0.2, part="trunk")],
    left_right_pairs=[(0, 1)],
    parts={"trunk": (0, 1, 2)},
    bone_lengths=[0.0, 1.5, 0.3],
)
LIMP = make_skeleton("limp", ["a", "b"], [-1, -1])


class Some:
    history_steps, horizon_steps, rate_hz = 5, 25, 25.0

    def __init__(self, skeleton):
        self.skeleton = skeleton

    def predict(self, history, observed):
        raise AssertionError


def there_and_back(described):
    return Description.from_data(json.loads(json.dumps(described.as_data())))


@pytest.mark.parametrize("skeleton", [CANONICAL, STICK, LIMP])
def test_it_comes_back_as_it_was(skeleton):
    there = there_and_back(Description.of(Some(skeleton), []))
    assert (there.history_steps, there.horizon_steps, there.rate_hz) == (5, 25, 25.0)
    back = there.skeleton
    assert (back is CANONICAL) is (skeleton is CANONICAL)
    for name in ("name", "joints", "parents", "segments", "left_right_pairs", "parts"):
        assert getattr(back, name) == getattr(skeleton, name)
    np.testing.assert_allclose(back.reach, skeleton.reach, atol=1e-12)  # sums of a few metres


def test_other_files_make_another_predictor(tmp_path):
    path = tmp_path / "weights"
    path.write_bytes(b"1")
    before = Description.of(Some(STICK), [path])
    assert before.is_like(there_and_back(Description.of(Some(STICK), [path])))
    path.write_bytes(b"2")
    assert not before.is_like(Description.of(Some(STICK), [path]))
    path.unlink()
    assert not before.is_like(Description.of(Some(STICK), [path]))


def test_other_code_makes_another_predictor():
    before = Description.of(Some(STICK), [], "1a")
    assert before.is_like(there_and_back(Description.of(Some(STICK), [], "1a")))
    assert not before.is_like(Description.of(Some(STICK), [], "1b"))
    assert not before.is_like(Description.of(Some(STICK), []))


def test_another_skeleton_makes_another_predictor():
    assert not Description.of(Some(STICK), []).is_like(Description.of(Some(LIMP), []))
