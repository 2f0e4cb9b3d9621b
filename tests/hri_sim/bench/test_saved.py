"""Comparing with an earlier bench: what is worse, better, new or gone; and wrong files."""

import json
import os

import pytest

from hri_predict.base.errors import ConfigError
from hri_sim.bench import saved
from hri_sim.bench.rows import Row

MACHINE = {"processor": "x", "cores": 2, "governor": "unknown", "yardstick_us": 100.0}


def verdict(old: Row | None, new: Row | None, factor: float = 1.5) -> str:
    before = {"a": [] if old is None else [old]}
    now = {"a": [] if new is None else [new]}
    (change,) = saved.compare(before, now, factor)
    return change.verdict


def row(p50: float | None, p99: float | None = None, **more) -> Row:
    return Row(part="tick", unit="ms", p50=p50, p99=p99, **more)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (row(1.0), row(1.6), "worse"),
        (row(1.0), row(1.4), "as before"),
        (row(1.0), row(0.6), "better"),
        (row(1.0, 2.0), row(1.0, 3.2), "worse"),  # the tail alone
        (row(1.0, 2.0), row(0.5, 3.2), "worse"),  # a better median does not make up for it
        (row(1.0, 2.0), row(1.2, 0.5), "as before"),  # nor a better tail for the median
        (row(10.0, more_is_better=True), row(6.0, more_is_better=True), "worse"),
        (row(10.0, more_is_better=True), row(16.0, more_is_better=True), "better"),
        (None, row(1.0), "new"),
        (row(1.0), None, "gone"),
        (row(1.0), row(None), "gone"),  # no figure, a note why
        (row(0.0), row(0.0), "as before"),
        (row(0.0), row(1.0), "not compared"),  # no ratio: nothing can be said
        (row(-1.0), row(1.0), "not compared"),
        (row(float("nan")), row(1.0), "not compared"),
        (row(float("inf")), row(1.0), "not compared"),
        (row(1e-300), row(1e300), "not compared"),
        (row(1.0, 0.0), row(1.0, 9.0), "not compared"),  # the tail alone
        (row(1.0, float("nan")), row(1.0, 9.0), "not compared"),
        (row(1.0), row(1.0, 9.0), "not compared"),
        (row(1.0, 9.0), row(1.0), "not compared"),
        (row(1.0, more_is_better=True), row(1.0), "not compared"),
        (Row(part="tick", unit="us", p50=1.0), row(1.0), "not compared"),
        (row(None), row(None), "not compared"),
    ],
)
def test_what_a_change_is_called(old, new, expected):
    assert verdict(old, new) == expected


def test_the_factor_decides():
    assert verdict(row(1.0), row(1.6), factor=2.0) == "as before"
    assert verdict(row(1.0), row(1.6), factor=1.1) == "worse"


def test_sections_that_were_not_measured_now_are_left_out():
    assert saved.compare({"a": [row(1.0)], "b": [row(1.0)]}, {"a": [row(1.0)]}, 1.5) == [
        saved.Change(section="a", part="tick", p50=1.0, p99=None, verdict="as before")
    ]


def test_what_was_saved_is_read_back(tmp_path):
    rows = {"a": [row(1.0, 2.0, max=3.0, aim=4.0, why="because", more={"k": [1]}), row(None)]}
    path = tmp_path / "bench.json"
    saved.save(path, saved.as_json(MACHINE, rows))
    assert saved.read(path) == (MACHINE, rows)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"format": "other"}',
        '{"format": "hri-predict bench 1"}',
        '{"format": "hri-predict bench 1", "machine": {}, "sections": []}',
        '{"format": "hri-predict bench 1", "machine": {}, "sections": {"a": [1]}}',
        '{"format": "hri-predict bench 1", "machine": {}, "sections": {"a": [{"part": "x"}]}}',
        '{"format": "hri-predict bench 1", "machine": {}, "sections": '
        '{"a": [{"part": "x", "unit": "ms", "p50": "fast"}]}}',
        "[" * 100_000,
        '{"format": "hri-predict bench 1", "sections": {}, "machine": {"yardstick_us": 1'
        + "0" * 400
        + "}}",
        '{"format": "hri-predict bench 1", "sections": {}, "machine": {"yardstick_us": NaN}}',
        '{"format": "hri-predict bench 1", "sections": {}, "machine": {"yardstick_us": -1}}',
        '{"format": "hri-predict bench 1", "sections": {}, "machine": {"yardstick_us": "a"}}',
        '{"format": "hri-predict bench 1", "sections": {}, "machine": {"yardstick_us": [1]}}',
        '{"format": "hri-predict bench 1", "machine": {}, "sections": '
        '{"a": [{"part": "x", "unit": "ms", "p50": 1' + "0" * 400 + "}]}}",
    ],
)
def test_another_file_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match="create one with hri-predict bench --save") as told:
        saved.read(path)
    assert "\n" not in str(told.value)


def test_bytes_that_are_no_text_are_refused(tmp_path):
    path = tmp_path / "other.json"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="it is not UTF-8 text"):
        saved.read(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.json: cannot be read: No such file"):
        saved.read(tmp_path / "none.json")


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(ConfigError, match="cannot be written"):
        saved.save(tmp_path, json.loads("{}"))


def test_a_pipe_is_refused_before_anything_is_measured(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match=r"--save .*pipe: cannot be written: not a file"):
        saved.check("--save", tmp_path / "pipe")


def test_another_machine_is_told():
    now = MACHINE | {"processor": "y", "yardstick_us": 150.0}
    lines = list(saved.other_machine(MACHINE, now))
    assert lines == [
        "the earlier run had another processor: x, now y",
        "the machine itself: a fixed workload takes 1.50 times as long as in the earlier run",
    ]
