"""The unit of a setting, and the hint that a number in another unit gets."""

import pytest
from pydantic import Field

from hri_predict.base.errors import ConfigError
from hri_predict.base.quantities.units import meant, unit_at, unit_of
from hri_predict.base.settings import Pose, Region, Settings, validated


@pytest.mark.parametrize(
    ("value", "unit", "hint"),
    [
        (800, "m", "metres are meant: 0.8?"),
        (-24000, "m", "metres are meant: -24?"),
        (1500, "m/s", "metres per second are meant: 1.5?"),
        (90, "rad", "radians are meant: 1.571?"),
        (180, "rad/s", "radians per second are meant: 3.142?"),
        (5000, "kg", "kilograms are meant: 5?"),
        (150, "s", "seconds are meant: 0.15?"),
        (1e9, "m", "metres are meant"),
        (float("nan"), "m", "metres are meant"),
        (3, "Hz", ""),
    ],
)
def test_the_number_in_the_right_unit_is_proposed(value, unit, hint):
    assert meant(value, unit) == hint


def test_the_unit_stands_in_the_name_or_at_the_end_of_the_description():
    assert unit_of("max_speed_m_s") == "m/s"
    assert unit_at("xyz", "position of its origin, m") == "m"
    assert unit_at("b", "the other end, m; the same point makes a sphere") == "m"
    assert unit_at("size", "how many") == ""


class Cell(Settings):
    pose: Pose = Pose()
    height_m: float = Field(1.0, ge=0, le=10, description="of a shelf")
    yaw: float = Field(0.0, ge=-7, le=7, description="of a shelf")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"pose": {"xyz": [0, 800, 0]}}, r"pose\.xyz\.1: .*got 800 .*; metres are meant: 0\.8\?"),
        ({"pose": {"xyz": [-800, 0, 0]}}, r"pose\.xyz\.0: .*got -800 .*metres are meant: -0\.8\?"),
        ({"height_m": 1200}, r"height_m: .*got 1200 \(of a shelf, m\); metres are meant: 1\.2\?"),
        ({"yaw": -90}, r"yaw: .*got -90 .*radians are meant: -1\.571\?"),
    ],
)
def test_a_value_in_another_unit_names_field_value_and_unit(data, said):
    with pytest.raises(ConfigError, match=said):
        validated(Cell, data, "cell.yaml")


def test_a_value_that_is_merely_too_small_has_no_hint():
    with pytest.raises(ConfigError) as caught:
        validated(Cell, {"height_m": -1}, "cell.yaml")
    assert "meant" not in str(caught.value)


def test_polygons_and_heights_in_millimetres_are_refused():
    square = [[0, 0], [24000, 0], [24000, 8600], [0, 8600]]
    with pytest.raises(ConfigError, match=r"polygon\.1\.0: .*metres are meant: 24\?"):
        validated(Region, {"polygon": square}, "exit")
    small = [[0, 0], [2, 0], [2, 2]]
    with pytest.raises(ConfigError, match=r"z_max: .*metres are meant: 2\.5\?"):
        validated(Region, {"polygon": small, "z_max": 2500}, "exit")
