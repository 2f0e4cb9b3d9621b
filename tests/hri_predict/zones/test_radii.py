"""Radii: a factor on the learned scale, or a guaranteed one; what is not known is unbounded."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.zones.calibration import UsedRecording, needed, plain
from hri_predict.zones.learned_scale import Evidence
from hri_predict.zones.radii import Radii
from hri_predict.zones.scale_shape import KNOTS, ScaleShape
from hri_predict.zones.settings import CoverageSettings
from tests.hri_predict.zones.conftest import scale_of

COUNT = len(JOINTS)
WRIST, HEAD = JOINTS.index("l_wrist"), JOINTS.index("head")


def evidence(people=1, steps=25, error=0.0, residual=0.0):
    """People who stay, whose past forecasts were wrong by so much."""
    return Evidence(
        history=np.zeros((people, 15, COUNT, 3)),
        observed=np.ones((people, 15, COUNT), bool),
        forecast=np.zeros((people, steps, COUNT, 3)),
        error_m=np.full((people, 2, COUNT), error),
        residual_m=np.full(people, residual),
    )


def of(radii, *speeds, steps=25, **known):
    return radii.of(np.array(speeds), evidence(len(speeds), steps, **known))


def test_radii_are_of_the_level_the_question_the_speed_and_the_step(make_calibration):
    made = make_calibration(steps=4)
    g = made.joints.index("wrist")

    def radius(speed, error=0.0, **coverage):
        radii = Radii(made, CoverageSettings(**coverage), CANONICAL, 4)
        return of(radii, speed, steps=4, error=error)[0, 2, WRIST]

    # of level 0, the lowest speed and the third step; the scale is 1 m
    assert radius(0.0, level=0.9, of="joint") == pytest.approx(0.03)
    assert radius(0.0, level=0.99, of="joint") == pytest.approx(0.03 + 0.4)
    assert radius(0.0, level=0.9, of="body") == pytest.approx(0.03 + 1)
    assert radius(0.5, level=0.9, of="joint") == pytest.approx(0.03 + 0.04)
    assert radius(1.0, level=0.9, of="joint") == pytest.approx(0.03 + 0.08)
    # guaranteed ones are metres, whatever the past errors
    held = {"level": 0.9, "of": "joint", "basis": "guaranteed"}
    for error in (0.0, 1.0, np.nan):
        for speed, more in ((0.0, 0.0), (0.5, 0.04), (1.0, 0.08)):
            expected = 0.03 + 0.001 * g + 2 + more
            assert radius(speed, error, **held) == pytest.approx(expected)


def test_no_estimated_radius_is_above_its_limit_and_without_one_nothing_is_cut(make_calibration):
    made = make_calibration(steps=4)
    shape = made.guaranteed["joint"].shape
    table = np.broadcast_to(0.25 + 0.1 * np.arange(3)[:, None, None], shape).copy()
    table[:, :, made.joints.index("head")] = np.inf
    limited = replace(made, limits={"joint": table, "body": table + 1})

    def radius(calibration, speed, joint, **how):
        coverage = CoverageSettings(level=0.99, of="joint", **how)
        return of(Radii(calibration, coverage, CANONICAL, 4), speed, steps=4)[0, 2, joint]

    for speed, limit in ((0.0, 0.25), (0.5, 0.35), (1.0, 0.45), (np.nan, 0.45)):
        assert radius(limited, speed, WRIST) == pytest.approx(limit)
        assert radius(limited, speed, HEAD) == radius(made, speed, HEAD) > limit
        for_sure = {"basis": "guaranteed"}
        assert radius(limited, speed, WRIST, **for_sure) == radius(made, speed, WRIST, **for_sure)


def test_the_scale_is_shaped_before_it_is_multiplied_and_limited(make_calibration):
    made = make_calibration(steps=4)
    size = np.broadcast_to(np.geomspace(0.1, 10.0, KNOTS), (3, 4, KNOTS)).copy()
    factor = np.broadcast_to(np.array([2.0, 0.5, 4.0])[:, None, None], size.shape).copy()
    shaped = replace(made, shape=ScaleShape(size, factor))

    def radius(calibration, speed):
        coverage = CoverageSettings(level=0.99, of="joint")
        return of(Radii(calibration, coverage, CANONICAL, 4), speed, steps=4)[0, 2, WRIST]

    for speed, times in ((0.0, 2.0), (0.5, 0.5), (1.0, 4.0)):
        assert radius(shaped, speed) == pytest.approx(times * radius(made, speed))
    assert radius(shaped, np.nan) == pytest.approx(4.0 * radius(made, 1.0))  # the largest of all
    table = np.full(made.guaranteed["joint"].shape, 0.3)
    limited = replace(shaped, limits={"joint": table, "body": table})
    assert radius(limited, 1.0) == pytest.approx(0.3)
    assert radius(limited, 0.5) == radius(shaped, 0.5) < 0.3


def test_the_factor_multiplies_the_scale_of_each_joint(make_calibration):
    made = make_calibration(scale=scale_of({"wrist": np.log(3.0)}))
    found = of(Radii(made, CoverageSettings(), CANONICAL, 25), 0.0)[0]
    assert found[:, WRIST] == pytest.approx(3.0 * found[:, HEAD])
    assert np.array_equal(found[:, WRIST], found[:, JOINTS.index("r_wrist")])
    assert (plain("l_wrist"), plain("r_wrist"), plain("head")) == ("wrist", "wrist", "head")


def test_people_are_told_apart(make_calibration):
    radii = Radii(make_calibration(), CoverageSettings(), CANONICAL, 25)
    found = of(radii, 0.0, 0.5)
    assert found.shape == (2, 25, COUNT)
    assert (found[1] > found[0]).all()
    assert np.array_equal(found[0], of(radii, 0.0)[0])  # alone as beside others
    assert of(radii).shape == (0, 25, COUNT)


@pytest.mark.parametrize("basis", ["estimated", "guaranteed"])
@pytest.mark.parametrize("widest", range(3))
def test_who_has_no_known_speed_has_the_largest_radii_of_all_speeds(
    make_calibration, widest, basis
):
    made = make_calibration()
    tables = {"estimated": dict(made.estimated), "guaranteed": dict(made.guaranteed)}
    for table in tables[basis].values():
        table[:, widest] += 1.0  # of this speed class
    radii = Radii(replace(made, **tables), CoverageSettings(basis=basis), CANONICAL, 25)
    unknown, *known = of(radii, np.nan, 0.0, 0.5, 1.0)
    assert unknown == pytest.approx(np.max(known, axis=0))


@given(st.lists(st.floats(0.001, 100), min_size=2, max_size=12), st.floats(-3, 3))
def test_a_zone_never_shrinks_with_the_horizon(make_calibration, factors, lead):
    row = np.array(factors)
    made = make_calibration(steps=len(row), scale=scale_of(lead=lead))
    made = replace(made, estimated={o: t * 0 + row for o, t in made.estimated.items()})
    found = of(Radii(made, CoverageSettings(), CANONICAL, len(row)), 0.0, steps=len(row))
    assert (np.diff(found, axis=1) >= 0).all()


def test_a_speed_that_was_not_calibrated_is_unbounded(make_calibration):
    made = make_calibration()
    for table in made.estimated.values():
        table[:, 2] = np.inf  # nobody was brisk
    radii = Radii(made, CoverageSettings(), CANONICAL, 25)
    slow, brisk, unknown = of(radii, 0.5, 1.0, np.nan)
    assert np.isfinite(slow).all()
    assert np.isinf(brisk).all()
    assert np.isinf(unknown).all()


@pytest.mark.parametrize("basis", ["estimated", "guaranteed"])
def test_joints_that_were_not_calibrated_are_unbounded(make_calibration, basis):
    made = make_calibration(joints=("shoulder", "elbow", "wrist"))
    found = of(Radii(made, CoverageSettings(basis=basis), CANONICAL, 25), 0.0)[0]
    known = {JOINTS[j] for j in np.flatnonzero(np.isfinite(found).all(0))}
    assert known == {s + n for s in ("l_", "r_") for n in ("shoulder", "elbow", "wrist")}
    assert np.isinf(found[:, HEAD]).all()


def test_steps_beyond_the_calibrated_ones_are_unbounded(make_calibration):
    radii = Radii(make_calibration(steps=10), CoverageSettings(), CANONICAL, 25)
    found = of(radii, 1.0)[0]
    assert np.isfinite(found[:10]).all()
    assert np.isinf(found[10:]).all()
    assert radii.steps == 10
    fewer = Radii(make_calibration(steps=25), CoverageSettings(), CANONICAL, 10)
    assert of(fewer, 1.0, steps=10).shape == (1, 10, COUNT)


# -- guarantees -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("level", "wanted"), [(0.9, 9), (0.95, 19), (0.99, 99)])
def test_a_guarantee_takes_so_many_recordings(make_calibration, level, wanted):
    # the rank ceil((n + 1) level) is at most n from n = 9, 19, 99 on: 10 x 0.9 = 9, but 9 x 0.9 > 8
    assert needed(level) == wanted
    coverage = CoverageSettings(level=level, basis="guaranteed")
    Radii(make_calibration(wanted), coverage, CANONICAL, 25)
    with pytest.raises(ConfigError) as error:
        Radii(make_calibration(wanted - 3), coverage, CANONICAL, 25)
    with pytest.raises(ConfigError, match="with 1 more"):
        Radii(make_calibration(wanted - 1), coverage, CANONICAL, 25)
    line = str(error.value)
    assert "\n" not in line
    assert f"{level:g} is not guaranteed for zero_velocity" in line
    assert f"{wanted - 3} recordings show people still, {wanted} are needed" in line
    assert "with 3 more" in line
    Radii(make_calibration(1), CoverageSettings(level=level), CANONICAL, 25)  # estimated: never


def test_recordings_count_for_the_speeds_that_they_show(make_calibration):
    still_only = (1, 0, 0)
    recordings = tuple(UsedRecording(name=f"walking_{n}", windows=still_only) for n in range(20))
    made = replace(make_calibration(), recordings=recordings)
    assert [made.independent(c) for c in range(3)] == [20, 0, 0]
    for c in range(3):
        one = UsedRecording(name="walking_0", windows=tuple(int(c == k) for k in range(3)))
        only = replace(made, recordings=(one,))
        assert [only.independent(k) for k in range(3)] == [c == k for k in range(3)]
    with pytest.raises(ConfigError, match=r"0 recordings show people slow, 19 are needed.*19 more"):
        Radii(made, CoverageSettings(level=0.95, basis="guaranteed"), CANONICAL, 25)


def test_a_level_that_is_not_calibrated_is_refused():
    with pytest.raises(ValueError, match=r"level must be one of 0\.9, 0\.95, 0\.99"):
        CoverageSettings(level=0.8)
