"""The pages show levels by the node's own table."""

import json

from hri_predict.operation.monitoring.fleet_levels import WORST_FIRST
from hri_predict.protocol.messages import LEVELS, Level
from hri_predict.viewing.operator.server import looks_script, looks_style

TABLE = json.loads(looks_script().partition("= ")[2].rstrip(";\n"))


def test_the_page_of_cells_puts_the_most_urgent_first() -> None:
    assert list(TABLE) == WORST_FIRST


def test_every_level_has_a_symbol_a_word_and_colours() -> None:
    assert all(look["shape"] and look["sign"] and look["word"] for look in TABLE.values())
    assert all(f".{name} {{ --field: #" in looks_style() for name in WORST_FIRST)


def test_the_page_explains_every_level_that_slows_a_robot() -> None:
    slowed = {level.name for level in LEVELS if level.rank >= Level.SLOW.rank}
    assert {name for name, look in TABLE.items() if look["slows"]} == slowed
