"""Answers from a file: each mistake is one line that names its key."""

import io
import sys

import pytest
import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.cli.commission.answers import Answers, ask_points, asked, read_answers


def read(folder, data):
    path = folder / "answers.yaml"
    path.write_text(data if isinstance(data, str) else yaml.safe_dump(data))
    return read_answers(path)


def test_none_means_defaults(tmp_path):
    assert read_answers(None) == Answers()
    assert read(tmp_path, {"by": "Ada"}).by == "Ada"


@pytest.mark.parametrize(
    ("data", "key"),
    [
        ({"regstration": {}}, "did you mean 'registration'"),
        ({"registration": {"points": [[1, 2]]}}, "registration.points.0"),
        ({"registration": {"points": [[1, 2, float("nan")]]}}, "registration.points.0.2"),
        ({"registration": {"write": 1}}, "registration.write"),
        ({"echo": {"seconds": 1e9}}, "echo.seconds"),
        ({"echo": {"measured": {"plc": {"p50_ms": 9, "p99_ms": 20, "max_ms": 10}}}}, "max_ms"),
        ({"stopping": {"cell_is_clear": "yes"}}, "stopping.cell_is_clear"),
        ({"stopping": {"repeats": True}}, "stopping.repeats"),
        ({"stopping": {"speeds_m_s": [0]}}, "stopping.speeds_m_s.0"),
        ({"walk": {"cell_m": 0}}, "walk.cell_m"),
        ({"walk": {"exclude": [[[0, 0], [1, 1]]]}}, "walk.exclude.0"),
        ({"walk": {"least_coverage": 2}}, "walk.least_coverage"),
        ({"skip": {"walk": ""}}, "skip.walk"),
        ({"skip": {"lunch": "hungry"}}, "skip.lunch"),
        ({"notes": [1]}, "notes.0"),
        ("", "expected keys and values"),
        ("a: [", "not valid YAML"),
    ],
)
def test_a_mistake_is_one_line_that_names_its_key(tmp_path, data, key):
    with pytest.raises(ConfigError, match="answers ") as refused:
        read(tmp_path, data)
    assert key in str(refused.value)
    assert "\n" not in str(refused.value)


def typed(monkeypatch, *lines):
    monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


@pytest.mark.parametrize(
    ("step", "lines", "key", "value"),
    [
        ("registration", ["x", "d", "y"], "write", True),
        ("echo", ["", "12", "plc, 20, 30, 40", ""], "seconds", 12.0),
        ("stopping", ["d", "yes", "[0.2, 0.4]"], "speeds_m_s", [0.2, 0.4]),
        ("stopping", ["d", "", ""], "cell_is_clear", False),
        ("walk", ["d", "90", ""], "seconds", 90.0),
        ("walk", ["d", "", "[[[0, 0]]]", "[[[0, 0], [1, 0], [1, 1]]]"], "exclude",
         [[[0, 0], [1, 0], [1, 1]]]),
    ],
)  # fmt: skip
def test_what_somebody_types_is_taken_and_what_is_wrong_is_asked_again(
    monkeypatch, capsys, step, lines, key, value
):
    typed(monkeypatch, *lines)
    found = asked(Answers(), step)
    assert getattr(getattr(found, step), key) == value
    assert sys.stdin.read() == ""


def test_skipping_needs_a_reason_and_quitting_ends(monkeypatch, capsys):
    typed(monkeypatch, "s", "", "no robot yet")
    found = asked(Answers(), "stopping")
    assert found is not None
    assert found.skip == {"stopping": "no robot yet"}
    typed(monkeypatch, "q")
    assert asked(Answers(), "walk") is None
    typed(monkeypatch)
    with pytest.raises(ConfigError, match="the input ended"):
        asked(Answers(), "walk")


def test_a_text_too_long_for_the_report_is_asked_again(monkeypatch, capsys):
    typed(monkeypatch, "s", "x" * 2001, "short")
    found = asked(Answers(), "walk")
    assert found is not None
    assert found.skip == {"walk": "short"}
    assert "2001 characters; at most 2000" in capsys.readouterr().err


def test_points_are_asked_until_there_are_enough(monkeypatch, capsys):
    typed(monkeypatch, "0,0,1", "", "1,x,1", "1,0,1", "0,1,1", "")
    assert ask_points(3) == [[0, 0, 1], [1, 0, 1], [0, 1, 1]]
