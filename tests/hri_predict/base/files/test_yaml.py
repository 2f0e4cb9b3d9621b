"""What PyYAML's safe loader would let pass is refused, with the place."""

import pytest
import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import MAX_CHARACTERS, load_yaml, read_yaml
from hri_predict.base.settings import Settings, validated


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: 2\na: 3\n", r"line 3, column 1 \(key 'a' is already in line 1\)"),
        ("x:\n  - {m: iso, m: predictive}\n", r"line 2.*key 'm' is already in line 2"),
        ("a: 2001-13-45", "'2001-13-45' is not a valid timestamp"),
        ("a: 0x_", "not a valid int"),
        ("a: " + "9" * 5000, "a value of more than 2000 characters"),
        ("a: !!int x", "not a valid int"),
        ("a: !!float x", "not a valid float"),
        ("a: !!bool 3", "not a valid bool"),
        ("a: !!timestamp 3", "not a valid timestamp"),
        ("a: " + "x" * 2001, "a value of more than 2000 characters"),
        ("x" * 2001 + ": 1", "line 1, column 1.*more than 2000 characters|not valid YAML"),
        ('a: 1\nb: "x\\0y"', r"line 2, column 4 \('x\\x00y' contains a control character"),
        ('a: "\\e[31m"', "contains a control character"),
        ("a: &a [*a]", "an alias refers to a value that contains it"),
    ],
)
def test_mistakes_name_the_place(tmp_path, text, said):
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=said) as caught:
        read_yaml(path, "configuration")
    assert "\n" not in str(caught.value)


def test_aliases_that_grow_without_bound_are_refused():
    levels = ["q0: &q0 [x, x, x, x, x, x, x, x, x]"]
    levels += [f"q{i}: &q{i} [{', '.join([f'*q{i - 1}'] * 9)}]" for i in range(1, 9)]
    with pytest.raises(yaml.YAMLError, match="more than 100000 values"):
        load_yaml("\n".join(levels))


def test_aliases_and_merged_keys_that_are_overridden_are_fine():
    data = load_yaml("base: &b {x: 1, y: 2}\nmine: {<<: *b, y: 3}\nsame: *b\n")
    assert data["mine"] == {"x": 1, "y": 3}
    assert data["same"] == {"x": 1, "y": 2}


def test_a_file_without_end_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text("#" * (MAX_CHARACTERS + 1))
    with pytest.raises(ConfigError, match="longer than"):
        read_yaml(path, "configuration")


class One(Settings):
    x: float


@pytest.mark.parametrize(
    "value",
    [int("f" * 5000, 16), [[["deep"] * 99] * 99] * 99, "y" * 10_000],
    ids=["number", "lists", "text"],
)
def test_an_echoed_value_is_short(value):
    with pytest.raises(ConfigError) as caught:
        validated(One, {"x": value}, "cell.yaml")
    assert len(str(caught.value)) < 200


def test_what_a_reader_changes_nobody_else_reads():
    load_yaml("a: [1]")["a"].append(2)
    assert load_yaml("a: [1]") == {"a": [1]}


@pytest.mark.parametrize(
    "text",
    [
        "bitrate: 0500000", "a: [1, 025]", "a: -010", "{vid: 0403, pid: 6001}", "a: 0980", "a: 00",
        "a: 01.5", "a: 007e1", "08: x", "a: !!int '010'",
    ],
)  # fmt: skip
def test_a_number_that_begins_with_a_zero_is_refused(text):
    with pytest.raises(yaml.YAMLError, match=r"starts with a zero.*0x.*quotes"):
        load_yaml(text)


@pytest.mark.parametrize("text", ["rate_hz: 1:00", "a: [12:30:45]", "a: 1:30.5", "a: -2:00"])
def test_a_number_with_a_colon_is_refused(text):
    with pytest.raises(yaml.YAMLError, match=r"has a colon.*quote"):
        load_yaml(text)


@pytest.mark.parametrize("text", ["bitrate: 500_000", "a: 1_0.5", "a: 0x1_0"])
def test_a_number_with_an_underscore_is_refused(text):
    with pytest.raises(yaml.YAMLError, match="has an underscore"):
        load_yaml(text)


def test_numbers_and_texts_that_mean_what_they_say_are_read():
    data = load_yaml(
        "[0, -0, 0.5, +0.25, 0x0403, 1.0e+3, '0403', '1:00', '1_0', a_b, 0x_y, 00:1a, v0.1, "
        "10.0.0.1]"
    )
    assert data[:6] == [0, 0, 0.5, 0.25, 0x403, 1000.0]
    assert data[6:] == [
        "0403", "1:00", "1_0", "a_b", "0x_y", "00:1a", "v0.1", "10.0.0.1",
    ]  # fmt: skip


def test_the_file_and_the_line_are_named(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text("a: 1\nlinks:\n  - {name: plc, bitrate: 0500000}\n")
    with pytest.raises(
        ConfigError, match=r"cell.yaml: not valid YAML at line 3, column 26 \('0500"
    ):
        read_yaml(path, "configuration")


@pytest.mark.parametrize("text", ["no", "on", "12", "2026-01-01"])
def test_text_that_yaml_does_not_read_as_text_has_a_remedy(text):
    with pytest.raises(ConfigError, match="text: input should be a valid string, so put it in quo"):
        validated(Text, load_yaml(f"text: {text}"), "")


class Text(Settings):
    text: str
