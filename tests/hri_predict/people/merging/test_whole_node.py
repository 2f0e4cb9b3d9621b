"""The whole node with two sensors, on the virtual clock: its advice, lost people and recordings."""

from typing import Any

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.run.session import Options, run
from hri_sim.replay import RecordingSettings, RecordingSource
from tests.hri_predict.people.merging.two_sensors import (
    BACK,
    CELL,
    merged,
    nearest_m,
    node_with,
    people_of,
    standing,
)

BESIDE_M = 1.0
"""A person nearer than this to the axis of the robot's base is beside it: it reaches 0.85 m."""
HERE = standing((1.2, 0.6))
FAR = standing((3.0, 2.0))


def test_one_person_seen_by_two_is_one_and_leaves_as_one():
    watch = node_with(merged(), 11.0)
    ids = [people_of(tick).ids for tick in watch.between(0.2)]
    assert set(ids) == {(), (1,)}
    last = people_of(watch.ticks[-1])
    assert (last.ids, last.lost) == ((), ())  # left by the exit
    assert last.counters["left_by_exit"] == 1
    assert Level.CLEAR in watch.levels(10.8)
    assert watch.levels(3.0, 5.0) == {Level.STOP}


FAULTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "none": ({}, {}),
    "front silent": ({"faults": [{"kind": "drop", "start_s": 2.0, "duration_s": 2.0}]}, {}),
    "back silent": ({}, {"faults": [{"kind": "drop", "start_s": 2.0, "duration_s": 2.0}]}),
    "front loses him": ({"faults": [{"kind": "vanish", "start_s": 2.0, "duration_s": 2.0}]}, {}),
    "back loses him": ({}, {"faults": [{"kind": "vanish", "start_s": 2.0, "duration_s": 2.0}]}),
    "in turn": (
        {"faults": [{"kind": "vanish", "start_s": 2.0, "duration_s": 1.0}]},
        {"faults": [{"kind": "vanish", "start_s": 2.8, "duration_s": 1.0}]},
    ),
    "back moved": ({}, {"room_from_source": {"xyz": [0.3, 0.0, 0.0]}}),
    "back's clock back": ({}, {"faults": [{"kind": "clock_jump", "start_s": 2, "offset_s": -5}]}),
    "back's clock on": ({}, {"faults": [{"kind": "clock_jump", "start_s": 2, "offset_s": 5}]}),
    "back frozen": ({}, {"faults": [{"kind": "freeze", "what": "joints", "start_s": 2.0}]}),
    "back late": ({}, {"faults": [{"kind": "delay", "delay_s": 0.5, "start_s": 2.0}]}),
    "joints dropped": ({"dropout": 0.2}, {"dropout": 0.2}),
    "arms hidden": (
        {"faults": [{"kind": "hide", "joints": ["r_elbow", "r_wrist", "r_hand"], "start_s": 2}]},
        {},
    ),
}


ONE_MORE = {"none", "back silent", "front loses him", "back's clock back", "in turn"}
"""Of a kind that another one shows daily, at the other sensor or the other way round."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] * (n in ONE_MORE)) for n in FAULTS]
)
def test_it_is_never_clear_beside_a_person(name):
    front, back = FAULTS[name]
    watch = node_with(merged(front, back), 4.5)
    beside = [tick for tick, apart_m in nearest_m(watch) if apart_m < BESIDE_M]
    assert len(beside) > 20
    assert Level.CLEAR not in {tick.advices[0].level for tick in beside}


@pytest.mark.parametrize("name", ["front", "back"])
def test_a_silent_sensor_makes_it_unknown_although_the_other_sees_an_empty_room(name):
    silent = {"faults": [{"kind": "drop", "start_s": 2.5, "duration_s": 1.0}]}
    watch = node_with(merged(**{name: silent}, people=[]), 6.0)
    assert Level.CLEAR in watch.levels(1.5, 2.5)
    within = watch.between(2.8, 3.4)
    assert {t.advices[0].level for t in within} == {Level.UNKNOWN}
    assert {t.advices[0].reason for t in within} == {Reason.SENSOR_SILENT}
    assert all(f"sensor {name} is silent" in t.advices[0].detail for t in within)
    assert Level.CLEAR in watch.levels(5.5)


def test_a_person_whom_only_the_silent_sensor_saw_is_not_lost_and_goes_on_when_it_returns():
    front = {"faults": [{"kind": "vanish"}]}
    back = {"faults": [{"kind": "drop", "start_s": 2.0, "duration_s": 1.0}]}
    watch = node_with(merged(front, back, people=HERE), 4.5)
    for tick in watch.between(1.0):
        assert people_of(tick).ids == (1,)
        assert people_of(tick).lost == ()
        assert tick.advices[0].level is not Level.CLEAR


def test_the_summary_counts_the_troubles_of_each_sensor():
    back = {"faults": [{"kind": "drop", "start_s": 1.5, "duration_s": 1.0}]}
    source = merged(back=back, people=HERE)
    summary = run(CELL.with_source(source), Options(factor=None, duration_s=3.0))
    assert summary.counted["sensor_back_lost_scenes"] == pytest.approx(25, abs=2)
    assert "sensor_front_lost_scenes" not in summary.counted
    assert summary.counted["sensor_front_scenes"] > 80


def test_a_person_whom_both_lose_is_lost():
    lost = {"faults": [{"kind": "vanish", "start_s": 1.5}]}
    watch = node_with(merged(lost, lost, people=HERE), 3.0)
    assert people_of(watch.ticks[-1]).ids == ()
    assert len(people_of(watch.ticks[-1]).lost) == 1
    assert Level.CLEAR not in watch.levels(1.0)


def test_two_who_turn_out_to_be_one_leave_no_lost_person_behind():
    """A sensor sees one side of a person for a while: two people, then one again."""
    right = [name for name in JOINTS if name.startswith("r_")]
    half = [{"kind": "hide", "joints": right, "start_s": 0.0, "duration_s": 1.5}]
    watch = node_with(merged(back={"faults": half}, people=FAR), 3.0)
    assert {len(people_of(t).ids) for t in watch.between(0.5, 1.4)} == {2}
    last = people_of(watch.ticks[-1])
    assert (last.ids, last.lost) == ((1,), ())
    assert last.counters["joined"] == 1


@pytest.mark.parametrize("apart_m", [0.4, 0.5])
def test_two_people_side_by_side_are_two_in_the_node(apart_m):
    people = standing((1.5, 1.0), (1.5, 1.0 + apart_m))
    watch = node_with(merged(people=people), 2.5)
    assert {people_of(t).ids for t in watch.between(1.0)} == {(1, 2)}


def test_a_moved_sensor_is_a_reason_that_says_by_how_much():
    moved = {"room_from_source": {"xyz": [0.3, 0.0, 0.0]}}
    watch = node_with(merged(back=moved, people=FAR, moved_s=2.0), 4.0)
    after = watch.between(3.0)
    assert {t.advices[0].level for t in after} <= {Level.UNKNOWN, Level.STOP}
    assert all(Reason.SENSORS_DISAGREE in people_of(t).reasons for t in after)
    assert all("sensors front and back are 30 cm apart" in t.advices[0].detail for t in after)


def test_a_recording_holds_both_ids_and_the_doubts(tmp_path):
    silent = {"faults": [{"kind": "drop", "start_s": 2.0, "duration_s": 1.0}]}
    path = tmp_path / "both.mcap"
    run(CELL.with_source(merged(back=silent)), Options(factor=None, duration_s=4.0, record=path))
    settings = RecordingSettings(kind="recording", path=str(path))
    scenes = RecordingSource(settings).recording.scenes
    seen_as = {p.seen_as for s in scenes for p in s.people}
    assert (("front", 1), ("back", 1)) in seen_as
    assert (("front", 1),) in seen_as
    assert "sensor back is silent" in {d.text for s in scenes for d in s.doubts}
    replayed = CELL.with_source({"kind": "recording", "path": str(path)})
    again = run(replayed, Options(factor=None, until_exhausted=True))
    assert again.counted["sensor_silent"] > 15


def test_speeds_that_are_measured_are_those_of_the_person_not_of_the_sensors():
    """Two sensors that see a person 6 cm apart: who stands still is not fast."""
    off = {"room_from_source": {"xyz": [0.06, 0.0, 0.0]}, "dropout": 0.1}
    watch = node_with(merged({"dropout": 0.1}, off, people=FAR), 4.0)
    fast = [Reason.PERSON_FAST is t.advices[0].reason for t in watch.between(2.0)]
    assert np.mean(fast) < 0.5


def test_the_time_that_the_merge_waits_counts_as_age():
    """No clock alignment takes it for an offset: captures are the stamps, and none is younger than
    the latency of the later sensor."""
    watch = node_with(merged(people=FAR), 3.0)
    snapshots = [people_of(tick) for tick in watch.between(1.0)]
    ages_s = [s.age_s for s in snapshots if s.age_s is not None]
    assert len(ages_s) == len(snapshots)
    assert min(ages_s) >= BACK["latency_s"]
    assert {s.newest_capture_ns for s in snapshots} <= watch.stamps
