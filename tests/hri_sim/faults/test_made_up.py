"""A tracker that lost people, or joints, and sends them all the same."""

import pytest

from tests.hri_sim.faults.test_injector import heard, window


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
    shown = [scene.people[0].positions[0, 0] for scene in scenes]
    assert shown[25:29] == pytest.approx(expected)
    assert shown[24] == 24
    assert shown[50] == 50
    assert scenes[30].sequence == 30


def test_lost_joints_are_sent_at_one_place():
    scenes = [s for _, s in heard(window("zero", joints=["waist"], at=[1.0, 2.0, 3.0]))]
    person = scenes[30].people[1]
    assert person.positions[0].tolist() == [1.0, 2.0, 3.0]
    assert person.observed[0]
    assert person.positions[1, 0] == 130
    assert scenes[50].people[0].positions[0, 0] == 50
