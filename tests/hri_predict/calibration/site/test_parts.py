"""Parts of a site's recordings: cut by time, bounded, in order."""

import numpy as np
import pytest

from hri_predict.calibration.presence import Presence
from hri_predict.calibration.site import parts
from hri_predict.calibration.site.parts import STRETCH_S, STRETCHES, _chosen, _stretches
from hri_predict.skeleton import JOINTS

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
