"""BlazePose's detector: anchors and decoding."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.camera.network.detector import ANCHORS, SIDE, decode

EXACT = 1e-6
"""The network's output has float32, seven digits."""
COUNT = 2254


def output() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((1, COUNT, 12), np.float32), np.full((1, COUNT, 1), -9.0, np.float32)


def show(boxes, scores, anchor, *, at, score):
    """Let an anchor show a person whose hips are at ``at``, 0..1, with a face box above."""
    offset = (np.asarray(at) - ANCHORS[anchor]) * SIDE
    boxes[0, anchor] = [*offset, 40, 40, *offset, *(offset - [0, 80]), *offset, *offset]
    scores[0, anchor] = score


def test_anchors_are_those_of_the_published_grid():
    assert ANCHORS.shape == (COUNT, 2)  # 2 * 28^2 + 2 * 14^2 + 6 * 7^2
    np.testing.assert_allclose(ANCHORS[0], [0.5 / 28, 0.5 / 28])
    np.testing.assert_allclose(ANCHORS[1], ANCHORS[0])  # two at each place
    np.testing.assert_allclose(ANCHORS[2], [1.5 / 28, 0.5 / 28])  # x runs first
    np.testing.assert_allclose(ANCHORS[2 * 28 * 28], [0.5 / 14, 0.5 / 14])
    np.testing.assert_allclose(ANCHORS[-6:], [[6.5 / 7, 6.5 / 7]] * 6)


def test_a_person_is_decoded_from_its_anchor():
    boxes, scores = output()
    show(boxes, scores, 1000, at=(0.4, 0.6), score=2.0)
    (one,) = decode(boxes, scores)
    np.testing.assert_allclose(one.points[0], [0.4, 0.6], atol=EXACT)
    np.testing.assert_allclose(one.points[1], [0.4, 0.6 - 80 / SIDE], atol=EXACT)
    half = 20 / SIDE
    np.testing.assert_allclose(
        one.box, [0.4 - half, 0.6 - half, 0.4 + half, 0.6 + half], atol=EXACT
    )
    assert one.score == pytest.approx(1 / (1 + np.exp(-2.0)))


def test_anchors_that_show_one_person_are_averaged_by_their_scores():
    boxes, scores = output()
    show(boxes, scores, 1000, at=(0.40, 0.6), score=2.0)
    show(boxes, scores, 1002, at=(0.42, 0.6), score=0.0)
    (one,) = decode(boxes, scores)
    a, b = 1 / (1 + np.exp(-2.0)), 0.5
    assert one.points[0, 0] == pytest.approx((0.40 * a + 0.42 * b) / (a + b), abs=EXACT)


def test_two_people_stay_two_the_surest_first():
    boxes, scores = output()
    show(boxes, scores, 300, at=(0.2, 0.5), score=1.0)
    show(boxes, scores, 1200, at=(0.8, 0.5), score=3.0)
    assert [round(one.points[0, 0], 3) for one in decode(boxes, scores)] == [0.8, 0.2]


@given(st.integers(0, 2**32 - 1))
def test_any_output_gives_finite_people(seed):
    """Random bytes: numbers of all sizes, NaN and infinity among them."""
    random = np.random.default_rng(seed)
    boxes = np.frombuffer(random.bytes(4 * COUNT * 12), np.float32).reshape(1, COUNT, 12)
    scores = np.frombuffer(random.bytes(4 * COUNT), np.float32).reshape(1, COUNT, 1)
    for one in decode(boxes, scores):
        assert np.isfinite(one.points).all()
        assert 0.3 <= one.score <= 1
