"""Parts of a site's recordings: cut by time, bounded, in order."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.lab.calibration.presence import Presence
from hri_predict.lab.calibration.site import parts
from hri_predict.lab.calibration.site.parts import (
    STRETCH_S,
    STRETCHES,
    _chosen,
    _stretches,
    score_parts,
)
from hri_predict.predictors.baselines import ZeroVelocity, ZeroVelocitySettings
from hri_predict.zones.calibration import load_calibration, shipped_calibration
from hri_predict.zones.scale_shape import KNOTS, ScaleShape

COUNT = len(JOINTS)


def presence(start_s, seconds, rate_hz=30.0):
    stamps = np.round((start_s + np.arange(round(seconds * rate_hz)) / rate_hz) * 1e9)
    shape = (len(stamps), COUNT)
    return Presence(stamps.astype(np.int64), np.zeros((*shape, 3)), np.ones(shape, bool), rate_hz)


def test_a_stay_is_cut_into_parts_of_ten_minutes_and_stretches():
    found = _stretches([presence(100.0, 1300.0)], round(100e9))
    assert sorted(found) == [0, 1, 2]
    assert [len(found[k]) for k in (0, 1, 2)] == [60, 60, 10]
    lengths = [(s.stamps_ns[-1] - s.stamps_ns[0]) * 1e-9 for s in found[0]]
    assert max(lengths) < STRETCH_S
    assert sum(len(s.stamps_ns) for each in found.values() for s in each) == 39_000  # none is lost


def test_people_of_one_time_are_one_part():
    found = _stretches([presence(0.0, 8.0), presence(2.0, 6.0), presence(650.0, 5.0)], 0)
    assert {part: len(s) for part, s in found.items()} == {0: 2, 1: 1}


def test_stretches_are_spread_over_the_part_and_bounded():
    found = _stretches([presence(0.0, 600.0)], 0)[0]
    chosen = _chosen(found)
    assert len(chosen) == STRETCHES
    starts = [s.stamps_ns[0] * 1e-9 for s in chosen]
    assert starts == pytest.approx(np.arange(STRETCHES) * 50.0, abs=1 / 30)
    assert _chosen([presence(0.0, 0.4)]) == []
    few = found[:3]
    assert _chosen(few) == few


def test_the_stretch_divides_the_part():
    assert parts.PART_S % STRETCH_S == 0


def test_the_scale_of_a_part_is_shaped_as_in_the_node(make_recording):
    base = replace(load_calibration(shipped_calibration("zero_velocity")), shape=None)
    size = np.broadcast_to(np.geomspace(0.01, 1.0, KNOTS), (3, base.steps, KNOTS)).copy()
    body = 0.3 * np.random.default_rng(3).normal(size=(COUNT, 3))
    walks = body + np.arange(80)[:, None, None] * np.array([0.02, 0.0, 0.0])
    settings = ZeroVelocitySettings(name="zero_velocity", horizon_s=base.steps / base.rate_hz)
    predictor = ZeroVelocity(settings)
    recording = make_recording(walks)
    (plain,) = score_parts(predictor=predictor, base=base, files=[recording])
    doubled = replace(base, shape=ScaleShape(size, np.full_like(size, 2.0)))
    (shaped,) = score_parts(predictor=predictor, base=doubled, files=[recording])
    np.testing.assert_allclose(shaped.scale_m, 2 * plain.scale_m, rtol=1e-6)
    np.testing.assert_array_equal(shaped.error_m, plain.error_m)
