"""Named zones in the engine: who occupies them, and what the advice says of them."""

import numpy as np

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.sets import SetSettings
from tests.hri_predict.risk.engine_cell import SETTINGS, TICK_NS, Cell


def test_a_zone_is_occupied_by_who_may_have_come_since_the_newest_scenes_lack_them():
    stop = NamedZoneSettings(name="press", polygon=[[4, -2], [6, -2], [6, 2], [4, 2]], level="stop")
    cell = Cell(SETTINGS.model_copy(update={"mode": "iso"}), zones=(stop,))
    assert cell.settle(6.6).level is Level.CLEAR
    late = np.array([cell.now_ns + TICK_NS - 450_000_000])  # 0.33 s beyond stale: 0.53 m
    advice = cell.step(6.6, capture_ns=late)
    assert (advice.level, advice.reason) == (Level.STOP, Reason.ZONE_OCCUPIED)
    assert cell.assessment.named_zones[0].occupied


def test_the_detail_names_only_zones_that_ask():
    def zone(name, level, robots=None):
        corners = [[5, -2], [7, -2], [7, 2], [5, 2]]
        return NamedZoneSettings(name=name, polygon=corners, level=level, robots=robots)

    chosen = SETTINGS.model_copy(
        update={"mode": "iso", "sets": [SetSettings(number=1, name="day", zones=["lane", "press"])]}
    )
    zones = (zone("counter", "none"), zone("night", "stop"), zone("lane", "slow"))
    cell = Cell(chosen, zones=(*zones, zone("press", "none")))
    for _ in range(40):
        cell.engine.choose_set("plc", 1, cell.now_ns + TICK_NS)
        advice = cell.step(6.0)
    assert (advice.level, advice.reason) == (Level.SLOW, Reason.ZONE_OCCUPIED)
    assert "zone lane;" in advice.detail
    assert not any(name in advice.detail for name in ("counter", "night", "press"))
