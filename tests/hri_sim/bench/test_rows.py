"""Rows: their percentiles, and by which power a time grows; and the machine they stand for."""

import json

import numpy as np
import pytest

from hri_sim.bench import saved
from hri_sim.bench.rows import QUICK, Scope, exponent, measured


def test_percentiles_of_a_row():
    row = measured("a", "ms", list(range(101)), aim=60.0)
    assert (row.p50, row.p99, row.max, row.aim) == (50.0, 99.0, 100.0, 60.0)


def test_nothing_measured_is_said():
    row = measured("a", "ms", [])
    assert (row.p50, row.note) == (None, "nothing was measured")


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.0])
def test_the_power_of_a_growth(power):
    sizes = [1.0, 2.0, 4.0, 16.0]
    # logarithms and a fit of four points: some tens of roundings of 2e-16
    assert exponent(sizes, list(3.0 * np.power(sizes, power))) == pytest.approx(power, abs=1e-12)


def test_a_quick_scope_asks_no_more_than_the_whole():
    whole = Scope()
    assert QUICK.seconds < whole.seconds
    for name in ("batches", "people", "joint_maps", "horizons_s", "robots", "rates_hz"):
        assert set(getattr(QUICK, name)) <= set(getattr(whole, name)), name


def test_the_machine_is_stated():
    facts = saved.machine()
    assert facts["cores"] >= 1
    assert facts["processor"]
    assert facts["yardstick_us"] > 0
    assert facts["libraries"]["numpy"]
    assert json.loads(json.dumps(facts)) == facts
    assert facts["processor"] in saved.described(facts)


def test_a_busy_machine_is_told():
    assert saved.busy(0.5) == ""
    assert "load average 0.6, over 0.5" in saved.busy(0.6)
