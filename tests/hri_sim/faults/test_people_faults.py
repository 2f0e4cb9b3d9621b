"""Faults of people: others' ids, made up, without joints, turned and mirrored, in their time."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_sim.faults.injector import parse_fault
from tests.hri_sim.faults.test_injector import Walkers, heard, window

BODY = np.random.default_rng(2).uniform(-1, 2, (21, 3))
NAMES = Walkers.joint_map.source_joints


class Stands(Walkers):
    """One body that does not move."""

    def poll(self, now_ns):
        scene = super().poll(now_ns)
        return scene and replace(scene, people=(replace(scene.people[0], positions=BODY),))


def shown(fault):
    """The body with the fault, which acts in the first second."""
    scenes = [s.people[0].positions for _, s in heard(parse_fault(fault), source=Stands(50, 1))]
    assert np.array_equal(scenes[-1], BODY)
    return scenes[0]


def lengths(body):
    return np.linalg.norm(body[:, None] - body[None], axis=-1)


def test_alternate_shows_two_people_in_turn_under_one_id():
    scenes = [s for _, s in heard(window("alternate", person=10, other=11, captures=2))]
    assert [len(s.people) for s in scenes] == [2] * 25 + [1] * 25 + [2] * 50
    assert {s.people[0].id for s in scenes} == {10}
    # the second person of scene k stands at 100 + k
    first = [s.people[0].positions[0, 0] - k for k, s in enumerate(scenes)]
    assert first[25:33] == [0.0, 0.0, 100.0, 100.0, 0.0, 0.0, 100.0, 100.0]


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"how": "hold"}, [24.0, 24.0, 24.0, 24.0]),
        ({"how": "loop", "captures": 3}, [22.0, 23.0, 24.0, 22.0]),
        ({"how": "coast", "velocity": [25.0, 0, 0]}, [25.0, 26.0, 27.0, 28.0]),
    ],
)
def test_a_tracker_makes_people_up(parameters, expected):
    scenes = [s for _, s in heard(window("made_up", noise_m=0.0, **parameters))]
    first = [scene.people[0].positions[0, 0] for scene in scenes]
    assert first[25:29] == pytest.approx(expected)
    assert first[24] == 24
    assert first[50] == 50
    assert scenes[30].sequence == 30


def test_lost_joints_are_sent_at_one_place():
    scenes = [s for _, s in heard(window("zero", joints=["waist"], at=[1.0, 2.0, 3.0]))]
    person = scenes[30].people[1]
    assert person.positions[0].tolist() == [1.0, 2.0, 3.0]
    assert person.observed[0]
    assert person.positions[1, 0] == 130
    assert scenes[50].people[0].positions[0, 0] == 50


@pytest.mark.parametrize("person", [None, 11])
def test_named_joints_are_hidden_for_a_time(person):
    for _, scene in heard(window("hide", joints=["l_hand", "waist"], person=person)):
        for each in scene.people:
            hidden = 25 <= scene.sequence < 50 and person in (None, each.id)
            gone = {NAMES[j] for j in np.flatnonzero(~each.observed)}
            assert gone == ({"l_hand", "waist"} if hidden else set())
            assert np.isnan(each.positions[~each.observed]).all()


def test_a_joint_that_the_source_does_not_have_cannot_be_hidden():
    with pytest.raises(ConfigError, match=r"unknown joint 'l_hnad'.*l_hand"):
        heard(window("hide", joints=["l_hnad"]))


def test_a_rotation_turns_about_its_point():
    turned = shown("rotate@0+1:quaternion_xyzw=[1,0,0,0],about=[0.5,1,2]")
    assert turned == pytest.approx(np.array([0.0, 2.0, 4.0]) + BODY * [1, -1, -1])
    assert lengths(turned) == pytest.approx(lengths(BODY))


def test_by_default_it_lays_bodies_down():
    assert shown("rotate@0+1") == pytest.approx(BODY[:, [0, 2, 1]] * [1, -1, 1])


def test_a_mirror_keeps_heights_and_lengths_and_swaps_the_sides():
    mirrored = shown("mirror@0+1:at_y=0.5")
    assert mirrored == pytest.approx(np.array([0.0, 1.0, 0.0]) + BODY * [1, -1, 1])
    assert lengths(mirrored) == pytest.approx(lengths(BODY))
