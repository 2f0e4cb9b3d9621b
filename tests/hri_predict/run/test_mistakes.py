"""All mistakes of a configuration are told at once, each with its file, line, key and remedy."""

import re

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError, ConfigMistakes
from hri_predict.base.files import line_of
from hri_predict.run import config as configuration
from hri_predict.run.mistakes import MAX_SHOWN

TEN = """\
# a cell
rate_hz: 400
source:
  kind: procedurall
predictor: {name: kalman,
            horizon: 1}
robots:
  - name: arm
    model: ur5e
    room_from_robot: {xyz: [0, 0]}
    max_speed_m_s: 300
    motion: {kind: state, stale: 1}
  - name: arm
    model: ur5e
    motion: {kind: dance}
risk: {mod: iso}
links:
  - {name: plc, kind: can}
"""

EXPECTED = {
    2: r"rate_hz: .*100; got 400 \(cycles per second, Hz\)",
    4: r"source.kind: unknown source 'procedurall'; did you mean 'procedural'\?",
    6: r"predictor.horizon: unknown key; did you mean 'horizon_s'\?",
    10: r"robots.0.room_from_robot.xyz: ",
    11: r"robots.0.max_speed_m_s: .*20; got 300 \(maximum speed of the fastest point",
    12: r"robots.0.motion.stale: unknown key; did you mean 'stale_s'\?",
    13: r"robots.1.max_speed_m_s: required key is missing; add it \(maximum speed of the fastest",
    15: r"robots.1.motion: .*'dance'.*'standing'",
    16: r"risk.mod: unknown key; did you mean 'mode'\?",
    18: r"links.0.interface: required key is missing; add it",
}


def told(tmp_path, text):
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigMistakes) as caught:
        configuration.load(path)
    assert str(caught.value) == "\n".join(caught.value.lines)
    found = {}
    for line in caught.value.lines:
        place = re.fullmatch(rf"{re.escape(str(path))}:(\d+): (.+)", line)
        assert place, line
        found[int(place[1])] = place[2]
    assert len(found) == len(caught.value.lines)
    return found


def test_ten_mistakes_are_ten_lines_in_the_files_order(tmp_path):
    found = told(tmp_path, TEN)
    assert list(found) == list(EXPECTED)
    for line, text in EXPECTED.items():
        assert re.match(text, found[line]), found[line]


GOOD = """\
source: {kind: procedural}
robots:
  - {name: arm, model: ur5e, room_from_robot: {}, max_speed_m_s: 1}
  - {name: two, model: ur5e, room_from_robot: {}, max_speed_m_s: 1}
links:
  - {name: plc, kind: serial, port: a}
"""


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("name: two", "name: arm", 4, "robots.1.name: name 'arm' is used twice"),
        (
            "name: arm, model: ur5e, room_from_robot: {}, max_speed_m_s: 1}\n  - {name: two",
            "name: arm 1, model: ur5e, room_from_robot: {}, max_speed_m_s: 1}\n  - {name: arm.1",
            4,
            "robots.1.name: 'arm 1' and 'arm.1' have the same topic /advice/arm_1 in recordings",
        ),
        ("port: a", "port: a, robots: [arm, tow]", 6, "links.0.robots.1: no robot 'tow'; did you"),
        ("port: a", "usb: {vid: '0403'}", 6, "links.0.usb.pid: required key is missing"),
        (", room_from_robot: {}", "", 3, "robots.0: robot 'arm': give either room_from_robot"),
        (
            "kind: procedural",
            "kind: procedural, people: [{start: [1, 2], script: [{do: wait, second: 1}]}]",
            1,
            "source.people.0.script.0.seconds: required key is missing",
        ),
    ],
)
def test_a_mistake_is_told_at_its_own_line(tmp_path, old, new, line, said):
    assert told_at(tmp_path, GOOD.replace(old, new, 1), line).startswith(said)


def told_at(tmp_path, text, line):
    path = tmp_path / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigMistakes) as caught:
        configuration.load(path)
    return caught.value.lines[0].removeprefix(f"{path}:{line}: ")


def test_keys_of_a_unions_member_are_those_of_the_one_that_was_meant(tmp_path):
    step = "people: [{start: [1, 2], script: [{do: wait, seconds: 1, bakwards: true}]}]"
    said = told_at(tmp_path, GOOD.replace("kind: procedural", f"kind: procedural, {step}"), 1)
    assert said.endswith("script.0.bakwards: unknown key (known: do, seconds)")


def test_a_file_full_of_mistakes_tells_some_and_counts_the_rest(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(GOOD + "".join(f"odd{i}: 1\n" for i in range(MAX_SHOWN + 7)))
    with pytest.raises(ConfigMistakes) as caught:
        configuration.load(path)
    assert len(caught.value.lines) == MAX_SHOWN + 1
    assert "7 more mistakes" in caught.value.lines[-1]


def test_a_key_behind_an_alias_is_told_where_it_is_written():
    text = "pose: &here\n  xyz: [0, 0, 0]\nrobots:\n  - room_from_robot: *here\n"
    assert line_of(text, ("robots", 0, "room_from_robot", "xyz")) == 2


@given(st.lists(st.text("ab_", min_size=1, max_size=3), unique=True, min_size=1, max_size=20))
def test_the_line_of_each_key_is_found(keys):
    text = "# head\n" + "".join(f"{key!r}:\n  - 1\n  - {{x: 2}}\n" for key in keys)
    for i, key in enumerate(keys):
        assert line_of(text, (key,)) == 3 * i + 2
        assert line_of(text, (key, 0)) == 3 * i + 3
        assert line_of(text, (key, 1, "x")) == 3 * i + 4
        assert line_of(text, (key, 1, "missing")) == 3 * i + 4


@pytest.mark.parametrize("value", [5, "iso", [1], None])
@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (("risk",), "expected a block of settings such as mode: ..., "),
        (("source",), "expected a block of settings: each as 'key: value' on a line"),
        (("robots", 0, "room_from_robot"), "expected a block of settings such as xyz: ..., "),
        (("robots", 0, "motion"), "expected a block of settings such as kind: ..., "),
        (("links",), "expected a list: an entry after each '- '"),
        (("people", "exits", 0), "expected a block of settings such as polygon: ..., "),
    ],
)
def test_what_is_no_block_or_list_is_told_what_belongs_there(tmp_path, keys, value, expected):
    if (keys[-1], value) in (("links", [1]), ("room_from_robot", None), ("motion", None)):
        pytest.skip("this value is told otherwise")
    data = at = yaml.safe_load(configuration.shipped("demo.yaml").read_text())
    for key in keys[:-1]:
        at = at[key]
    at[keys[-1]] = value
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError) as told:
        configuration.load(path)
    where = ".".join(map(str, keys))
    assert f"{where}: {expected}" in str(told.value)
    assert "dictionary" not in str(told.value)
