"""The merged source: one person seen by two sensors is one person, at the time they share."""

import logging
from collections import Counter
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError, HriPredictError
from hri_predict.base.settings import validated
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import NOT_KNOWN_NS, live_part
from hri_predict.people.merging.settings import MergedSettings
from hri_predict.people.merging.source import MergedSource
from hri_predict.people.people import People
from hri_predict.people.settings import PeopleSettings
from hri_predict.protocol.reasons import Reason
from hri_predict.run.assemble import build_source
from hri_sim.people.procedural import ProceduralSettings, ProceduralSource
from tests.hri_predict.people.merging.two_sensors import (
    BACK,
    CELL,
    FRONT,
    START_NS,
    WALK,
    merged,
    scenes,
    standing,
)

PERIOD_S = 1 / 25
BOTH = (("front", 1), ("back", 1))
START_UP_S = 0.3
"""Until both sensors were heard, and the merge has a capture of each."""


def later(found, from_s=START_UP_S):
    return [(ns, scene) for ns, scene in found if ns >= START_NS + from_s * 1e9]


def reasons(found):
    return {doubt.reason for _, scene in found for doubt in scene.doubts}


def test_one_person_seen_by_two_is_one_person_with_both_ids():
    found = later(scenes(merged(), 9.0))
    seen_as = Counter(p.seen_as for _, scene in found for p in scene.people)
    assert seen_as[BOTH] > 150
    assert set(seen_as) <= {BOTH, (("front", 1),), (("back", 1),)}
    assert sum(seen_as.values()) - seen_as[BOTH] <= 2  # one sees a person come a capture sooner
    assert {p.id for _, scene in found for p in scene.people} == {1}
    assert reasons(found) == set()


def test_merged_joints_are_where_the_person_was_at_the_stamp():
    """Whatever latency, rate and noise: within the noise of the sensors, and no period late."""
    truth = ProceduralSource(ProceduralSettings(kind="procedural", people=WALK))
    truth.open(START_NS)
    off = []
    for _, scene in later(scenes(merged(), 9.0)):
        for person in scene.people:
            true, _ = truth.truth(scene.stamp_ns)[1]
            seen = person.observed
            off.append(np.linalg.norm(person.positions[seen] - true[seen], axis=1))
    off_m = np.concatenate(off)
    # the front sensor's noise is 5 mm an axis, 9 mm in the mean square; 8 of them is 40 mm
    assert np.sqrt((off_m**2).mean()) < 0.011
    assert off_m.max() < 0.04


def test_stamps_rise_and_no_scene_is_older_than_the_later_sensor_makes_it():
    found = later(scenes(merged(), 6.0))
    stamps = [scene.stamp_ns for _, scene in found]
    assert all(a < b for a, b in pairwise(stamps))
    ages_s = [(ns - scene.stamp_ns) * 1e-9 for ns, scene in found]
    assert min(ages_s) >= FRONT["latency_s"]
    assert max(ages_s) <= BACK["latency_s"] + PERIOD_S + 1e-6
    assert len(found) == pytest.approx(30 * (6.0 - START_UP_S), abs=3)


def test_a_person_whom_one_sensor_loses_keeps_the_id():
    hidden = [{"kind": "vanish", "start_s": 3.0, "duration_s": 1.0, "person": 1}]
    found = later(scenes(merged(front={"faults": hidden}, people=standing((2.0, 1.0))), 6.0))
    seen_as = Counter(p.seen_as for _, scene in found for p in scene.people)
    assert seen_as[(("back", 1),)] == pytest.approx(30, abs=3)
    assert {p.id for _, scene in found for p in scene.people} == {1}
    assert all(len(scene.people) == 1 for _, scene in found)


@pytest.mark.parametrize("apart_m", [0.3, 0.5, 1.0])
def test_two_people_close_together_are_two(apart_m):
    people = standing((2.0, 1.0), (2.0 + apart_m, 1.0))
    found = later(scenes(merged(people=people), 4.0))
    assert all(len(scene.people) == 2 for _, scene in found)
    assert {p.id for _, scene in found for p in scene.people} == {1, 2}


def test_two_people_of_whom_each_sensor_sees_another_are_two():
    people = standing((2.0, 1.0), (2.5, 1.0))
    hide = {n: [{"kind": "vanish", "person": n}] for n in (1, 2)}
    found = later(scenes(merged({"faults": hide[1]}, {"faults": hide[2]}, people=people), 4.0))
    assert all(len(scene.people) == 2 for _, scene in found)
    assert {p.seen_as for _, scene in found for p in scene.people} == {
        (("front", 2),), (("back", 1),)
    }  # fmt: skip


def test_ids_that_one_sensor_swaps_stay_with_the_people():
    swap = [{"kind": "identity_swap", "start_s": 2.0, "duration_s": 1.0}]
    people = standing((2.0, 1.0), (2.0, -1.0))
    found = later(scenes(merged(back={"faults": swap}, people=people), 5.0))
    places: dict[int, list[float]] = {1: [], 2: []}
    for _, scene in found:
        assert len(scene.people) == 2
        for person in scene.people:
            places[person.id].append(person.positions[person.observed].mean(axis=0)[1])
    assert np.ptp(places[1]) < 0.1
    assert np.ptp(places[2]) < 0.1
    swapped = Counter(p.seen_as for _, scene in found for p in scene.people)
    assert swapped[(("front", 1), ("back", 2))] > 20


@pytest.mark.parametrize("name", ["front", "back"])
def test_a_silent_sensor_is_named_and_the_room_is_not_vouched_for(name, caplog):
    silent: Any = {"faults": [{"kind": "drop", "start_s": 2.0, "duration_s": 2.0}]}
    with caplog.at_level(logging.WARNING):
        found = list(scenes(merged(**{name: silent}), 6.0))
    within = [s for ns, s in found if 2.3 <= (ns - START_NS) * 1e-9 <= 3.9]
    assert len(within) > 35
    for scene in within:
        assert [(d.reason, d.text) for d in scene.doubts] == [
            (Reason.SENSOR_SILENT, f"sensor {name} is silent")
        ]
        assert not scene.sees_room
    after = [s for ns, s in found if (ns - START_NS) * 1e-9 >= 4.3]
    assert {(s.sees_room, s.doubts) for s in after} == {(True, ())}
    assert f"sensor {name} is silent" in caplog.text


def test_the_merge_waits_for_no_sensor_longer_than_its_stale_s():
    silent = {"faults": [{"kind": "drop", "start_s": 2.0}], "stale_s": 0.2}
    found = later(scenes(merged(back=silent), 5.0))
    ages_s = [(ns - scene.stamp_ns) * 1e-9 for ns, scene in found]
    assert max(ages_s) <= 0.2 + PERIOD_S
    steady = [age for (ns, _), age in zip(found, ages_s, strict=True) if ns > START_NS + 3e9]
    assert max(steady) <= FRONT["latency_s"] + 1e-6  # nothing is waited for any more


def test_with_no_sensor_heard_nothing_is_said():
    dead = {"faults": [{"kind": "drop"}]}
    assert list(scenes(merged(dead, dead), 2.0)) == []


def test_a_sensor_that_was_never_heard_is_named():
    found = list(scenes(merged(back={"faults": [{"kind": "drop"}]}), 2.0))
    assert len(found) > 50
    assert {d.text for _, s in found for d in s.doubts} == {"sensor back was never heard"}
    assert all(s.doubts for _, s in found)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ({"kind": "clock_jump", "offset_s": -5.0}, Reason.CLOCK_JUMP),
        ({"kind": "clock_jump", "offset_s": 5.0}, Reason.CLOCK_JUMP),
        ({"kind": "freeze", "what": "joints"}, Reason.INPUT_FROZEN),
        ({"kind": "blind"}, Reason.SOURCE_BLIND),
        ({"kind": "delay", "delay_s": 1.0}, Reason.SENSOR_SILENT),
        ({"kind": "freeze"}, Reason.SENSOR_SILENT),
        ({"kind": "nan", "fraction": 1.0}, Reason.INPUT_IMPOSSIBLE),
    ],
)
def test_what_is_wrong_with_one_sensor_is_not_hidden_by_the_other(fault, reason):
    fault = fault | {"start_s": 2.0, "duration_s": 2.0}
    found = list(scenes(merged(back={"faults": [fault]}, people=standing((2.0, 1.0))), 6.0))
    within = [s for ns, s in found if 2.0 <= (ns - START_NS) * 1e-9 <= 4.2]
    said = {d.reason for s in within for d in s.doubts}
    assert reason in said
    assert all("back" in d.text for s in within for d in s.doubts)
    for scene in within:  # and the person whom the other sensor sees is there all the time
        assert any(p.observed.any() and dict(p.seen_as).get("front") == 1 for p in scene.people)


def test_a_sensor_whose_clock_is_another_agrees_with_the_others():
    """Clocks need not agree: 3 s of difference, and 100 ppm."""
    offset = [{"kind": "clock_jump", "offset_s": 3.0}, {"kind": "clock_drift", "ppm": 100}]
    found = later(scenes(merged(back={"faults": offset}), 8.0), 1.0)
    assert {p.id for _, scene in found for p in scene.people} == {1}
    assert reasons(found) == set()


def test_a_sensor_that_is_30_cm_off_shows_a_second_person_and_is_reported():
    shifted = {"room_from_source": {"xyz": [0.3, 0.0, 0.0]}}
    found = later(scenes(merged(back=shifted, people=standing((2.0, 1.0)), moved_s=4.0), 9.0))
    assert all(len(scene.people) == 2 for _, scene in found)
    after = [s for ns, s in found if ns > START_NS + 5.0e9]
    texts = {d.text for s in after for d in s.doubts}
    assert texts <= {f"sensors front and back are {cm} cm apart" for cm in (29, 30, 31)}
    assert all(any(d.reason is Reason.SENSORS_DISAGREE for d in s.doubts) for s in after)


def test_a_sensor_that_is_5_cm_off_is_one_as_others_are():
    shifted = {"room_from_source": {"xyz": [0.0, 0.05, 0.0]}}
    found = later(scenes(merged(back=shifted, people=standing((2.0, 1.0)), moved_s=4.0), 9.0))
    assert {p.id for _, scene in found for p in scene.people} == {1}
    assert reasons(found) == set()


def test_the_same_run_gives_the_same_scenes():
    def told():
        return [
            (ns, s.stamp_ns, [(p.id, p.positions.tobytes()) for p in s.people])
            for ns, s in scenes(merged(back={"dropout": 0.1}), 4.0)
        ]

    assert told() == told()


TO_AND_FRO: list[dict[str, Any]] = [
    {
        "start": [3.3, 2.4],
        "script": [{"do": "walk", "to": [0.9, 1.6]}, {"do": "walk", "to": [4.9, 3.0]}],
    }
]


def reasons_of_node(source, seconds):
    """The reasons of the input, by the node's people stage behind the merge."""
    settings = MergedSettings.model_validate(source)
    people = People(
        settings=PeopleSettings(),
        joint_map=load_joint_map("canonical"),
        source_settings=settings,
        rate_hz_source=min(s["rate_hz"] for s in source["sensors"].values()),
        declares_noise=False,
        history_steps=10,
        rate_hz_predictor=25.0,
    )
    found = set()
    for now_ns, scene in scenes(source, seconds):
        people.receive(scene, now_ns)
        if now_ns > START_NS + 1e9:
            found |= set(people.snapshot(now_ns).reasons)
    return found


@pytest.mark.long
def test_a_slow_sensor_beside_a_fast_one_does_not_look_frozen():
    """Between two captures of the slow one, bodies lie on straight lines, and stop at each."""
    slow = {"rate_hz": 10, "latency_s": 0.03, "min_latency_s": 0.03}
    found = reasons_of_node(merged({"rate_hz": 120}, slow, people=TO_AND_FRO), 3.2)
    assert found == set()


def test_a_body_that_one_sensor_makes_up_is_found_behind_the_merge():
    """It froze in a step while the other sensor sees the person walk on."""
    lie = {"faults": [{"kind": "made_up", "how": "hold", "start_s": 1.5}]}
    source = merged(lie, {"latency_s": 0.03, "min_latency_s": 0.03}, people=TO_AND_FRO)
    assert Reason.INPUT_REPEATS in reasons_of_node(source, 3.0)


def test_a_source_that_ends_ends_the_merge():
    ends = {"duration_s": 1.0}
    source = MergedSource(MergedSettings.model_validate(merged(ends, ends)))
    source.open(0)
    now_ns = count = 0
    while (due_ns := source.next_ns()) is not None:
        assert due_ns < NOT_KNOWN_NS
        now_ns = max(now_ns + 1, due_ns)
        assert now_ns < 2_000_000_000
        while source.poll(now_ns) is not None:
            count += 1
    assert count >= 29
    assert source.live is None
    source.close()
    source.close()


def test_trackers_of_different_joints_are_merged_in_the_canonical_skeleton():
    back = {"joint_map": "coco17"}
    found = later(scenes(merged(back=back), 9.0))
    both = [p for _, s in found for p in s.people if p.seen_as == BOTH]
    assert len(both) > 150
    assert {p.positions.shape for p in both} == {(21, 3)}


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (merged(sensors={"front": FRONT}), "sensors"),
        (merged(sensors={"front": FRONT, "back": BACK | {"kind": "none"}}), "sensors.back.kind"),
        (merged(sensors={"front": FRONT, "back": {}}), "sensors.back.kind: use one of"),
        (merged(sensors={"front": FRONT, "back": merged()}), "sensors.back.kind: use one of"),
        (merged(front={"rate_hz": -1}), "sensors.front: rate_hz"),
        (merged(front={"keeps_ids": True}), "sensors.front.keeps_ids: has no effect"),
        (merged(keeps_ids=True), "keeps_ids has no effect for a merged source"),
        (merged(min_latency_s=0.1), "min_latency_s has no effect for a merged source"),
        (
            merged(room_from_source={"xyz": [1, 0, 0]}),
            "room_from_source has no effect for a merged source",
        ),
        (merged(same_m=0.2, apart_m=0.1), "apart_m 0.1 is below same_m 0.2"),
        (merged(joint_apart_m=0.1), "joint_apart_m 0.1 is below apart_m 0.25"),
    ],
)
def test_a_wrong_block_is_refused_in_one_line(source, said):
    with pytest.raises(ConfigError) as error:
        validated(MergedSettings, source, "cell.yaml: source")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_the_log_of_each_live_sensor_names_it():
    udp = {"kind": "udp", "rate_hz": 30, "room_from_source": {"xyz": [0, 0, 0]}, "port": 0}
    block = {"kind": "merged", "sensors": {"front": udp, "back": udp}}
    source = MergedSource(MergedSettings.model_validate(block))
    source.open(0)
    source.close()
    lives = [live_part(sensor.source) for sensor in source.sensors]
    assert [live and live.label for live in lives] == ["sensor front", "sensor back"]


def test_a_node_judges_its_sensors_by_the_settings_of_people():
    config = CELL.with_source(merged()).with_node(people=PeopleSettings(frozen_scenes=7))
    source = build_source(config)
    assert isinstance(source, MergedSource)
    assert {sensor._frozen_scenes for sensor in source.sensors} == {7}


def test_a_sensor_that_cannot_be_built_is_named():
    missing = {"kind": "recording", "path": "nowhere.npz"}
    block = {"kind": "merged", "sensors": {"front": FRONT, "back": missing}}
    with pytest.raises(HriPredictError, match=r"nowhere\.npz"):
        MergedSource(MergedSettings.model_validate(block))
