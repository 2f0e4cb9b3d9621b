"""The rule by which a site moves factors: bounds, limits and mixtures by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.lab.calibration.site.mixing import (
    GROW,
    SHRINK,
    BaseTail,
    Ratios,
    moved,
    weights_of,
)
from hri_predict.zones.settings import LEVELS

BASE = np.array([0.9, 1.1, 1.6])
NOTHING = Ratios(np.zeros(0), np.zeros(0), 0.0)


def site(values_of_parts, weights=None):
    """Ratios of parts with these values each."""
    values = np.concatenate([np.asarray(v, float) for v in values_of_parts])
    unit = np.repeat(np.arange(len(values_of_parts)), [len(v) for v in values_of_parts])
    return Ratios.of(values, unit, np.ones(len(values_of_parts)) if weights is None else weights)


def like_the_base(parts, times=1.0, windows=2000):
    """Parts whose ratios are distributed as the base's, or so many times larger."""
    tail = BaseTail(BASE)
    shares = (np.arange(windows) + 0.5) / windows
    return site([[times * tail.ratio(s) for s in shares]] * parts)


def test_a_site_that_shows_nothing_changes_nothing():
    assert np.array_equal(moved(BASE, NOTHING), BASE)
    unknown = np.full(3, np.inf)
    assert np.array_equal(moved(unknown, NOTHING), unknown)


def test_the_tail_goes_through_the_factors_and_back():
    tail = BaseTail(BASE)
    for level, factor in zip(LEVELS, BASE, strict=True):
        assert tail.above(factor) == pytest.approx(1 - level, rel=1e-4)  # steps of 1e-6 in the log
        assert tail.ratio(1 - level) == pytest.approx(factor, rel=1e-4)
    assert tail.ratio(0.0) == np.inf
    shares = [tail.above(r) for r in np.geomspace(0.01, 100, 50)]
    assert shares == sorted(shares, reverse=True)


def test_equal_factors_are_a_step():
    flat = BaseTail(np.ones(3))
    assert flat.above(1.001) < 1e-5
    assert flat.above(0.999) > 0.9


def test_few_parts_change_little_and_many_outweigh_the_base():
    twice = [moved(BASE, like_the_base(n, 2.0))[-1] / BASE[-1] for n in (1, 4, 16, 400)]
    half = [moved(BASE, like_the_base(n, 0.5))[-1] / BASE[-1] for n in (1, 4, 16, 400)]
    assert twice == sorted(twice)
    assert half == sorted(half, reverse=True)
    assert 1.0 < twice[0] < 1.25
    assert 0.97 < half[0] <= 1.0
    assert 1.8 < twice[-1] < 2.2
    assert 0.5 < half[-1] < 0.7
    for up, down in zip(twice[:-1], half[:-1], strict=True):
        assert np.log(up) > -np.log(down)  # what grows grows faster


def test_the_mixture_by_hand():
    # 15 parts err by 3 in every hundredth window, by 0.1 otherwise. Of the mixture with the base
    # as 15, 1 % may be above: 30 x 0.01, less half of the site's 0.15: 0.225, of which the site
    # takes 0.15 below 3. So the base may have 0.075 / 15 above.
    parts = site([[3.0] + [0.1] * 99] * 15)
    found = moved(BASE, parts)
    assert GROW == 15
    assert found[-1] == pytest.approx(BaseTail(BASE).ratio(0.075 / 15), rel=1e-6)


def test_what_shrinks_stays_at_least_the_sites_own_quantile():
    parts = site([[0.8]] * 200)
    assert SHRINK / (200 + SHRINK) > 0.1  # of the mixture more than a tenth is the base's
    for own in (0.2, 0.8):
        assert (moved(BASE, site([[own]] * 2000)) >= own).all()
    assert moved(BASE, parts)[0] >= 0.8


def test_where_the_base_knows_nothing_the_site_alone_counts():
    unknown = np.full(3, np.inf)
    assert moved(unknown, site([[0.5]] * 3)).tolist() == unknown.tolist()
    assert moved(unknown, site([[0.5]] * 4)).tolist() == [0.5] * 3


def test_a_part_that_shows_little_weighs_little():
    assert weights_of([0, 8, 80, 5000]).tolist() == [0, 0.1, 1, 1]
    # 15.1 x 0.01 - 0.0005 may be above at 99 %; below 3 the part takes 0.1, the base 0.0505
    little = moved(BASE, site([[3.0]], np.array([0.1])))
    assert little[-1] == pytest.approx(BaseTail(BASE).ratio(0.0505 / GROW), rel=1e-6)
    assert moved(BASE, site([[3.0]]))[-1] == pytest.approx(3.0)  # and counted in full


def test_parts_weigh_the_same_whatever_their_lengths():
    long, short = site([[2.0] * 500, [0.5]]), site([[2.0], [0.5]])
    assert moved(BASE, long) == pytest.approx(moved(BASE, short), rel=1e-9)


def test_unknown_ratios_do_not_count():
    assert np.array_equal(moved(BASE, site([[np.nan, np.inf]])), BASE)


factors = st.lists(st.floats(0.05, 20.0), min_size=3, max_size=3).map(sorted)
parts = st.lists(st.lists(st.floats(0.01, 50.0), min_size=1, max_size=20), min_size=1, max_size=12)


@given(base=factors, values=parts)
def test_moved_factors_rise_with_the_level_and_are_bounded_by_what_is_known(base, values):
    found = moved(np.array(base), site(values))
    assert (np.diff(found) >= 0).all()
    assert (found > 0).all()
    low = min(min(map(min, values)), base[0])
    assert found[0] >= 0.999 * low  # steps of 1e-6 in the logarithm
    again = moved(np.array(base), site(values[::-1]))
    assert found == pytest.approx(again, rel=1e-9)


@given(base=factors, values=parts, more=st.floats(1.01, 5.0))
def test_a_site_that_errs_more_never_gets_smaller_zones(base, values, more):
    worse = [[more * v for v in part] for part in values]
    assert (
        moved(np.array(base), site(worse)) >= moved(np.array(base), site(values)) * (1 - 1e-9)
    ).all()
