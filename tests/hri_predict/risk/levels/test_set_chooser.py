"""Configuration sets: the stricter at once, the milder when steady, and unknown ones stop."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.areas import NamedZoneSettings
from hri_predict.risk.levels.set_chooser import STALE_S, STEADY_S, InForce, SetChooser
from hri_predict.risk.sets import SetSettings, check_sets, set_hash

S = 1_000_000_000
SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
ZONES = [NamedZoneSettings(name=name, polygon=SQUARE) for name in ("gate", "table")]
SETS = [
    SetSettings(number=1, name="run"),
    SetSettings(number=2, name="load", zones=["table"], max_speed_m_s=0.5),
    SetSettings(number=3, name="clean", zones=[], max_speed_m_s=0.1),
]


class Plant:
    """A chooser; times in seconds."""

    def __init__(self, sets=SETS):
        self.chooser = SetChooser(sets, ZONES)

    def choose(self, number, at_s, link="plc"):
        self.chooser.choose(link, number, round(at_s * S))

    def at(self, at_s):
        return self.chooser.update(round(at_s * S))

    def steady(self, number, until_s, link="plc"):
        """Choose it ten times a second for longer than it takes."""
        for k in range(10):
            self.choose(number, until_s - 0.9 + 0.1 * k, link)
        return self.at(until_s)


@pytest.fixture
def plant():
    return Plant()


def test_without_sets_everything_is_in_force_and_nothing_is_shown():
    plant = Plant([])
    assert plant.at(1.0) == InForce()
    assert plant.chooser.shown is None
    plant.choose(7, 1.0)  # which nothing has
    assert plant.at(1.0).is_known
    assert plant.chooser.reasons == ()


def test_nothing_is_known_before_a_set_was_chosen_and_steady(plant):
    assert not plant.at(0.0).is_known
    assert plant.chooser.reasons == (Reason.SET_UNKNOWN,)
    assert plant.chooser.shown == (0, 0)
    plant.choose(2, 10.0)
    assert not plant.at(10.0 + STEADY_S - 0.01).is_known
    plant.choose(2, 10.1)
    found = plant.at(10.0 + STEADY_S)
    assert (found.number, found.zones, found.max_speed_m_s) == (2, frozenset({"table"}), 0.5)
    assert plant.chooser.shown == (2, set_hash(SETS[1], ZONES))


def test_the_stricter_holds_at_once_and_the_milder_when_steady(plant):
    assert plant.steady(1, 5.0).max_speed_m_s == math.inf
    plant.choose(3, 5.01)
    both = plant.at(5.02)
    assert (both.number, both.zones, both.max_speed_m_s) == (0, None, 0.1)  # zones of set 1
    plant.choose(3, 5.15)
    assert plant.at(5.20).zones is None
    alone = plant.at(5.22)
    assert (alone.number, alone.zones) == (3, frozenset())
    plant.choose(1, 5.3)  # and back: milder in speed, stricter in zones
    both = plant.at(5.3)
    assert (both.zones, both.max_speed_m_s) == (None, 0.1)
    plant.choose(1, 5.4)
    assert plant.at(5.51).max_speed_m_s == math.inf


def test_numbers_that_a_switch_passes_through_hold_together_until_it_rests(plant):
    plant.steady(1, 5.0)
    for k, number in enumerate((2, 3, 2)):
        plant.choose(number, 5.0 + 0.1 * k)
        assert plant.at(5.0 + 0.1 * k).number == 0
    plant.choose(2, 5.35)
    assert plant.at(5.39).max_speed_m_s == 0.1
    assert plant.at(5.41).number == 2


def test_a_number_that_came_and_went_between_two_ticks_holds_too(plant):
    """Two PLCs on one link may write so that each tick finds the same of their numbers last."""
    plant.steady(1, 5.0)
    for k in range(1, 20):
        plant.choose(3, 5.0 + 0.04 * k)
        plant.choose(1, 5.001 + 0.04 * k)
        found = plant.at(5.002 + 0.04 * k)
        assert (found.number, found.zones, found.max_speed_m_s) == (0, None, 0.1)
    plant.choose(4, 6.0)  # no set has it
    plant.choose(1, 6.001)
    assert not plant.at(6.002).is_known
    plant.choose(1, 6.2)
    assert plant.at(6.21).number == 1


@pytest.mark.parametrize("number", [0, 4, 65_535])
def test_a_number_that_no_set_has_is_unknown_at_once_and_for_a_while_after(plant, number):
    plant.steady(1, 5.0)
    plant.choose(number, 5.05)
    assert not plant.at(5.05).is_known
    plant.choose(1, 5.10)
    assert not plant.at(5.15).is_known
    plant.choose(1, 5.25)
    assert plant.at(5.31).number == 1


def test_a_plc_that_falls_silent_has_chosen_nothing(plant):
    plant.steady(2, 5.0)
    assert plant.at(5.0 + STALE_S - 0.01).number == 2
    assert not plant.at(5.0 + STALE_S + 0.01).is_known
    plant.choose(2, 8.0)  # its time begins again
    assert not plant.at(8.0).is_known
    plant.choose(2, 8.3)
    assert plant.at(8.3).number == 2


def test_two_plcs_that_differ_have_the_stricter_of_each_and_both_must_speak(plant):
    plant.steady(2, 5.0)
    plant.steady(3, 5.0, link="other")
    found = plant.at(5.0)
    assert (found.number, found.zones, found.max_speed_m_s) == (0, frozenset({"table"}), 0.1)
    assert not plant.steady(2, 7.0).is_known  # the other one is silent


def test_the_hash_changes_with_everything_that_the_set_puts_in_force():
    moved = [ZONES[0], ZONES[1].model_copy(update={"z_max": 1.0})]
    hashes = [set_hash(SETS[1], ZONES), set_hash(SETS[1], moved), set_hash(SETS[0], ZONES)]
    hashes.append(set_hash(SETS[1].model_copy(update={"max_speed_m_s": 0.51}), ZONES))
    assert len(set(hashes)) == 4
    other = [ZONES[0].model_copy(update={"z_max": 1.0}), ZONES[1]]  # not in force
    assert set_hash(SETS[1], other) == hashes[0]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"number": 1}, "two sets have the number 1"),
        ({"name": "run"}, "two sets have the name run"),
        ({"zones": ["gat"]}, "unknown zone 'gat'.*gate"),
        ({"zones": ["gate", "gate"]}, "names zone 'gate' twice"),
        ({"max_speed_m_s": 0.01}, "0.01 is below risk.min_speed_m_s 0.05, which means stop"),
        ({"max_speed_m_s": 1.01}, "limits no robot, as none is faster than 1 m/s"),
    ],
)
def test_mistakes_are_said_in_one_line(changes, says):
    sets = [SETS[0], SETS[1].model_copy(update=changes)]
    with pytest.raises(ConfigError, match=says):
        check_sets(sets, ZONES, min_speed_m_s=0.05, max_speeds_m_s=[0.6, 1.0])


def test_the_speeds_of_the_robots_are_limits_that_a_set_may_have():
    for speed_m_s in (0.05, 1.0, None):
        sets = [SETS[0].model_copy(update={"max_speed_m_s": speed_m_s})]
        check_sets(sets, ZONES, min_speed_m_s=0.05, max_speeds_m_s=[0.6, 1.0])


@given(
    st.lists(
        st.tuples(st.floats(0.0, 0.4), st.integers(0, 4), st.sampled_from(["a", "b"])), max_size=40
    )
)
def test_it_is_never_milder_than_what_any_plc_asks_now(events):
    plant, at_s, asked = Plant(), 10.0, {}
    known = {each.number: each for each in SETS}
    for pause_s, number, link in events:
        at_s += pause_s
        plant.choose(number, at_s, link)
        asked[link] = number
        found = plant.at(at_s)
        if not found.is_known:
            continue
        for each in asked.values():
            chosen = known[each]  # an unknown number is never in force
            assert found.max_speed_m_s <= (chosen.max_speed_m_s or math.inf)
            assert all(found.asks(z.name) for z in ZONES if chosen.zones in (None, [z.name]))
