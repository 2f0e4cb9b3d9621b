"""An advisor says what the node would, and is as suspicious."""

import numpy as np
import pytest

import hri_predict
from hri_predict import Acknowledge, Advisor, Level, Person, Reason, Scene
from hri_predict.base.errors import ConfigError
from hri_predict.library.advisor import RUN
from hri_sim.people.body import Body
from tests.messages import make_state

MS = 1_000_000
BODY = Body(1.75)
CONFIG = hri_predict.load_config("demo.yaml").with_predictor("constant_velocity", horizon_s=1.2)


class Cell:
    """A caller: steps time by 40 ms, with the person standing at ``place`` (None: nobody)."""

    def __init__(self, config=CONFIG):
        self.advisor = Advisor(config)
        self.now = self.counter = 0

    def step(self, place, times=1, states=True, late=0):
        """Scenes captured 40 ms apart; each arrives ``late`` ns after its capture."""
        for _ in range(times):
            self.now += 40 * MS
            self.counter += 1
            people: tuple[Person, ...] = ()
            if place is not None:
                joints = BODY.joints(BODY.standing(np.array(place), 0.0))
                people = (Person(1, joints, np.ones(21, bool)),)
            state = make_state(
                (0.0, -1.57, 1.57, -1.57, -1.57, 0.0), (0.0,) * 6, counter=self.counter
            )
            scene = Scene(self.now, self.counter, True, people)
            tick = self.advisor.advise(scene, [state] if states else [], now_ns=self.now + late)
        return tick


def test_near_is_stop_and_an_empty_room_becomes_clear():
    cell = Cell()
    near = cell.step([0.6, 0.0])
    assert near.advices[0].level is Level.STOP
    assert near.advices[0].reason is Reason.PERSON_NEAR
    assert near.advices[0].body_part is not None
    assert near.advices[0].body_part < len(cell.advisor.segments)
    assert near.assessment is not None
    assert near.assessment.zones.ids == (1,)
    assert cell.advisor.robots == ("arm",)
    assert Cell().step(None, times=100).advices[0].level is Level.CLEAR


def test_without_a_robot_state_the_advice_is_unknown():
    tick = Cell().step(None, times=3, states=False)
    assert tick.advices[0].level is Level.UNKNOWN
    assert tick.advices[0].reason is Reason.ROBOT_STATE_STALE


def test_no_scene_lets_the_input_age():
    cell = Cell()
    cell.step(None, times=50)
    late = cell.advisor.advise(None, now_ns=cell.now + 1000 * MS)
    assert late.advices[0].level is Level.UNKNOWN


def test_scenes_that_come_late_are_never_clear():
    cell = Cell()
    assert cell.step(None, times=100).advices[0].level is Level.CLEAR
    late = cell.step(None, times=10, late=1000 * MS)
    assert late.advices[0].level is Level.UNKNOWN


@pytest.mark.parametrize("back", [0, 1, 1000 * MS])
def test_a_clock_that_does_not_advance_is_refused(back):
    cell = Cell()
    cell.step(None, times=3)
    with pytest.raises(ConfigError, match="give a monotonic clock"):
        cell.advisor.advise(None, now_ns=cell.now - back)


@pytest.mark.parametrize("now", [100.5, float("nan"), np.float64(1e9), None, "100"])
def test_a_clock_in_seconds_is_refused(now):
    cell = Cell()
    cell.step(None, times=3)
    with pytest.raises(ConfigError, match="must be a whole number of nanoseconds"):
        cell.advisor.advise(None, now_ns=now)
    cell.step(None)  # the refused time has not replaced the last one
    with pytest.raises(ConfigError, match="give a monotonic clock"):
        cell.advisor.advise(None, now_ns=cell.now)
    with pytest.raises(ConfigError, match="start_ns"):
        Advisor(CONFIG, start_ns=now)


@pytest.mark.parametrize("per_second", [1_000, 1_000_000])
def test_a_clock_in_milliseconds_or_microseconds_is_refused_within_30_scenes(per_second):
    advisor = Advisor(CONFIG, rate_hz=30.0)
    scenes = [Scene(100 * per_second + k * per_second // 25, k, True, ()) for k in range(RUN + 5)]
    for scene in scenes[:RUN]:
        advisor.advise(scene, now_ns=scene.stamp_ns)
    for scene in scenes[RUN:]:
        with pytest.raises(ConfigError, match=r"now_ns is in nanoseconds.*time\.monotonic_ns"):
            advisor.advise(scene, now_ns=scene.stamp_ns)


def test_a_backlog_of_scenes_is_no_wrong_unit():
    advisor = Advisor(CONFIG, rate_hz=30.0)
    for k in range(100):
        advisor.advise(Scene((k + 1) * 33 * MS, k, True, ()), now_ns=5000 * MS + k * MS)


def test_somebody_who_vanishes_is_lost_until_he_is_acknowledged():
    cell = Cell()
    cell.step([0.6, 0.0], times=5)
    assert cell.step(None, times=5).advices[0].level is not Level.CLEAR
    cell.now += 5000 * MS  # long enough for an operator to mean it
    tick = cell.step(None)
    assert [person.id for person in tick.snapshot.lost] == [1]
    shown = tick.advices[0].latch_id
    cell.now += 12_000 * MS  # the pause before a press
    cell.advisor.advise(None, [Acknowledge(0, 1)], now_ns=cell.now + MS)
    assert cell.step(None).snapshot.lost  # 0 acknowledges nothing
    cell.now += 12_000 * MS
    cell.advisor.advise(None, [Acknowledge(shown, 2)], now_ns=cell.now + MS)
    assert cell.step(None).snapshot.lost == ()


def test_mistakes_are_one_line():
    with pytest.raises(ConfigError, match="rate_hz 0: must be"):
        Advisor(CONFIG, rate_hz=0.0)
    with pytest.raises(ConfigError, match="no such file"):
        hri_predict.load_config("nothing.yaml")
