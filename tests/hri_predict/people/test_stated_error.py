"""The error that a source states of a person's place, through tracking, loss and restarts."""

from dataclasses import replace

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.standing import standing_body
from hri_predict.people.lost.lost_people import LostPeople
from hri_predict.people.merging.sensor import Sensor
from hri_predict.protocol.reasons import Reason
from hri_sim.people.procedural import ProceduralSettings
from tests.hri_predict.people.merging.test_sensor import Given, scene

ALL = np.ones(len(JOINTS), bool)
VIEW = {"polygon": [[-6, -6], [6, -6], [6, 6], [-6, 6]]}
RNG = np.random.default_rng(4)


def person(error_m=0.0, number=1, x=1.0):
    noise = RNG.normal(0, 0.002, (len(JOINTS), 3))
    return Person(number, standing_body() + np.array([x, 0.0, 0.0]) + noise, ALL, error_m=error_m)


def test_each_person_has_the_largest_error_of_the_captures_that_are_kept(make_room):
    room = make_room()
    room.see(person(0.2), person(number=2, x=3.0))
    snapshot = room.see(person(0.1), person(0.3, number=2, x=3.0))
    assert snapshot.errors_m.tolist() == [0.2, 0.3]
    for _ in range(60):  # the history spans ten captures
        snapshot = room.see(person(0.1), person(number=2, x=3.0))
    assert snapshot.errors_m.tolist() == [0.1, 0.0]
    assert snapshot.reasons == ()


def test_without_a_stated_error_there_is_none(make_room):
    assert make_room().see(person(), times=3).all_errors_m.tolist() == [0.0]


@pytest.mark.parametrize("absurd", [np.nan, np.inf, -0.1, 20.5, None, "0.5", [0.1], 10**400])
def test_an_absurd_error_makes_the_scene_impossible(make_room, absurd):
    room = make_room()
    assert room.see(person(), times=3).reasons == ()
    snapshot = room.see(person(absurd))
    assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons
    assert snapshot.counters["absurd_errors"] == 1
    assert snapshot.captures == 3
    assert room.see(person(), times=2).reasons == ()


def test_a_person_who_was_never_seen_without_an_absurd_error_is_not_located(make_room):
    snapshot = make_room().see(person(np.nan), times=3)
    assert snapshot.ids == ()
    assert snapshot.captures == 0
    assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons


def test_a_lost_person_keeps_the_error_also_across_a_restart(make_room):
    room = make_room()
    room.see(person(0.4), times=5)
    (lost,) = room.see(times=10).lost
    assert lost.error_m == 0.4
    again = make_room()
    again.people.recall(room.people.remember())
    (recalled,) = again.see().lost
    assert recalled.error_m == 0.4


def test_who_is_found_under_another_id_keeps_the_error_of_the_history(make_room):
    room = make_room()
    room.see(person(0.4), times=5)
    snapshot = room.see(person(0.1, number=2), times=2)
    assert snapshot.ids == (2,)
    assert snapshot.errors_m.tolist() == [0.4]


def test_a_body_between_two_captures_has_the_larger_error_of_both():
    source = Given()
    sensor = Sensor("front", source, ProceduralSettings(kind="procedural"))
    for number, error_m in enumerate((0.3, 0.1)):
        sent = scene(number, 1000 + 33 * number, 5.0)
        source.scenes.append(replace(sent, people=(replace(sent.people[0], error_m=error_m),)))
        sensor.take((1005 + 33 * number) * 1_000_000)
    view = sensor.at(sensor.newest_ns - 10_000_000, sensor.newest_ns - 20_000_000)
    assert [body.error_m for body in view.bodies.values()] == [0.3]


# -- free space --------------------------------------------------------------------------------


@pytest.mark.parametrize(("error_m", "whole"), [(0.0, True), (0.01, False)])
def test_a_scene_with_an_error_proves_no_free_space(make_room, error_m, whole, monkeypatch):
    told = []

    def see(_lost, _capture_ns, _seen, is_whole, standing):
        told.append((is_whole, len(standing)))
        return 0

    monkeypatch.setattr(LostPeople, "see", see)
    make_room().see(person(error_m))
    assert told == [(whole, whole)]


@pytest.mark.parametrize("error_m", [0.0, 0.01])
def test_who_was_lost_with_an_error_is_seen_free_nowhere(make_room, error_m):
    room = make_room(source={"field_of_view": VIEW, "sees_free_space": True})
    room.see(person(error_m), times=5)
    (lost,) = room.see(times=10).lost
    assert (lost.places is None) is (error_m > 0)
