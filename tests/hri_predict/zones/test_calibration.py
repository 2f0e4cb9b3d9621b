"""Calibrations: stored ones are no smaller, and broken ones are refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.lab.calibration.levels import levels_text
from hri_predict.zones import calibration as module
from hri_predict.zones.calibration import load_calibration, save_text
from hri_predict.zones.motion_class import SPEED_CLASSES
from hri_predict.zones.scale_shape import KNOTS, ScaleShape
from hri_predict.zones.settings import LEVELS
from hri_predict.zones.toward import BINS

WRIST, HEAD = JOINTS.index("l_wrist"), JOINTS.index("head")


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
    assert back.scale.to_json() == made.scale.to_json()
    for name in ("predictor", "settings", "weights", "rate_hz", "joints", "recordings", "ranges"):
        assert getattr(back, name) == getattr(made, name), name
    assert back.steps == 25
    assert back.limits is None  # as in a file that was made before there were any
    assert save_text(back) == save_text(made)


def test_limits_that_are_stored_come_back(tmp_path, make_calibration):
    made = make_calibration()
    limits = {of: table + 1.5 for of, table in made.guaranteed.items()}
    limits["body"][:, 2] = np.inf
    back = load_calibration(stored(tmp_path, replace(made, limits=limits)))
    assert back.limits is not None
    for of in ("joint", "body"):
        assert back.limits[of] == pytest.approx(limits[of], abs=1e-3)
        assert (back.limits[of] >= limits[of] - 1e-9).all()  # rounded up


def test_a_shape_that_is_stored_comes_back(tmp_path, make_calibration):
    made = make_calibration(steps=3)
    assert load_calibration(stored(tmp_path, made)).shape is None
    size = np.broadcast_to(np.geomspace(0.1, 10.0, KNOTS), (3, 3, KNOTS)).copy()
    back = load_calibration(stored(tmp_path, replace(made, shape=ScaleShape(size, size * 0 + 1.5))))
    assert back.shape is not None
    np.testing.assert_allclose(back.shape.size_m, size, atol=1e-6)
    np.testing.assert_allclose(back.shape.factor, 1.5)


@given(share=st.one_of(st.floats(0.05, 1.0), st.sampled_from([0.5, 0.4999, 0.05])))
def test_shares_by_direction_that_are_stored_come_back_and_never_smaller(
    tmp_path_factory, make_calibration, share
):
    made = make_calibration(steps=3)
    toward = np.full((len(LEVELS), len(SPEED_CLASSES), 3, BINS), 1.0)
    toward[1, 2, 0, 4] = share
    back = load_calibration(stored(tmp_path_factory.mktemp("c"), replace(made, toward=toward)))
    assert back.toward is not None
    np.testing.assert_allclose(back.toward, toward, atol=1e-3)
    assert (back.toward >= toward - 1e-9).all()  # 1e-6 thousandths are forgiven: rounding


def test_a_file_from_before_there_were_shares_has_none(tmp_path, make_calibration):
    path = stored(tmp_path, make_calibration())
    data = json.loads(path.read_text(encoding="utf-8"))
    data.pop("toward_thousandths", None)
    path.write_text(json.dumps(data), encoding="utf-8")
    assert load_calibration(path).toward is None


@given(
    st.lists(
        st.one_of(st.floats(0.1, 100), st.sampled_from([np.inf, 0.1005, 99.9999, 100.0, 101.0])),
        min_size=1,
        max_size=8,
    )
)
def test_factors_and_radii_never_get_smaller_by_being_stored(
    tmp_path_factory, make_calibration, values
):
    row = np.array(values)
    made = make_calibration(steps=len(row))
    made = replace(
        made,
        estimated={of: table * 0 + row for of, table in made.estimated.items()},
        guaranteed={
            of: table * 0 + np.maximum.accumulate(row) for of, table in made.guaranteed.items()
        },
    )
    back = load_calibration(stored(tmp_path_factory.mktemp("c"), made))
    for of in ("joint", "body"):
        for before, after in (
            (made.estimated[of], back.estimated[of]),
            (made.guaranteed[of], back.guaranteed[of]),
        ):
            assert (after >= before - 1e-9).all()  # 1e-6 thousandths are forgiven: rounding
            kept = np.isfinite(after)
            assert (after < before + 0.001 + 1e-9)[kept].all()
            assert (before[~kept] > 99.999).all()  # beyond 100 nothing is known


def edited(make_calibration, edit):
    data = json.loads(save_text(make_calibration(steps=3)))
    edit(data)
    return json.dumps(data)


def _row(data, row):
    data["guaranteed_mm"]["joint"][0][0][0] = row


def _factors(data, row):
    data["estimated_thousandths"]["joint"][0][0] = row


def _shares(data, edit, every=False):
    """Shares of three steps, of which one row, or every row, is damaged."""
    table = np.full((len(LEVELS), len(SPEED_CLASSES), 3, BINS), 500).tolist()
    data["toward_thousandths"] = table
    for rows in [step for level in table for step in level] if every else [table[1][0][:1]]:
        for row in rows:
            edit(row)


def _weight(data, value):
    data["scale"]["layers"][0]["weights"][0][0] = value


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda d: d.update(radius=1), "radius: unknown key"),
        (
            lambda d: d.update(estimated_mm=d.pop("estimated_thousandths")),
            "estimated_thousandths: required key is missing",
        ),
        (lambda d: d.pop("scale"), "scale: required key is missing"),
        (lambda d: d["scale"].pop("mean"), "the scale is not a valid network"),
        (lambda d: d["scale"].update(layers=3), "the scale is not a valid network"),
        (lambda d: d["scale"].update(layers=[[1], [2]]), "the scale is not a valid network"),
        (lambda d: d["scale"].update(layers=[]), "must have one output"),
        (lambda d: d["scale"]["layers"].pop(), "must have one output"),
        (lambda d: d["scale"]["layers"].reverse(), "does not fit the one before"),
        (lambda d: d["scale"]["layers"][0]["biases"].pop(), "does not fit the one before"),
        (lambda d: d["scale"]["mean"].pop(), "mean or deviation does not fit"),
        (lambda d: d["scale"]["deviation"].__setitem__(0, 1e-9), "mean or deviation does not fit"),
        (lambda d: _weight(d, float("nan")), "a number beyond 10,"),
        (lambda d: _weight(d, -1e308), "a number beyond 10,"),
        (lambda d: _weight(d, 10**400), "the scale is not a valid network"),
        (lambda d: _weight(d, "far"), "could not convert string"),
        (lambda d: _weight(d, [1.0]), "own.calibration.json"),
        (lambda d: _factors(d, [1, 2]), "own.calibration.json"),
        (lambda d: _factors(d, [1, -2, 3]), "estimated_thousandths"),
        (lambda d: _factors(d, [1, 2.5, 3]), "estimated_thousandths"),
        (lambda d: _factors(d, [1, 2, 10**9]), "estimated_thousandths"),
        (lambda d: _factors(d, [1, 2, float("nan")]), "estimated_thousandths"),
        (lambda d: _factors(d, [1, 2, "far"]), "estimated_thousandths"),
        (lambda d: d.update(shape={"size_um": 1}), "shape must have size_um and thousandths"),
        (lambda d: d.update(shape=3), "shape"),
        (lambda d: d.update(version=2), "has another version; make a new one"),
        (lambda d: d.update(version=1), "has another version; make a new one"),
        (lambda d: d.pop("version"), "has another version"),
        (lambda d: d.update(steps=4), "a table has the shape"),
        (lambda d: d["joints"].append("tail"), "joints must be those of the canonical skeleton"),
        (lambda d: d["joints"].append(d["joints"][0]), "each once"),
        (lambda d: d["joints"].pop(), "a table has the shape"),
        (lambda d: d["estimated_thousandths"]["joint"].reverse(), "of a higher level is smaller"),
        (lambda d: _factors(d, [0, 1, 2]), "estimated_thousandths"),
        (lambda d: d["guaranteed_mm"]["joint"].pop(), "a table has the shape"),
        (lambda d: d["estimated_thousandths"].pop("body"), "not for joint and body"),
        (lambda d: d.update(estimated_thousandths={}), "not for joint and body"),
        (lambda d: d["guaranteed_mm"].pop("joint"), "not for joint and body"),
        (lambda d: d.update(recordings=[]), "recordings"),
        (lambda d: _row(d, [1, 2]), "own.calibration.json"),
        (lambda d: _row(d, [3, 2, 4]), "shrinks with the horizon"),
        (lambda d: _row(d, [5, 4, None]), "of a higher level is smaller"),
        (lambda d: _row(d, [None, 4, 5]), "of a higher level is smaller"),
        (lambda d: _row(d, [1, -2, 3]), "guaranteed_mm"),
        (lambda d: _row(d, [1, 2.5, 3]), "guaranteed_mm"),
        (lambda d: _row(d, [1, 2, 10**9]), "guaranteed_mm"),
        (lambda d: _row(d, [1, 2, float("nan")]), "guaranteed_mm"),
        (lambda d: _row(d, [1, 2, "far"]), "guaranteed_mm"),
        (lambda d: d.update(limits_mm={}), "not for joint and body"),
        (lambda d: d.update(limits_mm={"joint": [], "body": []}), "a table has the shape"),
        (lambda d: d.update(limits_mm=7), "limits_mm"),
        (lambda d: d.update(toward_thousandths=7), "toward_thousandths"),
        (lambda d: d.update(toward_thousandths=[]), "toward_thousandths has the shape"),
        (lambda d: _shares(d, lambda row: row.pop()), "toward_thousandths"),
        (lambda d: _shares(d, lambda row: row.__setitem__(2, 1001)), "toward_thousandths"),
        (lambda d: _shares(d, lambda row: row.__setitem__(2, 0)), "toward_thousandths"),
        (lambda d: _shares(d, lambda row: row.__setitem__(2, None)), "toward_thousandths"),
        (lambda d: _shares(d, lambda row: row.__setitem__(2, float("nan"))), "toward_thousandths"),
        (lambda d: _shares(d, lambda row: row.append(500), every=True), "has the shape"),
        (lambda d: d.update(levels=[0.5, 0.6, 0.7]), "another version"),
        (lambda d: d["classes"].reverse(), "another version"),
        (lambda d: d["recordings"][0].update(windows=[9]), "windows"),
        (lambda d: d["recordings"][0]["windows"].append(9), "windows"),
        (lambda d: d["recordings"][0]["windows"].__setitem__(0, -1), "windows"),
        (lambda d: d["ranges"].update(bone_m={}), "bone_m"),
        (lambda d: d["ranges"].update(ratio_short=0), "ratio_short"),
        (lambda d: d["ranges"].update(ratio_short=1e9), "ratio_short"),
        (lambda d: d["ranges"].update(ratio_short=float("inf")), "ratio_short"),
        (lambda d: d["ranges"].update(speed_m_s={"wrist": 1e6}), "ranges.speed_m_s.wrist"),
        (lambda d: d["ranges"].update(speed_m_s={"wrist": float("nan")}), "speed_m_s.wrist"),
        (lambda d: d["ranges"].update(speed_m_s={"tail": 1.0}), "ranges.speed_m_s names a joint"),
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
    assert line.count("make a new one: hri-predict calibrate") == 1


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
    assert len(text) > 10**6 or "hri-predict calibrate" in str(error.value)


def test_a_file_that_is_not_there_or_not_text(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_calibration(tmp_path / "none.json")
    path = tmp_path / "own.calibration.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_calibration(path)


def test_levels_are_labelled(make_calibration):
    made = make_calibration(19)
    assert levels_text(made) == [
        "90 %: guaranteed",
        "95 %: guaranteed",
        "99 %: estimated; a guarantee needs 80 more recordings of people who stand still, 80 of "
        "people who move slowly, 80 of people who move briskly",
    ]


def test_ranges_are_by_joint_and_unbounded_where_unknown(make_calibration):
    ranges = make_calibration().motion_ranges(CANONICAL)
    assert ranges.speed_m_s[WRIST] == 4.0
    assert ranges.speed_m_s[HEAD] == np.inf
    assert ranges.ratio_short == 1.5


def test_no_joint_is_slower_than_the_trunk_that_carries_it(make_calibration):
    # the crown, seen in a few recordings of people who stand, must not make every walker "unlike"
    speeds = {"neck": 3.0, "hip": 2.0, "head_top": 1.0, "hand": 6.0}
    own = replace(make_calibration(), ranges={"speed_m_s": speeds, "ratio_short": 1.5})
    found = dict(zip(JOINTS, own.motion_ranges(CANONICAL).speed_m_s.tolist(), strict=True))
    assert found["head_top"] == found["l_hip"] == found["neck"] == 3.0
    assert found["r_hand"] == 6.0
    assert found["l_wrist"] == np.inf


def test_a_calibration_has_all_levels_and_classes(make_calibration):
    data = json.loads(save_text(make_calibration()))
    assert data["levels"] == list(LEVELS)
    assert data["classes"] == list(SPEED_CLASSES)


@pytest.mark.parametrize(
    "path", sorted(module.FOLDER.glob("*.calibration.json")), ids=lambda path: path.name
)
def test_the_shipped_ones_can_be_read(path):
    made = load_calibration(path)
    assert path.name == f"{made.predictor}.calibration.json"
    assert made.rate_hz == 25.0
