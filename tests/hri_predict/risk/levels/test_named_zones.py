import pytest

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.levels.advice import zone_demand
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.types import NamedZoneState

SQUARE = [[1.0, -1.0], [3.0, -1.0], [3.0, 1.0], [1.0, 1.0]]


def asked(state: NamedZoneState, **settings) -> Demand:
    zone = NamedZoneSettings.model_validate({"name": "door", "polygon": SQUARE, **settings})
    return zone_demand(zone, state, "arm", 1.0)


@pytest.mark.parametrize(
    ("level", "expected", "limit"),
    [
        ("none", Level.CLEAR, 1.0),
        ("warn", Level.WARN, 1.0),
        ("slow", Level.SLOW, 0.25),
        ("stop", Level.STOP, 0.0),
    ],
)
def test_what_an_occupied_zone_asks(level, expected, limit):
    demand = asked(NamedZoneState("door", True, 0.0), level=level)
    assert (demand.level, demand.limit_m_s) == (expected, limit)
    assert demand.reason is (Reason.NONE if level == "none" else Reason.ZONE_OCCUPIED)


def test_entry_asks_only_where_configured():
    soon = NamedZoneState("door", False, 0.3)
    assert asked(soon, level="stop").level is Level.CLEAR
    early = asked(soon, level="stop", entry_warning_s=0.4)
    assert (early.level, early.reason) == (Level.STOP, Reason.ZONE_ENTRY_PREDICTED)
    later = NamedZoneState("door", False, 0.5)
    assert asked(later, level="stop", entry_warning_s=0.4).level is Level.CLEAR


def test_a_zone_asks_only_its_robots():
    occupied = NamedZoneState("door", True, 0.0)
    assert asked(occupied, robots=["other"]).level is Level.CLEAR
    assert asked(occupied, robots=["arm"]).level is Level.WARN
