"""The scale's shape: factors by size, interpolated log by log, and stored."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.zones.scale_shape import KNOTS, ScaleShape

SIZES = np.geomspace(0.01, 1.28, KNOTS)  # each twice the one before


def shape_of(factors, steps=3):
    """The same in all steps; the classes' factors are 1, 2 and 3 times these."""
    factor = np.broadcast_to(factors, (3, steps, KNOTS)) * np.arange(1.0, 4.0)[:, None, None]
    return ScaleShape(np.broadcast_to(SIZES, factor.shape).copy(), factor)


def test_a_scale_at_a_knot_gets_its_factor_and_one_between_two_their_geometric_mean():
    shape = shape_of(2.0 ** -np.arange(KNOTS))
    scale = np.array([[[0.01, 0.02, 0.01 * np.sqrt(2)]]])
    expected = scale * [[[1.0, 0.5, np.sqrt(0.5)]]]
    np.testing.assert_allclose(shape.of(scale, np.array([0])), expected, rtol=1e-12)


def test_beyond_the_knots_the_nearest_factor_holds():
    shape = shape_of(np.arange(1.0, KNOTS + 1))
    scale = np.array([[[1e-6, 50.0]]])
    np.testing.assert_allclose(shape.of(scale, np.array([0])), scale * [[[1.0, KNOTS]]])


def test_each_window_has_the_factors_of_its_speed_class_and_each_step_its_own():
    shape = shape_of(np.ones(KNOTS))
    later = ScaleShape(shape.size_m, shape.factor * np.array([1.0, 10.0, 100.0])[:, None])
    scale = np.full((3, 4, 2), 0.3)
    found = later.of(scale, np.array([2, 0, 1])) / scale
    assert found[:, 0, 0] == pytest.approx([3, 1, 2])
    assert found[1, :, 1] == pytest.approx([1, 10, 100, 100])  # as the last one that is known


@given(st.lists(st.floats(0.01, 100), min_size=KNOTS, max_size=KNOTS), st.floats(1e-4, 10))
def test_it_is_what_numpy_interpolates(factors, size):
    shape = shape_of(np.array(factors))
    found = shape.of(np.array([[[size]]]), np.array([0]))[0, 0, 0]
    log = np.interp(np.log(size), np.log(SIZES), np.log(factors))
    assert found == pytest.approx(size * np.exp(log), rel=1e-9)


def test_what_is_stored_comes_back_not_smaller():
    shape = shape_of(np.linspace(0.7, 3.3333, KNOTS))
    back = ScaleShape.of_json(json.loads(json.dumps(shape.to_json())), 3)
    np.testing.assert_allclose(back.size_m, shape.size_m, atol=1e-6)
    assert (back.factor >= shape.factor - 1e-9).all()
    np.testing.assert_allclose(back.factor, shape.factor, atol=1e-3)


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda d: d.pop("size_um"), "must have size_um and thousandths"),
        (lambda d: d.update(more=1), "must have size_um and thousandths"),
        (lambda d: d["size_um"].pop(), "must have the shape"),
        (lambda d: d["thousandths"][0].pop(), "shape"),
        (lambda d: d["thousandths"][0][0].__setitem__(0, "far"), "not a table of numbers"),
        (lambda d: d["thousandths"][0][0].__setitem__(0, 10**400), "not a table of numbers"),
        (lambda d: d["thousandths"][0][0].__setitem__(0, None), "between 0 and 1000"),
        (lambda d: d["thousandths"][0][0].__setitem__(0, 0), "between 0 and 1000"),
        (lambda d: d["thousandths"][0][0].__setitem__(0, float("inf")), "between 0 and 1000"),
        (lambda d: d["size_um"][1][2].reverse(), "must ascend"),
        (lambda d: d["size_um"][1][2].__setitem__(0, -5), "must ascend"),
        (lambda d: d["size_um"][1][2].__setitem__(0, float("nan")), "must ascend"),
    ],
)
def test_a_damaged_shape_is_refused(edit, said):
    data = shape_of(np.ones(KNOTS)).to_json()
    edit(data)
    with pytest.raises(ValueError, match=said):
        ScaleShape.of_json(data, 3)
