"""The report: whole or refused."""

import json
import os
import re
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from hri_predict.base.errors import ConfigError
from hri_predict.commissioning.identity import Identity, versions
from hri_predict.commissioning.report import (
    FileName,
    Report,
    Step,
    Steps,
    find_report,
    read_report,
    to_data,
    write_report,
)
from hri_predict.operation.evidence.chain import hash_of

AT = datetime(2026, 3, 4, 5, 6, tzinfo=UTC)
IDENTITY = Identity(
    config={"risk.mode": "iso"}, config_hash="0" * 64, files={}, versions=versions()
)


def step(outcome="passed", identity=IDENTITY.hash, **more):
    return Step(outcome=outcome, at=AT, identity=identity, **more)


def report(**changes) -> Report:
    steps = {name: step() for name in Steps.model_fields}
    steps |= changes.pop("steps", {})
    values = {"cell": "c.yaml", "config_path": "../c.yaml", "made": AT, "identity": IDENTITY}
    return Report(**values, steps=Steps(**steps), **changes)


@pytest.fixture
def written(tmp_path):
    write_report(report(notes=["fence"]), tmp_path)
    return tmp_path / "report.json"


def test_it_is_read_as_it_was_written(written):
    found, digest = read_report(written)
    assert found == report(notes=["fence"])
    assert digest == json.loads(written.read_text())["hash"]


@pytest.mark.parametrize(
    "change",
    [
        {"notes": []},
        {"cell": "other.yaml"},
        {"made": "2026-03-05T05:06:00Z"},
        {"hash": "0" * 64},
        {"hash": None},
        {"more": 1},
    ],
)
def test_a_report_that_was_changed_is_refused(written, change):
    data = json.loads(written.read_text()) | change
    written.write_text(json.dumps(data))
    with pytest.raises(ConfigError, match=r"was changed after|not a report"):
        read_report(written)


def test_an_outcome_cannot_be_made_better_by_hand(tmp_path):
    write_report(report(steps={"walk": step("failed", why=["7 %"])}), tmp_path)
    path = tmp_path / "report.json"
    path.write_text(path.read_text().replace('"failed"', '"passed"'))
    with pytest.raises(ConfigError, match="was changed after"):
        read_report(path)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"hash": 1}', '{"hash": "x", "a": NaN}'])
def test_what_is_no_report_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "report.json"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        read_report(path)
    assert "\n" not in str(refused.value)


@given(
    st.dictionaries(
        st.sampled_from(sorted(Report.model_fields.keys() - {"made"})), st.none() | st.integers()
    )
)
def test_a_report_of_wrong_types_with_a_right_hash_is_refused_in_one_line(
    tmp_path_factory, changes
):
    data = {k: v for k, v in to_data(report()).items() if k != "hash"} | changes
    data["hash"] = hash_of(data)
    path = tmp_path_factory.mktemp("report") / "report.json"
    path.write_text(json.dumps(data))
    if changes in ({}, {"format": 1}):
        read_report(path)
        return
    with pytest.raises(ConfigError, match=r"another version"):
        read_report(path)


def test_the_newest_of_a_folder_is_found(tmp_path):
    for name, day in (("a", 3), ("b", 9), ("c", 5)):
        made = report().model_copy(update={"made": AT.replace(day=day)})
        (tmp_path / name).mkdir()
        write_report(made, tmp_path / name)
    (tmp_path / "without").mkdir()
    assert find_report(tmp_path) == tmp_path / "b" / "report.json"
    assert find_report(tmp_path / "c") == tmp_path / "c" / "report.json"
    for missing in (tmp_path / "none", tmp_path / "none.json"):
        with pytest.raises(ConfigError, match="no such file"):
            find_report(missing)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match=r"no report\.json"):
        find_report(tmp_path / "empty")


@pytest.fixture
def two(tmp_path):
    """A folder of two reports; the path of the newer one."""
    for name, day in (("jan", 3), ("jun", 9)):
        (tmp_path / name).mkdir()
        made = report().model_copy(update={"made": AT.replace(day=day)})
        write_report(made, tmp_path / name)
    return tmp_path / "jun" / "report.json"


def cut(path):
    path.write_bytes(path.read_bytes()[:200])


def emptied(path):
    path.write_bytes(b"")


def made_older(path):
    path.write_text(path.read_text().replace("2026-03-09", "2025-03-09"))


def linked_to_nothing(path):
    path.unlink()
    path.symlink_to("elsewhere.json")


def of_no_day(path):
    data = {"made": "yesterday"}
    path.write_text(json.dumps(data | {"hash": hash_of(data)}))


@pytest.mark.parametrize("damage", [cut, emptied, made_older, linked_to_nothing, of_no_day])
def test_a_damaged_report_of_a_folder_is_named_and_no_older_one_is_used(two, damage):
    damage(two)
    with pytest.raises(ConfigError, match=re.escape(str(two))) as e:
        find_report(two.parents[1])
    assert "\n" not in str(e.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may look into any folder")
def test_a_folder_that_may_not_be_looked_into_is_named(two):
    two.parent.chmod(0)
    try:
        with pytest.raises(ConfigError, match=re.escape(str(two.parent))):
            find_report(two.parents[1])
    finally:
        two.parent.chmod(0o755)


def test_an_intact_report_of_another_version_does_not_hide_a_newer_one(two):
    old = two.parents[1] / "jan" / "report.json"
    data = {key: value for key, value in json.loads(old.read_text()).items() if key != "hash"}
    data["format"] = 0
    old.write_text(json.dumps(data | {"hash": hash_of(data)}))
    assert find_report(two.parents[1]) == two


@pytest.mark.parametrize(
    ("walk", "outcome", "line"),
    [
        (step(), "passed", None),
        (None, "open", "walk: not done"),
        (step("skipped", note="rain"), "open", "walk: skipped: rain"),
        (step("open", why=["x"]), "open", "walk: open: x"),
        (step("failed", why=["7 %"]), "failed", "walk: failed: 7 %"),
        (step(identity="other"), "open", "walk: done before the cell was changed; repeat it"),
        (step("failed", identity="other"), "failed", "walk: done before the cell was changed"),
    ],
)
def test_it_passes_only_if_every_step_passed_for_this_cell(walk, outcome, line):
    found = report(steps={"walk": walk})
    assert found.outcome == outcome
    assert [line in each for each in found.open] == ([] if line is None else [True])


def test_one_simulated_step_makes_it_a_simulation():
    assert not report().simulated
    assert report(steps={"echo": step(simulated=True)}).simulated


@pytest.mark.parametrize("name", ["../walk.mcap", "/etc/passwd", "..", "", "a/b", "a\nb"])
def test_a_file_of_a_report_lies_beside_it(name):
    with pytest.raises(ValidationError):
        TypeAdapter(FileName).validate_python(name)
