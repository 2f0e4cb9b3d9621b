"""The pages' own tables of levels agree with the node's."""

import re
from importlib import resources

from hri_predict.operation.monitoring.fleet_levels import WORST_FIRST
from hri_predict.protocol.messages import LEVELS, Level

_FILES = resources.files("hri_predict.viewing.operator")
COMMON = (_FILES / "common.js").read_text(encoding="utf-8")
FLEET = (_FILES / "fleet.js").read_text(encoding="utf-8")
STYLES = (_FILES / "common.css").read_text(encoding="utf-8")


def listed(name: str, script: str) -> list[str]:
    """Names in the list ``name`` of a script."""
    found = re.search(rf"const {name} = \[(.*?)\];", script, re.DOTALL)
    assert found is not None
    return re.findall(r'"(\w+)"', found[1])


def keys(name: str, script: str) -> set[str]:
    """Keys of the table ``name`` of a script."""
    found = re.search(rf"const {name} = {{(.*?)}};", script, re.DOTALL)
    assert found is not None
    return set(re.findall(r"(\w+): ", found[1]))


def test_the_page_of_cells_puts_the_most_urgent_first() -> None:
    assert listed("ORDER", FLEET) == WORST_FIRST


def test_every_level_has_a_shape_a_sign_and_a_colour() -> None:
    assert keys("SHAPES", COMMON) == keys("SIGNS", COMMON) == set(WORST_FIRST)
    assert all(f".{name}" in STYLES and f"li.{name}" in STYLES for name in WORST_FIRST)


def test_the_page_explains_every_level_that_slows_a_robot() -> None:
    slowed = [level.name for level in LEVELS if level.rank >= Level.SLOW.rank]
    assert listed("SLOWED", COMMON) == slowed
