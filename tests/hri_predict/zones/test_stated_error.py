"""Zones hold a person wherever the source's stated error lets the person be."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.zones.body_zones import _grown
from tests.hri_predict.lost_person import lost_person
from tests.hri_predict.zones import test_toward
from tests.hri_predict.zones.test_body_zones import NOW_NS, body, builder

ROUNDING_M = 1e-12  # of a sum and a difference of tens of metres: 1e-14 each
ERROR_M = st.floats(0.0, 20.0)
UNCALIBRATED, CALIBRATED = builder(), test_toward.builder()


def zones(calibrated: bool, errors_m: list[float] | None) -> Any:
    """Zones of two people who walk and of one who is lost."""
    snapshot, forecast = test_toward.walking(3, people=2)
    lost = lost_person(7, body(3.0), NOW_NS - 10**9)
    if errors_m is not None:
        *here, gone = errors_m
        snapshot = replace(snapshot, errors_m=np.array(here))
        lost = replace(lost, error_m=gone)
    snapshot = replace(snapshot, lost=(lost,))
    if calibrated:
        return CALIBRATED.build(snapshot, forecast, trust=test_toward.trust_in(2))
    return UNCALIBRATED.build(snapshot, None)


@pytest.mark.parametrize("calibrated", [False, True])
@given(first_m=ERROR_M, second_m=ERROR_M, lost_m=ERROR_M)
def test_zones_grow_by_the_error_of_their_person_at_every_time(
    calibrated, first_m, second_m, lost_m
):
    errors_m = [first_m, second_m, lost_m]
    exact, found = zones(calibrated, None), zones(calibrated, errors_m)
    for of in (lambda z: z.zones.capsules, lambda z: z.paths):
        before, after = of(exact), of(found)
        assert np.array_equal(before.a, after.a)
        assert np.array_equal(before.b, after.b)
        assert (after.radius >= before.radius).all()
        grown = (after.radius - before.radius).reshape(3, -1)
        np.testing.assert_allclose(grown - np.array(errors_m)[:, None], 0.0, atol=ROUNDING_M)
    if calibrated:
        grown = found.toward.extra - exact.toward.extra
        np.testing.assert_allclose(grown - [[first_m], [second_m]], 0.0, atol=ROUNDING_M)


@pytest.mark.parametrize("calibrated", [False, True])
def test_no_error_is_an_error_of_zero_to_the_last_bit(calibrated):
    exact, stated = zones(calibrated, None), zones(calibrated, [0.0, 0.0, 0.0])
    for part in ("a", "b", "radius"):
        one, other = getattr(exact.zones.capsules, part), getattr(stated.zones.capsules, part)
        assert one.tobytes() == other.tobytes()
    if calibrated:
        assert exact.toward.extra.tobytes() == stated.toward.extra.tobytes()


def test_without_errors_no_memory_is_taken():
    """A tick of a source without errors, which most are, costs what it did before."""
    found = zones(calibrated=False, errors_m=None).zones.capsules
    assert _grown(found, np.zeros(3)) is found
    radius = found.radius.copy()
    assert _grown(found, np.array([0.0, 0.1, 0.0])).radius is not found.radius
    np.testing.assert_array_equal(found.radius, radius)
