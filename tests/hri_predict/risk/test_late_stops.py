"""A robot that was measured to stop later than its table states."""

import re

import pytest

from hri_predict.protocol.messages import Level
from tests.hri_predict.risk.engine_cell import SETTINGS, Cell


@pytest.mark.parametrize("radius_m", [None, 2.0])
def test_a_robot_that_stops_late_widens_its_circle_however_it_was_chosen(radius_m):
    fixed = SETTINGS.model_copy(update={"mode": "fixed", "fixed_radius_m": radius_m})
    cell = Cell(fixed)
    cell.turn = 0.0
    at_m = cell.engine._constants[0].fixed_radius_m + 0.35
    before, needed_m = cell.settle(at_m), cell.engine._constants[0].anywhere_m
    assert before.level is not Level.STOP
    cell.tracker.model.stretch = 4.0  # as if measured
    try:
        cell.engine._constants[0] = cell.engine._constants[0].revised()
        cell.engine._separation.revised(0)
        after = cell.settle(at_m)
        more_m = cell.engine._constants[0].anywhere_m - needed_m
    finally:
        cell.tracker.model.stretch = 1.0
    assert after.level is Level.STOP
    assert cell.engine._constants[0].fixed_radius_m == pytest.approx(at_m - 0.35 + more_m)
    assert more_m > 0.5
    away = re.compile(r"[\d.]+ m from the base's axis")  # the person did not move
    found = [away.search(advice.detail) for advice in (before, after)]
    assert len({each and each[0] for each in found}) == 1
    assert found[0] is not None
