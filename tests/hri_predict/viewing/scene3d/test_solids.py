import numpy as np
import pytest

from hri_predict.viewing.scene3d.solids import cylinder, cylinders_of, sphere, spheres_of


def turned(wxyz: np.ndarray, v: np.ndarray) -> np.ndarray:
    w, xyz = wxyz[0], wxyz[1:]
    return v + 2 * np.cross(xyz, np.cross(xyz, v) + w * v)


@pytest.mark.parametrize(
    "along", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -2, 0), (0.3, -0.4, -0.5), (1e-9, 0, -1)]
)
def test_a_cylinder_reaches_from_end_to_end(along):
    a = np.array([1.0, 2.0, 3.0])
    b = a + along
    middle, turn, scale = cylinders_of(np.array([[*a, *b, 0.1]], np.float32))
    tip = middle[0] + turned(turn[0], np.array([0, 0, 0.5]) * scale[0])
    np.testing.assert_allclose(tip, b, atol=1e-5)  # 32-bit floats at 4 m, times ten
    assert scale[0, 0] == scale[0, 1] == pytest.approx(0.1)


def test_a_capsule_without_length_is_drawn_as_one_sphere():
    row = np.array([[1, 1, 1, 1, 1, 1, 0.2]], np.float32)
    assert np.isfinite(np.concatenate([part.ravel() for part in cylinders_of(row)])).all()
    middles, scales = spheres_of(row)
    np.testing.assert_allclose(middles, np.ones((2, 3)))
    np.testing.assert_allclose(scales, [[0.2] * 3, [0.0] * 3], atol=1e-5)  # not to be seen


@pytest.mark.parametrize("shape", [sphere, cylinder])
def test_sides_look_outwards(shape):
    vertices, faces = shape()
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    middle = (a + b + c) / 3
    if shape is cylinder:
        middle[:, 2] = 0.0
    outward = (normal * middle).sum(axis=1)
    assert (outward > -1e-9).all()
    assert faces.max() == len(vertices) - 1
