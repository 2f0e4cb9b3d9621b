"""Margins by region: some parts of a body count as thicker than they are."""

import numpy as np
import pytest
from pydantic import ValidationError

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Region
from hri_predict.base.skeleton import CANONICAL
from hri_predict.risk.settings import RiskSettings
from tests.hri_predict.lost_person import lost_person
from tests.hri_predict.risk.engine_cell import SETTINGS, Cell, body

REGIONS = [segment.region for segment in CANONICAL.segments]
ALL = dict.fromkeys(REGIONS, 0.1)
OVER_TIME_AND_ISO = pytest.mark.parametrize("mode", ["iso", "predictive", "reactive"])


def cell(mode: str, view: Region | None = None, **changes) -> Cell:
    return Cell(SETTINGS.model_copy(update={"mode": mode, **changes}), view=view)


@OVER_TIME_AND_ISO
def test_a_margin_of_every_region_counts_as_c_does(mode):
    thick, intruding = cell(mode, region_margins_m=ALL), cell(mode, intrusion_m=0.1)
    for x in np.arange(3.5, 0.8, -0.03):
        one, other = thick.step(x), intruding.step(x)
        assert (one.level, one.reason) == (other.level, other.reason)
        assert one.speed_limit_m_s == pytest.approx(other.speed_limit_m_s, abs=1e-9)


@OVER_TIME_AND_ISO
def test_outside_of_the_view_anybody_may_come_with_the_largest(mode):
    view = Region(polygon=[[-2, -2], [2, -2], [2, 2], [-2, 2]], z_max=4.0)
    thick = cell(mode, view, region_margins_m={"hand": 0.02, "head": 0.1})
    intruding = cell(mode, view, intrusion_m=0.1)
    cells = (thick, intruding, cell(mode, view))
    limits = [each.settle().speed_limit_m_s or 0.0 for each in cells]
    assert limits[0] == pytest.approx(limits[1], abs=1e-9)
    assert limits[0] < limits[2]


def test_zones_of_that_region_alone_are_larger():
    plain, thick = cell("predictive"), cell("predictive", region_margins_m={"hand": 0.07})
    for each in (plain, thick):
        each.step(2.0)
    more = thick.assessment.zones.capsules.radius - plain.assessment.zones.capsules.radius
    expected = [0.07 * (region == "hand") for region in REGIONS]
    np.testing.assert_allclose(more, np.broadcast_to(expected, more.shape), atol=1e-12)


def test_a_lost_person_may_be_there_with_any_region():
    plain, thick = cell("predictive"), cell("predictive", region_margins_m={"hand": 0.07})
    gone = lost_person(
        7, body(1.5), 1_000_000_000, places=np.array([[1.5, 0.0, 0.3]]), places_ns=1_000_000_000
    )
    for each in (plain, thick):
        each.step(2.0, lost=(gone,))
    more = thick.assessment.zones.capsules.radius - plain.assessment.zones.capsules.radius
    np.testing.assert_allclose(more[1], 0.07, atol=1e-12)


def test_an_unknown_region_and_an_absurd_margin_are_refused():
    with pytest.raises(ConfigError, match="unknown body segment 'hands'; did you mean 'hand'"):
        cell("iso", region_margins_m={"hands": 0.1})
    for margin in (-0.01, 1.01, float("nan")):
        with pytest.raises(ValidationError):
            RiskSettings(region_margins_m={"hand": margin})


def test_a_door_must_be_farther_by_the_largest():
    def farthest_refused(**changes) -> float:
        for x in np.arange(5.5, 1.0, -0.02):
            door = Region(polygon=[[x, -0.5], [x + 1, -0.5], [x + 1, 0.5], [x, 0.5]])
            try:
                Cell(SETTINGS.model_copy(update=changes), doors={"people.exits.0": door})
            except ConfigError:
                return float(x)
        raise AssertionError("no door was refused")

    more = farthest_refused(region_margins_m={"hand": 0.2, "head": 0.5}) - farthest_refused()
    assert more == pytest.approx(0.5, abs=0.021)


def test_distances_that_need_only_grow_are_without_margins():
    """A thick hand would hide that a link comes nearer to the head."""
    plain, thick = cell("predictive"), cell("predictive", region_margins_m={"hand": 0.3})
    bodies = [each.engine._builder.build(each.snapshot(2.0), None) for each in (plain, thick)]
    np.testing.assert_allclose(bodies[1].captured.radius, bodies[0].captured.radius, atol=1e-12)
