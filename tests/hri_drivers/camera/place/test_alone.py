"""One camera: the place by landmarks in metres and their pixels."""

from dataclasses import replace

import numpy as np
import pytest

from hri_drivers.camera.place.alone import place_alone
from hri_drivers.camera.place.placed import Placed, Unplaced
from hri_predict.base.errors import ConfigError
from tests.hri_drivers.camera.place.bodies import CAMERA, JOINTS, person, seen_at

EXACT_M = 1e-6
"""Pixels and landmarks without errors: what is left is rounding, 1e-16 of metres, 30 joints, and
the loss of digits where rays are nearly parallel."""


@pytest.mark.parametrize("place", [(0, 0, 3), (1.2, 0.1, 2.5), (-2.5, -0.4, 5), (0.3, 0.1, 9)])
def test_a_person_is_where_the_landmarks_fit_their_pixels(place):
    place = np.array(place, float)
    found = place_alone(seen_at(place), CAMERA)
    assert isinstance(found, Placed)
    assert found.observed.any()
    truth = person() + place
    np.testing.assert_allclose(found.positions[found.observed], truth[found.observed], atol=EXACT_M)
    assert np.isnan(found.positions[~found.observed]).all()


def test_the_error_grows_with_the_distance_and_with_what_is_not_known():
    def error_m(metres, camera=CAMERA, height_m=None):
        found = place_alone(seen_at(np.array([0, 0, metres]), CAMERA), camera, height_m)
        assert isinstance(found, Placed)
        return found.error_m

    calibrated = replace(CAMERA, focal_error=0.01)
    assert error_m(3, calibrated, 1.7) < error_m(3, calibrated) < error_m(3)
    assert error_m(3, calibrated) < error_m(6, calibrated) < 2 * error_m(3, calibrated)


def test_the_error_is_larger_where_the_size_of_the_body_is_not_seen():
    seen = seen_at(np.array([0, 0, 3]))
    legs_hidden = replace(seen, visibility=np.where(person()[:, 1] > 0.3, 0.1, 1.0))
    whole, part = (place_alone(each, CAMERA) for each in (seen, legs_hidden))
    assert isinstance(whole, Placed)
    assert isinstance(part, Placed)
    assert part.error_m > 1.2 * whole.error_m


def test_a_tall_person_is_farther_away():
    seen = seen_at(np.array([0.5, 0, 3]))
    tall, common = (place_alone(seen, CAMERA, height) for height in (1.87, 1.70))
    assert isinstance(tall, Placed)
    assert isinstance(common, Placed)
    np.testing.assert_allclose(tall.positions, common.positions * 1.1, atol=EXACT_M)


def test_what_is_hidden_or_outside_of_the_picture_is_not_observed():
    seen = seen_at(np.array([0, 0.6, 1.6]))  # the feet are below the picture
    hidden = JOINTS.index("left_wrist")
    seen.visibility[hidden] = 0.49
    found = place_alone(seen, CAMERA)
    assert isinstance(found, Placed)
    assert not found.observed[[hidden, JOINTS.index("left_ankle")]].any()
    assert found.observed[JOINTS.index("right_wrist")]


def test_one_wrong_joint_does_not_move_the_others():
    seen = seen_at(np.array([0, 0, 3]))
    seen.pixels[JOINTS.index("right_wrist")] += [150, 0]
    found = place_alone(seen, CAMERA)
    assert isinstance(found, Placed)
    nose = JOINTS.index("nose")
    assert np.linalg.norm(found.positions[nose] - (person()[nose] + [0, 0, 3])) < 0.05


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda s: replace(s, visibility=np.zeros(33)), "visible"),
        (lambda s: replace(s, pixels=np.full((33, 2), np.nan)), "visible"),
        (lambda s: replace(s, world=np.full((33, 3), np.nan)), "visible"),
        (lambda s: replace(s, world=s.world * [1, -1, 1]), "disagree"),
        (lambda s: replace(s, world=s.world * 8), "away"),
        (lambda s: replace(s, world=s.world * 0.1), "away"),
        (lambda s: replace(s, pixels=np.tile([640.0, 360.0], (33, 1))), "disagree"),
    ],
)
def test_what_cannot_be_is_not_placed(change, why):
    found = place_alone(change(seen_at(np.array([0, 0, 3.0]))), CAMERA)
    assert isinstance(found, Unplaced)
    assert why in found.why


def test_pixels_alone_are_refused():
    with pytest.raises(ConfigError, match="landmarks in metres"):
        place_alone(replace(seen_at(np.array([0, 0, 3])), world=None), CAMERA)


@pytest.mark.parametrize("height_m", [0.5, 178, float("nan")])
def test_a_height_of_no_person_is_refused(height_m):
    with pytest.raises(ConfigError, match="height"):
        place_alone(seen_at(np.array([0, 0, 3])), CAMERA, height_m)
