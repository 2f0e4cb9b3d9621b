"""What a robot, a zone, a tool, a link and a cell may be called: one rule, refused in one line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import MAX_NAME, MAX_NAME_BYTES, name_problem
from hri_predict.run import config

GOOD = ["arm", "Zelle 3 (neu)", "Roboter Süd", "机器人-1", "r.2_b", "हाथ", "a" * 64, "7"]
BAD = [
    "",
    " ",
    "a/b",
    "..",
    ".arm",
    "-arm",
    "arm ",
    "a\nb",
    "a\x1b[31m",
    "a\u202eb",
    "a#b",
    "a+b",
    "a*",
    "<b>",
    'a"b',
    "a{b}",
    "a" * 300,
    "机" * 60,
    "a\ud800",
]

CELL = """\
source:
  kind: procedural
  room_from_source: {{xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}}
  people: []
robots:
  - name: {robot}
    model: ur5e
    room_from_robot: {{xyz: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}}
    max_speed_m_s: 1.0
    tools:
      - name: {tool}
        payload_kg: 0
zones:
  - {{name: {zone}, polygon: [[0, 0], [1, 0], [0, 1]]}}
links:
  - {{name: {link}, kind: can, interface: virtual, channel: a}}
"""
LINES = {"robot": 6, "tool": 11, "zone": 14, "link": 16}
NAMED = {"robot": "arm", "tool": "gripper", "zone": "door", "link": "plc"}


@pytest.mark.parametrize("name", GOOD)
def test_names_of_every_language_are_allowed(name):
    assert name_problem(name) is None


@pytest.mark.parametrize("name", BAD)
def test_what_means_something_to_a_file_a_topic_or_a_page_is_refused(name):
    assert name_problem(name) is not None


@given(st.text(max_size=100))
def test_an_allowed_name_is_one_part_of_a_path_a_topic_and_a_key(name):
    if name_problem(name) is None:
        assert 0 < len(name) <= MAX_NAME
        assert len(name.encode()) <= MAX_NAME_BYTES
        assert not set(name) & set("/\\#+*?$:;,<>|\"'&%{}[]=~`!@^\0\n\r\t\x1b\x7f")
        assert name.isprintable()
        assert name.strip(" .") == name


def load(folder, file="cell.yaml", **names):
    path = folder / file
    quoted = {key: f'"{value}"' for key, value in (NAMED | names).items()}
    path.write_text(CELL.format(**quoted), encoding="utf-8")
    return path, config.load(path)


@pytest.mark.parametrize("what", NAMED)
@pytest.mark.parametrize("name", ["", "a/b", r"a\nb", r"a\u202eb", "x" * 300])
def test_every_name_of_a_cell_is_refused_with_file_and_line(tmp_path, what, name):
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, **{what: name})
    text = str(caught.value)
    assert text.startswith(f"{tmp_path}/cell.yaml:{LINES[what]}: ")
    assert "\n" not in text
    assert text.isprintable()


def test_a_cell_whose_file_has_another_name_says_so(tmp_path):
    load(tmp_path, "Zelle 3 (neu).yaml")
    wrong = r"the cell is named after its file, 'a#b', and a name has"
    with pytest.raises(ConfigError, match=wrong):
        load(tmp_path, "a#b.yaml")
