"""Sizes of zones: volumes by hand, and what is compared with what."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.conformal import calibrate
from hri_predict.lab.calibration.coverage import Calibrated
from hri_predict.lab.calibration.scores import score_recordings
from hri_predict.lab.calibration.sizes import Sizes, capsule_volume, measure_sizes
from hri_predict.predictors.baselines import ZeroVelocity, ZeroVelocitySettings
from hri_predict.zones.settings import CoverageSettings
from tests.hri_predict.zones.conftest import scale_of

STEPS = 12
BODY = np.random.default_rng(4).normal(size=(len(JOINTS), 3), scale=0.3)


@pytest.fixture(scope="module")
def zero():
    return ZeroVelocity(ZeroVelocitySettings(name="zero_velocity", horizon_s=STEPS / 25))


@pytest.fixture(scope="module")
def scores(make_recording, zero):
    """Four people who sway by a centimetre; no hand is visible."""
    seen = np.ones((50, len(JOINTS)), bool)
    seen[:, JOINTS.index("l_hand")] = False
    recordings = [
        make_recording(
            BODY + np.random.default_rng(k).normal(scale=0.01, size=(50, 1, 3)),
            name=f"swaying_{k}",
            observed=seen,
        )
        for k in range(4)
    ]
    return score_recordings(zero, recordings)


def sizes_with(scores, zero, radius_m):
    made = calibrate(
        scores=scores,
        predictor="zero_velocity",
        settings={},
        weights=None,
        rate_hz=25.0,
        skeleton=CANONICAL,
    )
    tables = {of: np.full_like(table, radius_m) for of, table in made.estimated.items()}
    flat = replace(made, estimated=tables, limits=None, scale=scale_of())
    methods = {"own": (scores, Calibrated(zero, flat))}
    settings = CoverageSettings(self_check=False)
    return measure_sizes(scores, methods, settings, (5, 10))


def test_a_capsule_is_a_cylinder_and_a_ball():
    # pi 0.5^2 2 = 1.5708 and 4/3 pi 0.5^3 = 0.5236
    assert capsule_volume(np.array(2.0), np.array(0.5)) == pytest.approx(1.5708 + 0.5236, abs=1e-4)


@given(st.floats(0, 5), st.floats(0.01, 5), st.floats(0.001, 2))
def test_volumes_grow_with_length_and_radius(length, radius, more):
    volume = capsule_volume(np.array(length), np.array(radius))
    assert capsule_volume(np.array(length + more), np.array(radius)) > volume
    assert capsule_volume(np.array(length), np.array(radius + more)) > volume


def test_a_ball_of_the_standard_by_hand(scores, zero):
    sizes = sizes_with(scores, zero, 0.1)
    part = sizes.parts.index("right_leg")
    expected = np.zeros(())
    for segment in (s for s in CANONICAL.segments if s.part == "right_leg"):
        length = np.linalg.norm(BODY[segment.joint_a] - BODY[segment.joint_b])
        # 0.4 s at 1.6 m/s are 0.64 m, on top of the segment's own radius
        expected = expected + capsule_volume(np.array(length), np.array(segment.radius + 0.64))
    assert sizes.by_method["1.6 m/s"][1, part] == pytest.approx(expected, rel=1e-6)


def test_a_zone_as_large_as_a_ball_is_as_large(scores, zero):
    sizes = sizes_with(scores, zero, 1.6 * 0.4)
    own, ball = sizes.by_method["own"][1], sizes.by_method["1.6 m/s"][1]
    arms = [i for i, p in enumerate(sizes.parts) if p.endswith("arm")]
    others = [i for i in range(len(sizes.parts)) if i not in arms]
    assert own[others] == pytest.approx(ball[others], rel=0.02)  # the bones cut a little
    assert (own <= ball * 1.0001).all()
    assert sizes.relative("own", "1.6 m/s")[1, -1] == pytest.approx(own.sum() / ball.sum())


def test_a_segment_with_an_unseen_end_does_not_count(scores, zero):
    sizes = sizes_with(scores, zero, 0.1)
    left, right = (sizes.parts.index(f"{side}_arm") for side in ("left", "right"))
    ball = sizes.by_method["1.6 m/s"][0]
    assert ball[left] < ball[right]  # no hand


@pytest.mark.long
def test_smaller_radii_make_smaller_zones_within_what_bodies_can_do(scores, zero):
    small, large = (sizes_with(scores, zero, r).by_method["own"] for r in (0.05, 0.3))
    assert (small < large).all()
    assert (large <= sizes_with(scores, zero, 0.3).by_method["physical reach"]).all()


@pytest.mark.filterwarnings("error")
def test_of_what_has_no_volume_nothing_is_a_share():
    volumes = {"own": np.array([[0.0, 2.0]]), "ball": np.array([[0.0, 4.0]])}
    sizes = Sizes(("left_arm", "trunk"), (10,), volumes, 1)
    assert sizes.relative("own", "ball")[0] == pytest.approx([np.nan, 0.5, 0.5], nan_ok=True)
