"""Every level has a look of its own."""

from hri_predict.base.looks import LEVEL_COLOURS, LOOKS
from hri_predict.operation.monitoring.fleet_levels import GONE
from hri_predict.protocol.messages import LEVELS


def test_every_level_and_its_absence_has_a_look():
    assert set(LOOKS) == {level.name for level in LEVELS} | {GONE}
    assert set(LEVEL_COLOURS) == {level.name for level in LEVELS}


def test_a_level_is_known_by_its_colour_and_by_its_symbol():
    looks = LOOKS.values()
    assert len({look.colour for look in looks}) == len(LOOKS)
    assert len({(look.shape, look.sign) for look in looks}) == len(LOOKS)


def test_a_colour_in_numbers_is_the_same_colour():
    assert all("#{:02x}{:02x}{:02x}".format(*look.rgb) == look.colour for look in LOOKS.values())
