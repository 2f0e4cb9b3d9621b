"""``check`` tells every mistake, a line each, and ends with status 2."""

import sys

import pytest

from hri_predict.cli import main

CELL = """\
source: {kind: procedural}
robots:
  - {name: arm, model: ur5x, room_from_robot: {}, max_speed_m_s: 1}
  - {name: two, model: ur5y, room_from_robot: {}, max_speed_m_s: 1}
"""


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        (CELL, ["3: robots.0.model: unknown robot", "4: robots.1.model: unknown robot"]),
        ("rat_hz: 1\n" + CELL[27:], ["1: source: required", "1: rat_hz: unknown key"]),
    ],
)
def test_every_mistake_is_a_line_and_the_status_is_2(tmp_path, monkeypatch, capsys, text, lines):
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["hri-predict", "check", str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    for line, expected in zip(err.splitlines(), lines, strict=True):
        assert line.startswith(f"error: {path}:{expected}")
