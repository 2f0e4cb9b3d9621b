"""A floor that is not where it was: found where people stand, and never taken for a box."""

from dataclasses import replace
from itertools import repeat

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Doubt, Person
from hri_predict.people.body.floor_watch import FIRST, LEARNT, NEWEST, FloorWatch
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_sim.people.body import Body as Figure
from tests.hri_predict.people.body.posture_table import RATE_HZ, recordings
from tests.shared import DATA

FIGURE = Figure(1.75)
SPOTS = [(0.0, 0.0), (2.0, 0.0), (0.5, 1.8), (2.5, 2.0)]
ALL = np.ones(len(JOINTS), np.bool_)
AHEAD = np.array([1.0, 0.0, 0.0])
STANDS = FIGURE.standing(np.zeros(2), 0.3)


def up_by(metres):
    return np.array([0.0, 0.0, metres])


class Cell:
    """A watch that sees one person after another, ten times a second."""

    def __init__(self, **people):
        self.watch = FloorWatch(PeopleSettings(**people))
        self.now_ns = self.person = 0

    def stand(self, spot, seconds, *, moved=None, stance=STANDS, figure=FIGURE, error_m=0.0):
        """Show a person at a spot; ``moved`` is what the sensor's motion makes of their joints."""
        self.person += 1
        joints = figure.joints(stance) + np.array([*spot, 0.0])
        joints = joints if moved is None else moved(joints)
        for _ in range(11 * seconds):
            self.now_ns += 100_000_000
            self.watch.note(Body(self.person, joints, ALL, error_m=error_m), self.now_ns)
        return self

    def learn(self, spots=SPOTS):
        for spot in spots:
            self.stand(spot, FIRST)
        return self

    def visit(self, spots=SPOTS, metres=0.0, **more):
        for spot in spots:
            self.stand(spot, NEWEST, moved=lambda joints: joints + up_by(metres), **more)
        return self

    @property
    def says(self):
        return [doubt.text for doubt in self.watch.doubts()]


@pytest.mark.parametrize(("error_m", "places"), [(0.15, 0), (0.14, 4)])
def test_a_person_whose_place_is_stated_to_the_limit_says_nothing(error_m, places):
    cell = Cell()
    for spot in SPOTS:
        cell.stand(spot, FIRST, error_m=error_m)
    assert len(cell.watch._places) == places


@pytest.mark.parametrize(("metres", "said"), [(0.2, "20 cm higher"), (-0.2, "20 cm lower")])
def test_a_sensor_that_sank_or_rose_is_found_at_the_third_place(metres, said):
    cell = Cell().learn().visit()
    for spot in SPOTS[:2]:
        assert cell.visit([spot], metres).says == []
    cell.visit(SPOTS[2:3], metres)
    assert cell.watch.doubts()[0].reason is Reason.SENSOR_MOVED
    assert said in cell.says[0]


def test_a_sensor_that_tilted_by_five_degrees_is_found():
    angle, camera = np.radians(5.0), np.array([1.0, -3.0, 1.5])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    cell = Cell().learn()
    for spot in SPOTS:
        cell.stand(spot, NEWEST, moved=lambda joints: (joints - camera) @ turn.T + camera)
    assert "higher" in cell.says[0]


def test_a_slow_drift_is_found_when_it_is_as_large():
    cell = Cell().learn()
    for metres in np.arange(0.0, 0.15, 0.02):
        assert cell.visit(metres=metres).says == []
    assert cell.visit(metres=0.17).says


def test_it_is_over_when_every_place_agrees_again():
    cell = Cell().learn().visit(metres=0.2)
    for spot in SPOTS[:-1]:
        assert cell.visit([spot]).says
    assert cell.visit(SPOTS[-1:]).says == []


def test_it_is_not_over_where_people_stand_at_two_heights():
    cell = Cell().learn().visit(metres=0.2)
    for _ in range(3):
        for spot in SPOTS:
            cell.stand(spot, 1).stand(spot, 1, moved=on_a_box)
    assert cell.says


def on_a_box(joints):
    return joints + up_by(0.25)


def test_a_box_or_a_pallet_at_one_place_is_none():
    cell = Cell().learn().visit()
    for spot in ((0.0, 0.0), (0.4, 0.3), (0.0, -0.3), (0.7, 0.5)):
        cell.stand(spot, 20, moved=on_a_box)
    assert cell.says == []


def test_a_platform_is_as_high_as_at_first():
    cell = Cell().learn()
    for _ in range(3):
        for spot in ((4.0, 0.0), (4.0, 1.5), (4.0, 3.0)):
            cell.stand(spot, FIRST, moved=on_a_box)
        cell.visit()
    assert cell.says == []


def test_a_place_with_two_heights_says_nothing():
    cell = Cell()
    for spot in SPOTS[:3]:
        cell.stand(spot, FIRST // 2).stand(spot, FIRST // 2, moved=on_a_box)
    assert cell.visit(SPOTS[:3], 0.25).visit(SPOTS[:3]).says == []


def test_another_person_in_boots_is_none():
    tall = Figure(2.0)
    cell = Cell().learn().visit(figure=tall, stance=tall.standing(np.zeros(2), 1.0), metres=0.05)
    assert cell.says == []


@pytest.mark.parametrize(
    "stance",
    [
        replace(STANDS, crouch=0.45),
        replace(STANDS, left=replace(STANDS.left, lift=0.2)),
    ],
    ids=["crouches", "a foot on a step"],
)
def test_who_does_not_stand_does_not_count(stance):
    cell = Cell().learn()
    before = cell.watch.seconds
    assert cell.visit(stance=stance, metres=0.3).says == []
    assert cell.watch.seconds == before


def test_who_walks_or_shows_no_feet_does_not_count():
    watch = FloorWatch(PeopleSettings())
    joints, no_feet = FIGURE.joints(STANDS), ALL.copy()
    no_feet[[JOINTS.index("l_ankle")]] = False
    for k in range(200):
        watch.note(Body(1, joints + 0.1 * k * AHEAD, ALL), k * 100_000_000)
        watch.note(Body(2, joints, no_feet), k * 100_000_000)
    assert watch.seconds == 0


def test_no_place_is_learnt_after_the_first_minutes():
    cell = Cell().learn()
    cell.stand(SPOTS[0], LEARNT)
    late = [(9.0, 0.0), (9.0, 2.0), (9.0, 4.0)]
    assert cell.learn(late).visit(late, 0.3).says == []


def test_nothing_is_judged_where_postures_are_not():
    cell = Cell(posture_unchecked="a camera that swings").learn().visit(metres=0.5)
    assert cell.says == []


class Says:
    """Stands in for the watch: doubts the floor in the captures that it is given."""

    def __init__(self, doubted):
        self._doubted = iter(doubted)

    def note(self, body, capture_ns):
        pass

    def doubts(self):
        return (Doubt(Reason.SENSOR_MOVED, "moved"),) if next(self._doubted) else ()


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(0, 2)), max_size=30))
def test_it_makes_nothing_milder(make_room, captures):
    """The same scenes without it give no reason more, and no capture less that counts."""
    watched, alone = make_room(), make_room()
    watched.people._floor = Says(doubted for doubted, _, _ in captures)
    joints = FIGURE.joints(STANDS)
    for doubted, sees_room, people in captures:
        shown = [Person(k, joints + 3.0 * k * AHEAD, ALL) for k in range(people)]
        with_it, without = (r.see(*shown, sees_room=sees_room) for r in (watched, alone))
        assert set(without.reasons) <= set(with_it.reasons)
        assert with_it.captures <= without.captures
        assert with_it.ids == without.ids
        assert len(with_it.lost) >= len(without.lost)
        assert doubted == (Reason.SENSOR_MOVED in with_it.reasons)


def test_the_level_is_unknown_and_the_detail_says_why(make_workcell):
    cell = make_workcell([3.5, 3.0])
    assert cell.run(1.5)[-1].advices[0].level.may_move
    cell.node._people._floor = Says(repeat(True))
    advice = cell.run(0.2)[-1].advices[0]
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.SENSOR_MOVED)
    assert "moved" in advice.detail


def shown(cell, played, spots, move=lambda joints: joints):
    """Play recordings, each from its beginning at one of the spots."""
    rng = np.random.default_rng(1)
    for number, recording in enumerate(played, cell.person + 1):
        start = recording.positions[:, 0].mean(axis=0) * [1.0, 1.0, 0.0]
        spot = np.array([*spots[rng.integers(len(spots))], 0.0])
        cell.now_ns += 1_000_000_000
        for joints, seen in zip(recording.positions[::3], recording.observed[::3], strict=True):
            cell.now_ns += round(3e9 / RATE_HZ)
            noise = rng.normal(0.0, 0.01, joints.shape)
            cell.watch.note(Body(number, move(joints - start + spot) + noise, seen), cell.now_ns)
    cell.person += len(played)


@pytest.mark.long
@pytest.mark.skipif(not DATA.exists(), reason="the data pack is not here")
def test_recorded_people_never_move_the_sensor_and_its_motion_is_found():
    """All who show their feet, one after another: 540 s of standing, of many people."""
    everyone = [p for p in recordings(DATA) if p.observed[:, JOINTS.index("l_ankle")].any()]
    order = [everyone[k] for k in np.random.default_rng(2).permutation(len(everyone))]
    cell = Cell()
    shown(cell, order, SPOTS)
    assert cell.watch.seconds > 300
    assert cell.says == []
    shown(cell, order[:100], SPOTS, lambda joints: joints - up_by(0.2))
    assert "lower" in cell.says[0]
