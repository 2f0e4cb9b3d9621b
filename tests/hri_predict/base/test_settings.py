from typing import Literal

import numpy as np
import pytest
from pydantic import Field

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import load_yaml, read_yaml
from hri_predict.base.geometry import transform
from hri_predict.base.set_key import set_key
from hri_predict.base.settings import Pose, Region, Settings, Vector3, validated


class Inner(Settings):
    speed: float = Field(1.0, gt=0)


class Outer(Settings):
    name: str
    inner: Inner = Inner()
    several: list[Inner] = []


def test_misspelt_key_names_the_path_and_the_nearest():
    with pytest.raises(ConfigError, match=r"cell.yaml: inner.sped: unknown key; .*'speed'"):
        validated(Outer, {"name": "a", "inner": {"sped": 2}}, "cell.yaml")


def test_misspelt_key_in_a_list_names_the_nearest():
    with pytest.raises(ConfigError, match=r"several.1.spede: unknown key; did you mean 'speed'"):
        validated(Outer, {"name": "a", "several": [{}, {"spede": 2}]}, "x")


class Choice(Settings):
    mode: Literal["predictive", "iso"] = "iso"


def test_misspelt_choice_names_the_nearest():
    said = r"mode: input should be .*; did you mean 'predictive'"
    with pytest.raises(ConfigError, match=said):
        validated(Choice, {"mode": "predictve"}, "x")


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("rpy", "quaternion_xyzw"),
        ("yaw", "quaternion_xyzw"),
        ("Rotation", "quaternion_xyzw"),
        ("origin", "xyz"),
    ],
)
def test_other_programs_words_name_ours(theirs, ours):
    with pytest.raises(ConfigError, match=rf"{theirs}: unknown key; did you mean '{ours}'"):
        validated(Pose, {theirs: [0, 0, 1]}, "x")


@pytest.mark.parametrize("index", ["1", "x", "9" * 5000])
def test_an_entry_that_a_list_does_not_have_is_refused(index):
    data = {"several": [{"speed": 1}]}
    set_key(data, "several.0.speed=2")
    assert data == {"several": [{"speed": 2}]}
    with pytest.raises(ConfigError, match="'several' is a list and has entries 0 to 0"):
        set_key(data, f"several.{index}.speed=2")
    with pytest.raises(ConfigError, match="'several' is a list and has entries 0 to 0"):
        set_key(data, f"several.{index}=2")


def test_an_entry_of_a_list_is_set_whatever_it_is():
    data = {"pose": {"xyz": [0, 0.0, None]}, "names": ["a"]}
    for change in ("pose.xyz.0=1", "pose.xyz.2=1.9", "names.0=b"):
        set_key(data, change)
    assert data == {"pose": {"xyz": [1, 0.0, 1.9]}, "names": ["b"]}
    with pytest.raises(ConfigError, match="'links' is a list and has no entries yet"):
        set_key(data, "links.0.speed=2")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({}, "name: required key is missing"),
        ({"name": "a", "inner": {"speed": 0}}, "inner.speed: input should be greater than 0"),
        ({"name": "a", "inner": {"speed": "fast"}}, "inner.speed: .*number.*'fast'"),
        ({"name": "a", "inner": {"speed": float("nan")}}, "inner.speed: .*finite"),
        ({"name": [1]}, "name: .*string"),
        ([], "x: "),
    ],
)
def test_mistakes_are_one_line_with_the_key(data, said):
    with pytest.raises(ConfigError, match=said) as caught:
        validated(Outer, data, "x")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"a: [1", "not valid YAML at line 1"),
        (b"- 1\n- 2\n", "expected keys and values, found list"),
        (b"\xff\xfe\x00", "cannot be read: it is not UTF-8|not valid YAML"),
        (b"", "expected keys and values, found nothing"),
        (b"a: \x07", "not valid YAML"),
    ],
)
def test_bad_yaml_is_a_clear_error(tmp_path, text, said):
    path = tmp_path / "x.yaml"
    path.write_bytes(text)
    with pytest.raises(ConfigError, match=said):
        read_yaml(path, "configuration")


def test_missing_file_is_a_clear_error(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        read_yaml(tmp_path / "none.yaml", "configuration")


def test_pose_turns_and_moves():
    half = 0.5**0.5
    pose = Pose(xyz=[1, 2, 3], quaternion_xyzw=[0, 0, half, half])  # 90 degrees about z
    x, y, z = transform(pose.matrix(), np.array([1.0, 0.0, 0.0]))
    assert (round(x, 9), round(y, 9), round(z, 9)) == (1, 3, 3)


def test_pose_refuses_what_is_not_a_rotation():
    with pytest.raises(ConfigError, match="unit quaternion"):
        validated(Pose, {"quaternion_xyzw": [0, 0, 0, 0]}, "pose")


@pytest.mark.parametrize(
    "data",
    [
        {"polygon": [[0, 0], [1, 0], [2, 0]]},
        {"polygon": [[0, 0], [1, 0]]},
        {"polygon": [[0, 0], [1, 0], [1, 1]], "z_min": 2, "z_max": 1},
    ],
)
def test_region_without_volume_is_refused(data):
    with pytest.raises(ConfigError):
        validated(Region, data, "zones.0")


@pytest.mark.parametrize(
    ("model", "data"),
    [
        (Pose, {"xyz": [1e300, 0, 0]}),
        (Pose, {"quaternion_xyzw": [1e300, 0, 0, 1]}),
        (Region, {"polygon": [[0, 0], [1e200, 0], [0, 1e200]]}),
        (Region, {"polygon": [[0, 0], [1, 0], [1, 1]], "z_max": 1001}),
    ],
)
def test_coordinates_beyond_a_kilometre_are_refused(model, data, recwarn):
    with pytest.raises(ConfigError):
        validated(model, data, "x")
    assert not recwarn.list


@pytest.mark.parametrize(
    ("corners", "fine"),
    [
        ([[0, -2], [3, 2], [3, -2], [0, 2.2]], False),  # drawn across: hides nobody in the middle
        ([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], True),
        ([[0, 2], [1, 2], [1, 1], [2, 1], [2, 0], [0, 0]], True),
    ],
)
def test_a_polygon_that_crosses_itself_is_refused(corners, fine):
    if fine:
        Region(polygon=corners)
        return
    with pytest.raises(ConfigError, match="crosses itself"):
        validated(Region, {"polygon": corners}, "here")


class Numbers(Settings):
    count: int = 1
    share: float | None = None
    place: Vector3 = [0.0, 0.0, 0.0]
    margins: dict[str, float] = {}
    active: bool = False
    flags: list[bool] = []


@pytest.mark.parametrize(
    "text",
    ["count: yes", "share: true", "share: off", "place: [0, 0, no]", "margins: {head: true}"],
)
def test_truth_is_no_number(text):
    key = text.split(":")[0]
    with pytest.raises(ConfigError, match=f"here: {key}: true and false .* are not numbers"):
        validated(Numbers, load_yaml(text), "here")


def test_truth_is_truth():
    found = validated(Numbers, load_yaml("{active: yes, flags: [true, no], count: 3}"), "here")
    assert (found.active, found.flags, found.count) == (True, [True, False], 3)
