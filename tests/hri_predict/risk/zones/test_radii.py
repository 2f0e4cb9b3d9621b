"""Calibrations: stored ones are no smaller, broken ones are refused, and they know their owner."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.errors import ConfigError
from hri_predict.predictors.baselines import ZeroVelocitySettings
from hri_predict.risk.settings import LEVELS, CoverageSettings
from hri_predict.risk.zones import calibration as module
from hri_predict.risk.zones.calibration import (
    UsedRecording,
    calibration_for,
    identity,
    levels_text,
    load_calibration,
    needed,
    plain,
    save_text,
)
from hri_predict.risk.zones.motion_class import CLASSES
from hri_predict.risk.zones.radii import Radii
from hri_predict.skeleton import CANONICAL, JOINTS

WRIST, HEAD = JOINTS.index("l_wrist"), JOINTS.index("head")
STILL, MOVING = np.array([0.0]), np.array([1.0])
CALM = np.array([0.0])
SETTINGS = ZeroVelocitySettings(name="zero_velocity")


def stored(tmp_path, calibration):
    path = tmp_path / "own.calibration.json"
    path.write_text(save_text(calibration), encoding="utf-8")
    return path


# -- files ----------------------------------------------------------------------------------------


def test_what_is_stored_comes_back(tmp_path, make_calibration):
    made = make_calibration()
    back = load_calibration(stored(tmp_path, made))
    for of in ("joint", "body"):
        assert back.estimated[of] == pytest.approx(made.estimated[of])
        assert back.guaranteed[of] == pytest.approx(made.guaranteed[of])
    assert np.array_equal(back.thresholds_m, made.thresholds_m)
    for name in ("predictor", "settings", "weights", "rate_hz", "joints", "recordings", "ranges"):
        assert getattr(back, name) == getattr(made, name), name
    assert back.steps == 25
    assert save_text(back) == save_text(made)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.one_of(st.floats(0, 100), st.sampled_from([np.inf, 0.0005, 99.9999, 100.0, 101.0])),
        min_size=1,
        max_size=8,
    )
)
def test_radii_never_get_smaller_by_being_stored(tmp_path_factory, make_calibration, radii):
    row = np.maximum.accumulate(np.array(radii))
    made = make_calibration(steps=len(row))
    made = replace(made, estimated={of: table * 0 + row for of, table in made.estimated.items()})
    back = load_calibration(stored(tmp_path_factory.mktemp("c"), made))
    for of in ("joint", "body"):
        assert (back.estimated[of] >= made.estimated[of] - 1e-9).all()
        kept = np.isfinite(back.estimated[of])
        assert (back.estimated[of] < made.estimated[of] + 0.001 + 1e-9)[kept].all()
        assert (made.estimated[of][~kept] > 99.999).all()  # beyond 100 m nothing is known


def edited(make_calibration, edit):
    data = json.loads(save_text(make_calibration(steps=3)))
    edit(data)
    return json.dumps(data)


def _row(data, row):
    data["estimated_mm"]["joint"][0][0][0] = row


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda d: d.update(radius=1), "radius: unknown key"),
        (lambda d: d.update(estimated_mn=d.pop("estimated_mm")), "estimated_mm"),
        (lambda d: d.pop("thresholds_m"), "thresholds_m: required key is missing"),
        (lambda d: d.update(version=1), "is of another version; make a new one"),
        (lambda d: d.pop("version"), "is of another version"),
        (lambda d: d.update(steps=4), "a table has the shape"),
        (lambda d: d["joints"].append("tail"), "joints must be those of the canonical skeleton"),
        (lambda d: d["joints"].append(d["joints"][0]), "each once"),
        (lambda d: d["joints"].pop(), "a table has the shape"),
        (lambda d: d["estimated_mm"]["joint"].reverse(), "of a higher level is smaller"),
        (lambda d: d["estimated_mm"]["joint"][0][0][0].__setitem__(0, 0), "estimated_mm"),
        (lambda d: d["thresholds_m"][2].__setitem__(1, 1e9), "thresholds_m"),
        (lambda d: d["estimated_mm"]["joint"].pop(), "a table has the shape"),
        (lambda d: d["estimated_mm"].pop("body"), "body"),
        (lambda d: _row(d, [1, 2]), "own.calibration.json"),
        (lambda d: _row(d, [3, 2, 4]), "shrinks with the horizon"),
        (lambda d: _row(d, [5, 4, None]), "shrinks with the horizon"),
        (lambda d: _row(d, [None, 4, 5]), "shrinks with the horizon"),
        (lambda d: _row(d, [1, -2, 3]), "estimated_mm"),
        (lambda d: _row(d, [1, 2.5, 3]), "estimated_mm"),
        (lambda d: _row(d, [1, 2, 10**9]), "estimated_mm"),
        (lambda d: _row(d, [1, 2, float("nan")]), "estimated_mm"),
        (lambda d: _row(d, [1, 2, "far"]), "estimated_mm"),
        (lambda d: d["thresholds_m"].pop(), "thresholds_m"),
        (lambda d: d["thresholds_m"][0].reverse(), "thresholds_m"),
        (lambda d: d["thresholds_m"][1].__setitem__(1, float("nan")), "thresholds_m"),
        (lambda d: d["thresholds_m"][2].__setitem__(1, float("inf")), "thresholds_m"),
        (lambda d: d.update(levels=[0.5, 0.6, 0.7]), "another version"),
        (lambda d: d["classes"].reverse(), "another version"),
        (lambda d: d["recordings"][0].update(windows=[9]), "windows"),
        (lambda d: d["recordings"][0]["windows"].append(9), "windows"),
        (lambda d: d["recordings"][0]["windows"].__setitem__(0, -1), "windows"),
        (lambda d: d["ranges"]["bone_m"].update(wrist=[0.2]), "bone_m"),
        (lambda d: d["ranges"].update(ratio_short=0), "ratio_short"),
        (lambda d: d.update(rate_hz=1e9), "rate_hz"),
        (lambda d: d.update(steps=10**6), "steps"),
    ],
)
def test_a_broken_file_is_one_line_that_names_it(tmp_path, make_calibration, edit, said):
    path = tmp_path / "own.calibration.json"
    path.write_text(edited(make_calibration, edit), encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_calibration(path)
    line = str(error.value)
    assert "\n" not in line
    assert str(path) in line
    assert said in line


@pytest.mark.parametrize(
    "text",
    [
        "",
        "radii: 3",
        "[]",
        "null",
        "3",
        "{",
        "[" * 100_000,
        '{"version": ' + "9" * 10_000 + "}",
        "x" * 50_000_000,
    ],
    ids=["empty", "yaml", "list", "null", "number", "cut", "deep", "digits", "huge"],
)
def test_what_is_no_calibration_is_one_line(tmp_path, text):
    path = tmp_path / "own.calibration.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_calibration(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 500


def test_a_file_that_is_not_there_or_not_text(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_calibration(tmp_path / "none.json")
    path = tmp_path / "own.calibration.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_calibration(path)


# -- radii ----------------------------------------------------------------------------------------


def test_radii_are_of_the_level_the_question_the_class_the_joint_and_the_step(make_calibration):
    made = make_calibration(steps=4)
    g = made.joints.index("wrist")

    def radius(speed, residual, **coverage):
        radii = Radii(made, CoverageSettings(**coverage), CANONICAL, 4)
        return radii.of(np.array([speed]), np.array([residual]))[0, 2, WRIST]

    base = 0.03 + 0.001 * g  # of level 0, class 0 and the third step
    assert radius(0.0, 0.0, level=0.9, of="joint") == pytest.approx(base)
    assert radius(0.0, 0.0, level=0.99, of="joint") == pytest.approx(base + 0.4)
    assert radius(0.0, 0.0, level=0.9, of="body") == pytest.approx(base + 1)
    assert radius(0.0, 0.15, level=0.9, of="joint") == pytest.approx(base + 0.04)
    # people without a known residual take the last of the four grades: classes 3, 7 and 11
    for speed, c in ((0.0, 3), (0.5, 7), (1.0, 11)):
        assert radius(speed, np.nan, level=0.9, of="joint") == pytest.approx(base + c * 0.04)
    # guaranteed ones know the speed class alone: they are those of its first motion class
    held = {"level": 0.9, "of": "joint", "basis": "guaranteed"}
    assert radius(0.0, 9.0, **held) == pytest.approx(base + 2)
    for residual in (0.0, 9.0, np.nan):
        assert radius(0.5, residual, **held) == pytest.approx(base + 2 + 4 * 0.04)
        assert radius(1.0, residual, **held) == pytest.approx(base + 2 + 8 * 0.04)


def test_people_are_told_apart_and_sides_share_their_radii(make_calibration):
    radii = Radii(make_calibration(), CoverageSettings(), CANONICAL, 25)
    found = radii.of(np.array([0.0, 0.5]), np.array([0.0, 0.0]))
    assert found.shape == (2, 25, len(JOINTS))
    assert (found[1] > found[0]).all()
    assert np.array_equal(found[..., WRIST], found[..., JOINTS.index("r_wrist")])
    assert (plain("l_wrist"), plain("r_wrist"), plain("head")) == ("wrist", "wrist", "head")


@pytest.mark.parametrize("widest", range(3))
def test_who_has_no_known_speed_has_the_largest_radii_of_all_speeds(make_calibration, widest):
    made = make_calibration()
    table = made.estimated["joint"].copy()
    table[:, 4 * widest : 4 * widest + 4] += 1.0  # of this speed class
    made = replace(made, estimated={"joint": table, "body": 1.0 + table})
    radii = Radii(made, CoverageSettings(), CANONICAL, 4)
    for residual in (0.0, 0.4, 9.0, np.nan):  # the grade is that of who is slow
        unknown, slow = radii.of(np.array([np.nan, 0.5]), np.array([residual, residual]))
        (kind,) = radii.classes(np.array([0.5]), np.array([residual]))
        per_speed = [table[2, 4 * c + kind % 4, :, :4].T for c in range(3)]
        of_joint = [made.joints.index(plain(name)) for name in JOINTS]
        assert unknown == pytest.approx(np.max(per_speed, axis=0)[:, of_joint])
        assert (unknown >= slow).all()


def test_joints_that_were_not_calibrated_are_unbounded(make_calibration):
    made = make_calibration(joints=("shoulder", "elbow", "wrist"))
    found = Radii(made, CoverageSettings(), CANONICAL, 25).of(STILL, CALM)[0]
    known = {JOINTS[j] for j in np.flatnonzero(np.isfinite(found).all(0))}
    assert known == {s + n for s in ("l_", "r_") for n in ("shoulder", "elbow", "wrist")}
    assert np.isinf(found[:, HEAD]).all()


def test_steps_beyond_the_calibrated_ones_are_unbounded(make_calibration):
    radii = Radii(make_calibration(steps=10), CoverageSettings(), CANONICAL, 25)
    found = radii.of(MOVING, CALM)[0]
    assert np.isfinite(found[:10]).all()
    assert np.isinf(found[10:]).all()
    assert radii.steps == 10
    fewer = Radii(make_calibration(steps=25), CoverageSettings(), CANONICAL, 10).of(MOVING, CALM)
    assert fewer.shape == (1, 10, len(JOINTS))


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
    still_only = (0, 0, 0, 1, *(0,) * 8)  # one window, of somebody new
    recordings = tuple(UsedRecording(name=f"walking_{n}", windows=still_only) for n in range(20))
    made = replace(make_calibration(), recordings=recordings)
    assert [made.independent(c) for c in range(3)] == [20, 0, 0]
    for c in range(3):  # the first grade of each speed
        one = UsedRecording(name="walking_0", windows=tuple(4 * c == k for k in range(12)))
        only = replace(made, recordings=(one,))
        assert [only.independent(k) for k in range(3)] == [c == k for k in range(3)]
    with pytest.raises(ConfigError, match=r"0 recordings show people slow, 19 are needed.*19 more"):
        Radii(made, CoverageSettings(level=0.95, basis="guaranteed"), CANONICAL, 25)


def test_levels_are_labelled(make_calibration):
    made = make_calibration(19)
    assert levels_text(made) == [
        "90 %: guaranteed",
        "95 %: guaranteed",
        "99 %: estimated; a guarantee takes 80 more with people still, 80 more with people slow,"
        " 80 more with people brisk",
    ]


def test_a_level_that_is_not_calibrated_is_refused():
    with pytest.raises(ValueError, match=r"level must be one of 0\.9, 0\.95, 0\.99"):
        CoverageSettings(level=0.8)


def test_ranges_are_by_joint_and_unbounded_where_unknown(make_calibration):
    ranges = make_calibration().motion_ranges(CANONICAL)
    assert ranges.speed_m_s[WRIST] == 4.0
    assert ranges.speed_m_s[HEAD] == np.inf
    assert ranges.bone_m[WRIST].tolist() == [0.2, 0.3]
    assert ranges.bone_m[HEAD].tolist() == [0.0, np.inf]
    assert ranges.ratio_short == 1.5


# -- whose it is ----------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch, make_calibration):
    """Where shipped calibrations lie, with one of zero velocity."""
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    values, _ = identity(SETTINGS)
    own = make_calibration(settings=values)
    (tmp_path / "zero_velocity.calibration.json").write_text(save_text(own), encoding="utf-8")
    return tmp_path


OTHERS = [
    (SETTINGS.model_copy(update={"history_s": 0.7}), "was made with history_s 0.5, not 0.7"),
    (SETTINGS.model_copy(update={"rate_hz": 50.0}), "is for 25 steps per second, not 50"),
    (SETTINGS.model_copy(update={"name": "other"}), "is of predictor zero_velocity, not other"),
]


def test_the_shipped_one_is_used_for_its_settings_alone(folder):
    found = calibration_for(SETTINGS, CoverageSettings(), folder)
    assert found is not None
    assert found.predictor == "zero_velocity"
    farther = SETTINGS.model_copy(update={"horizon_s": 0.6})  # the same forecast, cut
    assert calibration_for(farther, CoverageSettings(), folder) is not None
    for other, _ in OTHERS:
        assert calibration_for(other, CoverageSettings(), folder) is None


@pytest.mark.parametrize(("other", "said"), OTHERS, ids=["history", "rate", "name"])
def test_one_that_was_asked_for_is_refused_where_it_does_not_fit(folder, other, said):
    coverage = CoverageSettings(calibration="zero_velocity.calibration.json")
    assert calibration_for(SETTINGS, coverage, folder) is not None
    with pytest.raises(ConfigError) as error:
        calibration_for(other, coverage, folder)
    assert said in str(error.value)
    assert "hri-predict calibrate --predictor" in str(error.value)
    assert "\n" not in str(error.value)


def test_other_weights_are_another_predictor(folder, make_calibration):
    weights = folder / "zero_velocity.safetensors"
    weights.write_bytes(b"first")
    values, mark = identity(SETTINGS)
    assert mark == "a7937b64b8caa58f03721bb6bacf5c78cb235febe0e70b1b84cd99541461a08e"[:16]
    assert calibration_for(SETTINGS, CoverageSettings(), folder) is None  # it was without weights
    own = folder / "own.json"
    own.write_text(save_text(make_calibration(settings=values, weights=mark)), encoding="utf-8")
    coverage = CoverageSettings(calibration="own.json")
    assert calibration_for(SETTINGS, coverage, folder) is not None
    weights.write_bytes(b"second")
    with pytest.raises(ConfigError, match="was made with other weights"):
        calibration_for(SETTINGS, coverage, folder)


def test_who_ships_none_is_not_calibrated_and_a_broken_one_is_no_secret(folder):
    with pytest.raises(ConfigError, match="cannot be read"):
        calibration_for(SETTINGS, CoverageSettings(calibration="none.json"), folder)
    (folder / "zero_velocity.calibration.json").write_text("{", encoding="utf-8")
    with pytest.raises(ConfigError, match="is not JSON"):
        calibration_for(SETTINGS, CoverageSettings(), folder)
    (folder / "zero_velocity.calibration.json").unlink()
    assert calibration_for(SETTINGS, CoverageSettings(), folder) is None


def test_a_calibration_has_all_levels_and_classes(make_calibration):
    data = json.loads(save_text(make_calibration()))
    assert data["levels"] == list(LEVELS)
    assert data["classes"] == list(CLASSES)


@pytest.mark.parametrize(
    "path", sorted(module.FOLDER.glob("*.calibration.json")), ids=lambda path: path.name
)
def test_the_shipped_ones_can_be_read(path):
    made = load_calibration(path)
    assert path.name == f"{made.predictor}.calibration.json"
    assert made.rate_hz == 25.0
