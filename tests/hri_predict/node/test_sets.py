"""Configuration sets in the node: which zones ask, how fast robots may be, and what stops them."""

import pytest

from hri_predict.contracts.link import Received
from hri_predict.protocol.messages import Level, NodeState, SetChoice
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.levels.set_chooser import STALE_S
from hri_predict.risk.sets import SetSettings, set_hash
from hri_sim.baseline_demo import baseline_demo
from tests.hri_predict.node.test_acknowledging import button

FAR = (4.0, 3.0)
AROUND = [[3.0, 2.0], [5.0, 2.0], [5.0, 4.0], [3.0, 4.0]]
ZONES = [NamedZoneSettings(name="gate", polygon=AROUND, level="stop")]
SETS = [
    SetSettings(number=1, name="run"),
    SetSettings(number=2, name="load", zones=[], max_speed_m_s=0.4),
    SetSettings(number=3, name="free", zones=[]),
]


@pytest.fixture
def cell(make_workcell):
    """A person who stands in the zone, far from the robot."""
    base = baseline_demo()
    risk = base.node.risk.model_copy(update={"sets": SETS})
    made = make_workcell(FAR, config=base.with_node(risk=risk, zones=ZONES))
    made.plc = button(made)
    return made


def choosing(cell, number, seconds):
    """Ticks of this time, in each of which the PLC chooses."""
    ticks = []
    for _ in range(round(seconds * 25)):
        cell.plc.inbox.append(Received(SetChoice(number), cell.clock.now_ns()))
        ticks += cell.run(0.04)
    return ticks


def test_nothing_moves_until_a_set_is_chosen_and_again_when_the_plc_falls_silent(cell):
    tick = cell.run(2.0)[-1]
    assert (tick.advices[0].level, tick.advices[0].reason) == (Level.UNKNOWN, Reason.SET_UNKNOWN)
    assert (tick.status.reason, tick.status.node_state) == (Reason.SET_UNKNOWN, NodeState.DEGRADED)
    assert (tick.status.set_number, tick.status.set_hash) == (0, 0)
    tick = choosing(cell, 3, 4.0)[-1]
    assert (tick.advices[0].level, tick.status.reason) == (Level.CLEAR, Reason.NONE)
    assert (tick.status.set_number, tick.status.set_hash) == (3, set_hash(SETS[2], ZONES))
    tick = cell.run(STALE_S + 0.1)[-1]
    assert (tick.advices[0].level, tick.advices[0].reason) == (Level.UNKNOWN, Reason.SET_UNKNOWN)
    assert tick.advices[0].speed_limit_m_s == 0.0


def test_an_unknown_number_stops_the_robot_in_the_next_tick(cell):
    choosing(cell, 3, 4.0)
    tick = choosing(cell, 9, 0.08)[-1]
    assert (tick.advices[0].level, tick.advices[0].reason) == (Level.UNKNOWN, Reason.SET_UNKNOWN)


def test_a_zone_asks_in_its_sets_alone(cell):
    choosing(cell, 3, 4.0)
    tick = choosing(cell, 1, 0.08)[-1]  # at once: it is stricter
    assert (tick.advices[0].level, tick.advices[0].reason) == (Level.STOP, Reason.ZONE_OCCUPIED)
    ticks = choosing(cell, 3, 3.0)
    assert {t.advices[0].level for t in ticks[:5]} == {Level.STOP}  # not at once
    assert ticks[-1].advices[0].level is Level.CLEAR
    assert ticks[-1].assessment.named_zones[0].occupied  # reported in any set


def test_a_set_limits_the_speed_at_once_and_not_the_level(cell):
    before = choosing(cell, 3, 4.0)[-1].advices[0]
    assert before.speed_limit_m_s > 0.4
    tick = choosing(cell, 2, 0.08)[-1]
    assert tick.advices[0].speed_limit_m_s == 0.4
    ticks = choosing(cell, 2, 1.0)
    assert {(t.advices[0].level, t.advices[0].speed_limit_m_s) for t in ticks} == {
        (Level.CLEAR, 0.4)
    }
    ticks = choosing(cell, 3, 2.0)
    assert {t.advices[0].speed_limit_m_s for t in ticks[:4]} == {0.4}
    assert ticks[-1].advices[0].speed_limit_m_s == before.speed_limit_m_s
    assert {t.advices[0].level for t in ticks} == {Level.CLEAR}
