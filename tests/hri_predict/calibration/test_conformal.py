"""From scores to radii: ranks by hand, and what they hold of recordings that were not used."""

import math

import numpy as np
import pytest

from hri_predict.calibration.conformal import (
    LEAST_RADIUS_M,
    _guaranteed,
    body_shape,
    calibrate,
    quantiles,
    rising,
)
from hri_predict.calibration.scores import HISTORY_STEPS, Presence, Scores
from hri_predict.errors import ConfigError
from hri_predict.risk.settings import LEVELS, CoverageSettings
from hri_predict.risk.zones.calibration import load_calibration, plain, save_text
from hri_predict.risk.zones.motion_class import CLASSES
from hri_predict.risk.zones.radii import Radii
from hri_predict.skeleton import CANONICAL, JOINTS

RATE_HZ = 25.0
COUNT = len(JOINTS)
WRIST = JOINTS.index("l_wrist")
BODY = np.random.default_rng(2).normal(size=(COUNT, 3))
GROUPS = tuple(dict.fromkeys(plain(name) for name in JOINTS))
GROUP = np.array([GROUPS.index(plain(name)) for name in JOINTS])


def scores(name, error, speed=1.0, residual=0.3):
    """Windows of one presence with these errors, (W, H, J) or what broadcasts to (12, 3, J)."""
    error = np.asarray(error, float)
    if error.ndim < 3:
        error = np.broadcast_to(error, (12, 3, COUNT)).copy()
    windows, steps = error.shape[:2]
    along = np.arange(HISTORY_STEPS)[:, None, None] / RATE_HZ * np.array([speed, 0, 0])
    origin = 40_000_000 * np.arange(windows)
    return Scores(
        name=name,
        action="walking",
        origin_ns=origin,
        history=np.broadcast_to(BODY + along, (windows, HISTORY_STEPS, COUNT, 3)),
        observed=np.ones((windows, HISTORY_STEPS, COUNT), bool),
        forecast=np.zeros((windows, steps, COUNT, 3)),
        error_m=error,
        speed_m_s=np.broadcast_to(np.asarray(speed, float), (windows,)),
        residual_m=np.broadcast_to(np.asarray(residual, float), (windows,)),
        truth=Presence(
            origin, np.zeros((windows, COUNT, 3)), np.ones((windows, COUNT), bool), 25.0
        ),
    )


def made(entries):
    return calibrate(
        scores=entries,
        predictor="own",
        settings={"rate_hz": RATE_HZ},
        weights=None,
        rate_hz=RATE_HZ,
        skeleton=CANONICAL,
    )


def radii(calibration, entry, **coverage):
    """(W, H, J) of the windows of an entry."""
    of = Radii(calibration, CoverageSettings(**coverage), CANONICAL, entry.error_m.shape[1])
    return of.of(entry.speed_m_s, entry.residual_m)


# -- ranks ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n", "ranks"),
    [
        (1, (1, 1, 1)),
        (9, (9, 9, 9)),  # 10 x 0.9 = 9; 10 x 0.95 and 10 x 0.99 would be the tenth
        (19, (18, 19, 19)),  # 20 x 0.9, 20 x 0.95
        (99, (90, 95, 99)),  # 100 x 0.9, 100 x 0.95, 100 x 0.99
        (100, (91, 96, 100)),  # 90.9, 95.95 and 99.99, each rounded up
        (1000, (901, 951, 991)),  # 900.9, 950.95, 990.99
    ],
)
def test_quantiles_by_hand(n, ranks):
    values = np.random.default_rng(n).permutation(np.arange(1.0, n + 1))
    assert quantiles(values).tolist() == list(ranks)
    unknown = np.concatenate([values, [np.nan, np.nan]])
    assert quantiles(unknown).tolist() == list(ranks)


def test_of_nothing_nothing_is_known():
    assert quantiles(np.array([])).tolist() == [np.inf] * 3
    assert quantiles(np.array([np.nan])).tolist() == [np.inf] * 3


def test_a_zone_never_shrinks():
    assert rising(np.array([[1.0, 3.0, 2.0], [2.0, 1.0, np.inf]])).tolist() == [
        [1, 3, 3],
        [2, 2, np.inf],
    ]


# -- estimated ------------------------------------------------------------------------------------


def test_recordings_that_are_alike_need_no_factor():
    entries = [scores(f"r{n}", 0.1) for n in range(6)]
    found = made(entries)
    for level in LEVELS:
        for of in ("joint", "body"):
            assert radii(found, entries[0], level=level, of=of) == pytest.approx(0.1)
    still = [scores(f"r{n}", 0.001) for n in range(6)]
    assert radii(made(still), still[0], of="joint") == pytest.approx(LEAST_RADIUS_M)


@pytest.mark.parametrize(
    ("alike", "wanted"),
    [
        # 1 of 6 windows is at 1 m: pooled, each level's radius is 1 m. Left out, the others give
        # 0.1 m and it is out by a factor of 10; and a sixth of the recordings is more than 10 %.
        (5, (10.0, 10.0, 10.0)),
        # 1 of 25 is 4 %: the pooled radii are 0.1 m at 90 and 95 % and 1 m at 99 %. 24 of 25
        # recordings, 96 %, hold with the factor 1, and 99 % only with the 10 of the odd one.
        (24, (0.1, 0.1, 10.0)),
    ],
)
def test_the_factor_of_an_odd_recording_by_hand(alike, wanted):
    entries = [scores(f"r{n}", 0.1) for n in range(alike)] + [scores("odd", 1.0)]
    found = made(entries)
    for level, radius in zip(LEVELS, wanted, strict=True):
        for of in ("joint", "body"):
            assert radii(found, entries[0], level=level, of=of) == pytest.approx(radius)


def test_recordings_weigh_the_same_whatever_their_length():
    # The odd one has so few windows that pooled it is out of sight at 95 %.
    short = scores("odd", np.full((2, 3, COUNT), 1.0))
    entries = [scores(f"r{n}", 0.1) for n in range(5)] + [short]
    # 2 of 62 windows are 3.2 %: 0.1 m at 90 and 95 %; a sixth of the recordings is out by 10
    for level, radius in zip(LEVELS, (1.0, 1.0, 10.0), strict=True):
        assert radii(made(entries), entries[0], level=level) == pytest.approx(radius)


@pytest.mark.parametrize("count", [4, 5])
def test_as_few_as_are_accepted_are_left_out_in_turn(count):
    entries = [scores(f"r{n}", 0.1) for n in range(count - 1)] + [scores("odd", 1.0)]
    assert radii(made(entries), entries[0]) == pytest.approx(10.0)


def test_no_factor_makes_radii_smaller():
    rng = np.random.default_rng(0)
    entries = [random_scores(rng, f"r{n}", 0.5) for n in range(12)]
    found = made(entries)
    error = np.concatenate([e.error_m for e in entries])
    residual = np.concatenate([e.residual_m for e in entries])
    kind = Radii(found, CoverageSettings(), CANONICAL, 3).classes(np.ones(len(residual)), residual)
    for c in np.unique(kind):
        for g in range(len(GROUPS)):
            pooled = quantiles(error[kind == c][:, 0, np.equal(GROUP, g)].ravel())
            assert (found.estimated["joint"][:, c, g, 0] >= pooled - 1e-12).all()


def test_a_body_is_held_by_its_worst_joint():
    # All joints err by 0.1 in turn by a factor 3: each alone is held by the 90 % quantile of its
    # own, the body needs a radius that holds whichever is out.
    error = np.full((21, 3, COUNT), 0.1)
    error[np.arange(21), :, np.arange(21)] = 0.3  # one window in 21 for each joint
    entries = [scores(f"r{n}", error) for n in range(6)]
    found = made(entries)
    assert radii(found, entries[0], level=0.9, of="joint") == pytest.approx(0.1)
    assert radii(found, entries[0], level=0.9, of="body") == pytest.approx(0.3)


def test_a_class_that_few_recordings_show_is_not_calibrated():
    entries = [scores(f"r{n}", 0.1) for n in range(6)]
    entries += [scores(f"r{n}", 0.1, speed=0.1) for n in range(3)]
    found = made(entries)
    finite = np.isfinite(found.estimated["body"]).all((0, 2, 3))
    assert {CLASSES[c] for c in np.flatnonzero(finite)} == {"brisk, surprising"}
    assert np.isinf(radii(found, entries[-1])).all()
    windows = {r.name: r.windows for r in found.recordings}
    # still, slow, brisk, each calm, usual, surprising, new; who is all alike is at both thresholds
    assert windows["r0"] == (0, 0, 12, 0, *(0, 0, 0, 0), 0, 0, 12, 0)
    assert windows["r5"] == (0, 0, 0, 0, *(0, 0, 0, 0), 0, 0, 12, 0)


def test_grades_are_terciles_of_each_speed():
    residual = np.linspace(0, 0.9, 91)
    error = np.full((91, 3, COUNT), 0.1)
    entries = [scores(f"r{n}", error, residual=residual) for n in range(4)]
    entries += [scores(f"r{n}", error, speed=0.0, residual=residual / 10) for n in range(4)]
    entries += [scores(f"r{n}", error, speed=0.5, residual=residual / 2) for n in range(4)]
    wanted = np.array([[0.03, 0.06], [0.15, 0.3], [0.3, 0.6]])
    assert made(entries).thresholds_m == pytest.approx(wanted)


def test_where_no_residual_is_known_everybody_is_new(tmp_path):
    found = made([scores(f"r{n}", 0.1, residual=np.nan) for n in range(6)])
    assert {r.windows for r in found.recordings} == {(0,) * 11 + (12,)}
    finite = np.isfinite(found.estimated["joint"]).all((0, 2, 3))
    assert [CLASSES[c] for c in np.flatnonzero(finite)] == ["brisk, new"]
    assert not found.thresholds_m.any()
    path = tmp_path / "own.calibration.json"
    path.write_text(save_text(found), encoding="utf-8")  # there is no infinity in JSON
    assert not load_calibration(path).thresholds_m.any()


def test_who_is_new_has_radii_of_their_own_and_no_part_in_the_others():
    # the first 4 of 12 windows have no forecast old enough; they are out by 0.5 m, the rest by 0.1
    residual = np.where(np.arange(12) < 4, np.nan, 0.3)
    error = np.where(np.isnan(residual), 0.5, 0.1)[:, None, None] * np.ones((12, 3, COUNT))
    entries = [scores(f"r{n}", error, residual=residual) for n in range(6)]
    found = made(entries)
    assert {r.windows for r in found.recordings} == {(0,) * 10 + (8, 4)}
    for of in ("joint", "body"):
        own = radii(found, entries[0], of=of)
        assert own[:4] == pytest.approx(0.5)
        assert own[4:] == pytest.approx(0.1)
    assert found.thresholds_m[2] == pytest.approx([0.3, 0.3])  # of the known ones alone


def test_a_joint_that_nobody_saw_is_not_calibrated_and_does_not_spoil_the_rest():
    error = np.full((12, 3, COUNT), 0.1)
    error[:, :, JOINTS.index("head")] = np.nan
    entries = _all_speeds([scores(f"r{n}", error) for n in range(9)])
    for basis, of in (("estimated", "joint"), ("estimated", "body"), ("guaranteed", "joint")):
        found = radii(made(entries), entries[0], level=0.9, basis=basis, of=of)
        known = np.isfinite(found).all((0, 1))
        assert [JOINTS[j] for j in np.flatnonzero(~known)] == ["head"]
        assert found[:, :, known] == pytest.approx(0.1)


def _all_speeds(entries):
    return [scores(e.name, e.error_m, speed=speed) for speed in (1.0, 0.5, 0.1) for e in entries]


# -- coverage of recordings that were not used ----------------------------------------------------


def random_scores(rng, name, spread, windows=60, steps=3):
    """Errors that grow with the step, of a scale that is the recording's own (log-normal)."""
    scale = 0.1 * math.exp(rng.normal(0, spread))
    error = (
        scale * np.abs(rng.normal(size=(windows, steps, COUNT))) * np.arange(1, steps + 1)[:, None]
    )
    return scores(name, error, residual=rng.random(windows))


@pytest.mark.long
def test_estimated_radii_hold_new_recordings_nearly_as_often_as_they_say():
    shares: dict[tuple[float, str], list[float]] = {}
    for seed in range(8):  # of one calibration the body's share at 0.9 has an SD of 0.025
        rng = np.random.default_rng(seed)
        found = made([random_scores(rng, f"r{n}", 0.3, steps=1) for n in range(40)])
        new = [random_scores(rng, f"new{n}", 0.3, steps=1) for n in range(60)]
        for level in LEVELS:
            for of in ("joint", "body"):
                inside = [e.error_m <= radii(found, e, level=level, of=of) for e in new]
                held = [(i.all(2) if of == "body" else i).mean() for i in inside]
                shares.setdefault((level, of), []).append(float(np.mean(held)))
    for (level, of), found_shares in shares.items():
        share = np.mean(found_shares)
        assert share >= level - 0.02, f"{of} {level}: {share:.4f}"
        assert share < 1.0


def test_guaranteed_radii_hold_nine_of_ten_new_recordings_wholly():
    # With 9 recordings the tenth is the worst of the ten by a chance of one in ten, exactly. Of one
    # calibration the share is Beta(9, 1), SD 0.09: the mean of 400 is within 0.9 +- 3 x 0.0047.
    rng = np.random.default_rng(8)
    joint, body = [], []
    for _ in range(400):
        largest = np.exp(rng.normal(0, 1, (49, 1, 1))) * rng.random((49, 4, 2 * COUNT))
        error = largest.reshape(49, 4, 2, COUNT)  # 49 recordings of 4 windows and 2 steps
        unit = np.repeat(np.arange(9), 4)
        tables = _guaranteed(
            error=error[:9].reshape(36, 2, COUNT),
            fast=np.ones(36, bool),
            unit=unit,
            group=GROUP,
            joints=len(GROUPS),
            rate_hz=RATE_HZ,
        )
        new = error[9:].max(1)  # (40, 2, J)
        one = tables["joint"][0, 1][GROUP].T  # (2, J)
        wrist = np.equal(GROUP, GROUPS.index("wrist"))
        joint.append((new[:, 0, wrist] <= one[0, wrist]).all(1).mean())
        whole = tables["body"][0, 1][GROUP].T
        body.append((new[:, 0] <= whole[0]).all(1).mean())
    assert np.mean(joint) == pytest.approx(0.9, abs=0.015)
    assert np.mean(body) == pytest.approx(0.9, abs=0.015)


# -- guaranteed -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("count", "supported"), [(8, 0), (9, 1), (18, 1), (19, 2), (98, 2), (99, 3)]
)
def test_a_level_is_guaranteed_from_so_many_recordings_on(count, supported):
    # recording n's largest error is (n + 1) / 100: 90 % of 9 is the ninth rank, 0.09 m
    error = np.full((2 * count, 2, COUNT), 0.001)
    error[::2] = np.arange(1, count + 1)[:, None, None] / 100
    unit, moving = np.repeat(np.arange(count), 2), np.ones(2 * count, bool)
    tables = _guaranteed(
        error=error, fast=moving, unit=unit, group=GROUP, joints=len(GROUPS), rate_hz=RATE_HZ
    )
    for of in ("joint", "body"):
        assert np.isfinite(tables[of][:, 1]).all((1, 2)).sum() == supported
        assert np.isinf(tables[of][:, 0]).all()  # nobody is still
        for i in range(supported):
            rank = math.ceil((count + 1) * LEVELS[i] - 1e-9)
            assert tables[of][i, 1] == pytest.approx(np.full((len(GROUPS), 2), rank / 100))


def test_the_shape_of_the_guaranteed_body_is_walking_speed():
    assert body_shape(np.array([0.04, 0.4, 1.0])) == pytest.approx([0.064, 0.64, 1.6])


def test_the_guaranteed_body_has_one_growth_for_all_joints():
    error = np.full((12, 3, COUNT), 0.1)
    error[:, :, WRIST] = [0.5, 0.6, 0.4]
    entries = _all_speeds([scores(f"r{n}", error) for n in range(9)])
    found = made(entries)
    assert found.guaranteed["body"][0, 1] == pytest.approx(np.tile([0.5, 0.6, 0.6], (13, 1)))
    joint = found.guaranteed["joint"][0, 1]
    assert joint[GROUPS.index("wrist")] == pytest.approx([0.5, 0.6, 0.6])
    assert np.delete(joint, GROUPS.index("wrist"), axis=0) == pytest.approx(0.1)


# -- whatever is given ----------------------------------------------------------------------------


def test_the_order_of_recordings_does_not_matter_and_the_same_gives_the_same_bytes():
    rng = np.random.default_rng(1)
    entries = [random_scores(rng, f"r{n}", 0.5, windows=20 + n) for n in range(8)]
    found, again = made(entries), made(entries)
    assert save_text(found) == save_text(again)
    other = made([entries[n] for n in (3, 1, 7, 0, 5, 2, 6, 4)])
    for of in ("joint", "body"):
        assert np.array_equal(found.estimated[of], other.estimated[of])
        assert np.array_equal(found.guaranteed[of], other.guaranteed[of])
    assert np.array_equal(found.thresholds_m, other.thresholds_m)
    assert found.ranges == other.ranges
    assert set(found.recordings) == set(other.recordings)


def test_presences_of_one_recording_are_one_unit():
    halves = [scores(f"r{n // 2}", 0.1) for n in range(12)]
    found = made(halves)
    assert [r.name for r in found.recordings] == [f"r{n}" for n in range(6)]
    assert found.independent(2) == 6


def test_too_few_recordings_are_refused():
    with pytest.raises(
        ConfigError, match=r"too few recordings .3.: .*give 4 at least \(9 for"
    ) as error:
        made([scores(f"r{n // 2}", 0.1) for n in range(6)])
    assert "\n" not in str(error.value)


def test_ranges_are_those_of_the_windows_rounded_outwards():
    found = made([scores(f"r{n}", 0.1, speed=1.234) for n in range(6)])
    assert found.ranges["speed_m_s"]["wrist"] == 1.24
    wrist, elbow = JOINTS.index("l_wrist"), JOINTS.index("l_elbow")
    right = np.linalg.norm(BODY[JOINTS.index("r_wrist")] - BODY[JOINTS.index("r_elbow")])
    bones = sorted([np.linalg.norm(BODY[wrist] - BODY[elbow]), right])
    low, high = found.ranges["bone_m"]["wrist"]
    assert bones[0] - 0.001 <= low <= bones[0]
    assert bones[1] <= high <= bones[1] + 0.001
    assert "waist" not in found.ranges["bone_m"]  # the root hangs on nothing
    assert found.ranges["ratio_short"] == pytest.approx(1.0)
