"""``check`` tells every mistake, a line each, and ends with status 2."""

import pytest

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
def test_every_mistake_is_a_line_and_the_status_is_2(tmp_path, cli, text, lines):
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    status, out, err = cli("check", path)
    assert (status, out) == (2, "")
    for line, expected in zip(err.splitlines(), lines, strict=True):
        assert line.startswith(f"error: {path}:{expected}")


GOOD = """\
source: {kind: procedural}
robots:
  - {name: arm, model: ur5e, room_from_robot: {}, max_speed_m_s: 1}
people:
  exits:
    - {polygon: [[6, 6], [7, 6], [7, 7]]}
    - {polygon: [[1, 0], [2, 0], [2, 1]]}
predictor:
  name: constant_velocity
links:
  - {name: drive, kind: serial, simulate: {trajectory: pick_and_place, faults: []}}
"""


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("", "", "7: people.exits.1: "),
        ("[2, 1]]}\npredictor:\n", "[2, 1]]}\npredictor:\n  horizon_s: 0.3\n", "9: predictor."),
        ("faults: []", "faults: [{kind: vanish}]", "11: links.drive.simulate.faults.0: unknown"),
    ],
)
def test_what_only_the_whole_cell_shows_has_its_line_too(tmp_path, cli, command, old, new, line):
    path = tmp_path / "cell.yaml"
    text = GOOD.replace(old, new, 1)
    if not line.startswith("7"):
        text = text.replace("[[1, 0], [2, 0], [2, 1]]", "[[6, 6], [7, 6], [7, 7]]")
    path.write_text(text, encoding="utf-8")
    status, _, err = cli(command, path)
    assert status == 2
    assert err.splitlines()[-1].startswith(f"error: {path}:{line}"), err
