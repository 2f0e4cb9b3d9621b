"""BlazePose's landmarks: outputs as joints of the picture."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hri_drivers.camera.pictures import textured

from hri_drivers.camera.network.landmarks import Outputs, decode, refined  # isort: skip
from hri_drivers.camera.network.roi import Roi  # isort: skip

PICTURE = textured()
ROI = Roi(320.0, 240.0, 256.0, 0.0)
EXACT = 1e-6  # float32 of the network


def outputs(presence: float = 0.9, **changes) -> Outputs:
    """All landmarks in the middle of the square, but the point that gives the next square."""
    points = np.zeros((39, 5))
    points[:, :2], points[:, 3:] = 128.0, 4.0
    points[34, 1] = 28.0  # 100 pixels above the hips
    whole: dict[str, Any] = {
        "points": points,
        "heatmap": np.full((64, 64, 39), -9.0),
        "world": np.zeros((39, 3)),
    }
    return Outputs(presence=presence, **(whole | changes))


def decoded(given_: Outputs, roi: Roi) -> Any:
    result = decode(given_, roi, PICTURE)
    assert result is not None
    return result


def test_a_landmark_is_where_the_square_has_it():
    given_ = outputs()
    given_.points[11, :2] = 64.0, 192.0
    person, _ = decoded(given_, ROI)
    np.testing.assert_allclose(person.pixels[11], [320 - 64, 240 + 64], atol=EXACT)
    assert person.visibility[11] == pytest.approx(1 / (1 + math.exp(-4)))


def test_a_turned_square_turns_pixels_and_metres():
    given_ = outputs()
    given_.points[11, :2] = 192.0, 128.0
    given_.world[11] = 0.3, 0.0, 0.1
    person, _ = decoded(given_, Roi(320.0, 240.0, 256.0, math.pi / 2))
    np.testing.assert_allclose(person.pixels[11], [320, 240 + 64], atol=EXACT)
    np.testing.assert_allclose(person.world[11], [0.0, 0.3, 0.1], atol=EXACT)


def test_the_next_square_is_around_the_landmarks():
    _, onward = decoded(outputs(), ROI)
    assert (onward.x, onward.y) == pytest.approx((320, 240))
    assert onward.size == pytest.approx(2 * 100 * 1.25)


def test_a_joint_outside_the_picture_is_not_found():
    given_ = outputs()
    given_.points[27, :2] = 128.0, 400.0  # 272 below the middle; the picture ends after 240
    person, _ = decoded(given_, ROI)
    assert np.isnan(person.pixels[27]).all()
    assert person.visibility[27] == 0


@pytest.mark.parametrize("column", [3, 4])  # hidden by something; outside the square
def test_a_joint_counts_only_if_visible_and_present(column):
    given_ = outputs()
    given_.points[15, column] = -4.0
    person, _ = decoded(given_, ROI)
    assert person.visibility[15] < 0.02


@pytest.mark.parametrize("presence", [0.4, math.nan])
def test_no_person_no_landmarks(presence):
    assert decode(outputs(presence), ROI, PICTURE) is None


@given(st.sampled_from([math.nan, math.inf, -math.inf]), st.integers(0, 38), st.integers(0, 4))
def test_landmarks_that_are_no_numbers_are_refused(value, point, column):
    given_ = outputs()
    given_.points[point, column] = value
    assert decode(given_, ROI, PICTURE) is None


def test_the_heat_map_moves_a_landmark_to_its_centre():
    heat = np.full((64, 64, 39), -9.0)
    heat[31, 33, 5] = heat[31, 34, 5] = 5.0  # rows are y
    moved = refined(np.full((39, 2), 0.5), heat)
    np.testing.assert_allclose(moved[5], [33.5 / 64, 31 / 64], atol=0.002)  # the rest has 1e-4 each
    np.testing.assert_array_equal(moved[6], [0.5, 0.5])  # shows nothing near it
    np.testing.assert_array_equal(refined(np.full((39, 2), 9.0), heat), np.full((39, 2), 9.0))
