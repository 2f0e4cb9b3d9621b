"""The node's own recordings: what was written is read back, whole or cut, and the same bytes."""

import json
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.link import Received
from hri_predict.contracts.scene import Person, Scene
from hri_predict.protocol.messages import (
    Acknowledge,
    RobotMode,
    RobotState,
)
from hri_predict.recording import Recorder, open_recording
from hri_predict.recording.mcap.format import scene_from_dict, scene_to_dict, to_json
from hri_predict.recording.mcap.items import Rates
from hri_predict.recording.mcap.places import OneFile
from hri_predict.recording.rig import map_of_rig
from tests.hri_predict.recording.mcap.made_up import JOINTS
from tests.hri_predict.recording.mcap.made_up import info as _info
from tests.hri_predict.recording.mcap.made_up import record as _record
from tests.hri_predict.recording.mcap.made_up import scene as _scene
from tests.hri_predict.recording.mcap.made_up import tick as _tick
from tests.messages import make_state


def _same(a: Scene, b: Scene) -> None:
    assert (a.stamp_ns, a.sequence, a.sees_room) == (b.stamp_ns, b.sequence, b.sees_room)
    assert [p.id for p in a.people] == [p.id for p in b.people]
    for p, q in zip(a.people, b.people, strict=True):
        np.testing.assert_array_equal(p.positions, q.positions)  # exactly, and NaN where NaN
        np.testing.assert_array_equal(p.observed, q.observed)
        np.testing.assert_array_equal(p.error_m, q.error_m)


def _messages(path: Path, valid: bool = False) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert channel.message_encoding == "json"
            assert schema is not None
            assert schema.encoding == "jsonschema"
            data = json.loads(message.data)
            if valid:
                jsonschema.validate(data, json.loads(schema.data))
            found.setdefault(channel.topic, []).append(data)
    return found


@pytest.mark.parametrize("threaded", [False, True])
def test_what_was_received_is_read_back_exactly(tmp_path: Path, threaded: bool) -> None:
    path = tmp_path / "a.mcap"
    recorder = _record(path, 50, threaded)
    assert recorder.dropped == 0
    assert recorder.error is None
    assert recorder.written == 50 * 6 + 2 * 10 + 2 * 10
    recording = open_recording(path)
    assert recording.kind == "mcap"
    assert recording.note == ""
    assert recording.rate_hz == 30.0
    assert recording.declares_noise
    assert recording.config == "rate_hz: 25\n"
    assert len(recording.scenes) == 50
    for k, scene in enumerate(recording.scenes):
        _same(scene, _scene(k))
        assert recording.arrival_ns[k] == 1_000_000 * k + 40
    link, received = recording.received[7]
    assert link == "serial"
    assert received == Received(
        make_state((0.1 * 7, -1.0), (0.0, 0.5), counter=7),
        7_000_050,
    )


def test_any_mcap_reader_finds_every_topic(tmp_path: Path) -> None:
    rates = Rates(zones_hz=12.5, poses_hz=25, view_hz=25, horizon_stride=5)
    _record(tmp_path / "a.mcap", 3, rates=rates)
    found = _messages(tmp_path / "a.mcap", valid=True)
    assert {topic: len(data) for topic, data in found.items()} == {
        "/scene": 3, "/received": 3, "/status": 3, "/advice/arm": 3, "/forecast": 3, "/zones": 2,
        "/sent": 6, "/clock": 1, "/view/scene": 3, "/view/people": 3,
    }  # fmt: skip
    advice = found["/advice/arm"][0]
    assert advice["level_number"] == 3
    assert (advice["level"], advice["reason"]) == ("SLOW", "PERSON_NEAR")
    assert (advice["separation_m"], advice["detail"]) == (0.71, "l_hand")
    assert found["/sent"][1] == {"link": "can", "id": 0x123, "data": "AAECAwQFBgc="}
    forecast, zones = found["/forecast"][2], found["/zones"][1]
    tick = _tick(2)
    assert tick.forecast is not None
    assert tick.assessment is not None
    assert forecast["steps"] == [4, 9, 14, 19, 24]
    np.testing.assert_allclose(
        forecast["positions"], tick.forecast.positions[:, forecast["steps"]], atol=5.1e-4
    )
    assert zones["times_s"] == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    capsules = tick.assessment.zones.capsules
    np.testing.assert_allclose(
        np.array(zones["capsules"])[..., 6], capsules.radius[:, ::5], atol=5.1e-4
    )
    np.testing.assert_allclose(
        np.array(zones["capsules"])[..., 3:6], capsules.b[:, ::5], atol=5.1e-4
    )


def test_two_virtual_runs_give_the_same_bytes(tmp_path: Path) -> None:
    _record(tmp_path / "a.mcap", 40)
    _record(tmp_path / "b.mcap", 40)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_what_cannot_be_said_in_json_is_null_and_not_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    positions = np.full((JOINTS, 3), np.inf)
    positions[2] = [1.0, np.nan, -0.0]
    scene = Scene(-5, 2**40, False, (Person(1, positions, np.ones(JOINTS, dtype=bool)),))
    with Recorder(path, _info(), threaded=False) as recorder:
        recorder.on_scene(scene, 12)
        recorder.on_scene(Scene(6, 1, True, ()), 13)
        state = make_state((float("nan"),), (0.0,), mode=RobotMode.UNKNOWN)
        recorder.on_received("x", Received(state, 14))
        recorder.on_received("x", Received(Acknowledge(3, 9), 15))
    recording = open_recording(path)
    back = recording.scenes[0]
    assert (back.stamp_ns, back.sequence, back.sees_room) == (-5, 2**40, False)
    assert np.isnan(back.people[0].positions).sum() == JOINTS * 3 - 2
    assert back.people[0].observed.all()  # claimed observed, and is not a number: still absurd
    assert recording.scenes[1].people == ()
    message = recording.received[0][1].message
    assert isinstance(message, RobotState)
    assert np.isnan(message.positions[0])
    assert recording.received[1][1].message == Acknowledge(3, 9)


@given(
    st.lists(
        st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(float("nan"))), min_size=6, max_size=6),
        max_size=4,
    ),
    st.integers(-(2**62), 2**62),
    st.booleans(),
)
def test_scenes_go_through_json_exactly(numbers, stamp, sees_room) -> None:
    people = tuple(
        Person(i, np.array(n).reshape(2, 3), np.array([True, False])) for i, n in enumerate(numbers)
    )
    scene = Scene(stamp, 7, sees_room, people)
    back, receipt = scene_from_dict(json.loads(to_json(scene_to_dict(scene, stamp + 1))), joints=2)
    assert receipt == stamp + 1
    _same(back, scene)


@pytest.mark.parametrize("absurd", [np.nan, np.inf, -0.5, 21.0, "much"])
def test_an_absurd_error_is_absurd_again(absurd: Any) -> None:
    person = Person(1, np.zeros((2, 3)), np.ones(2, bool), error_m=absurd)
    data = json.loads(to_json(scene_to_dict(Scene(0, 0, True, (person,)), 1)))
    back, _ = scene_from_dict(data, joints=2)
    assert np.isnan(back.people[0].error_m)
    data["people"][0]["error_m"] = absurd  # as a program of others may write it
    assert np.isnan(scene_from_dict(data, joints=2)[0].people[0].error_m)


def test_a_cut_file_gives_what_is_before_the_cut_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    _record(path, 300)
    data = path.read_bytes()
    whole = len(open_recording(path).scenes)
    counts: list[int] = []
    messages: list[str] = []
    for part in (0.02, 0.2, 0.5, 0.8, 0.97):
        path.write_bytes(data[: int(part * len(data))])
        try:
            recording = open_recording(path)
        except RecordingError as error:
            messages.append(str(error))
            counts.append(0)
            continue
        assert "cut" in recording.note
        for k, scene in enumerate(recording.scenes):
            _same(scene, _scene(k))
        counts.append(len(recording.scenes))
    assert all("truncated" in text for text in messages)
    assert counts == sorted(counts)
    assert 0.3 * whole < counts[2] < 0.7 * whole


def test_damaged_bytes_never_end_in_anything_but_a_recording_error(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    _record(path, 4)
    data = path.read_bytes()
    rng = np.random.default_rng(4)
    outcomes = []
    for _ in range(300):
        damaged = bytearray(data)
        for where in rng.integers(0, len(data), 3):
            damaged[where] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            recording = open_recording(path)
        except RecordingError as error:
            outcomes.append("\n" not in str(error))
        else:
            outcomes.append(len(recording.scenes) > 0)
    assert all(outcomes)


def test_what_is_no_recording_of_ours_is_one_clear_error(tmp_path: Path) -> None:
    def error(data: bytes) -> str:
        path = tmp_path / "a.mcap"
        path.write_bytes(data)
        with pytest.raises(RecordingError) as caught:
            open_recording(path)
        assert "a.mcap" in str(caught.value)
        return str(caught.value)

    assert "not an MCAP" in error(b"PK\x03\x04 no such thing at all")
    assert "empty" in error(b"")
    with Recorder(tmp_path / "b.mcap", _info(), threaded=False) as recorder:
        recorder.on_received("x", Received(Acknowledge(3, 9), 15))
    whole = (tmp_path / "b.mcap").read_bytes()
    assert "no scenes" in error(whole)
    assert "truncated" in error(whole[:10])
    (tmp_path / "b.mcap").unlink()
    _record(tmp_path / "b.mcap", 2)
    other = (
        (tmp_path / "b.mcap").read_bytes().replace(b"\x01\x00\x00\x002", b"\x01\x00\x00\x009", 1)
    )
    assert "format '9'" in error(other)


def test_a_joint_map_made_from_a_file_travels_with_the_recording(tmp_path: Path) -> None:
    names = ["Hips", "Spine", "Neck", "Head", "LeftArm", "LeftForeArm", "LeftHand", "RightArm"]
    names += ["RightForeArm", "RightHand", "LeftUpLeg", "LeftLeg", "LeftFoot", "RightUpLeg"]
    names += ["RightLeg", "RightFoot"]
    joint_map = map_of_rig(names)
    path = tmp_path / "a.mcap"
    positions = np.random.default_rng(1).normal(size=(len(names), 3))
    observed = np.ones(len(names), dtype=bool)
    with Recorder(path, _info(joint_map=joint_map), threaded=False) as recorder:
        recorder.on_scene(Scene(0, 0, True, (Person(1, positions, observed),)), 0)
    back = open_recording(path).joint_map
    assert (back.name, back.source_joints) == (joint_map.name, joint_map.source_joints)
    for a, b in zip(back.map(positions, observed), joint_map.map(positions, observed), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_the_queue_cannot_take_is_dropped_and_counted(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, _info(), threaded=True, queue_items=5)
    go = threading.Event()
    write = recorder._write
    monkeypatch.setattr(recorder, "_write", lambda item: (go.wait(10), write(item)))
    for k in range(100):
        recorder.on_scene(_scene(k), k)
    assert recorder.dropped >= 94
    go.set()
    recorder.close()
    recorder.close()
    assert recorder.written + recorder.dropped == 100
    assert len(open_recording(path).scenes) == recorder.written
    recorder.on_scene(_scene(0), 0)  # after the end: counted, not written
    assert recorder.written + recorder.dropped == 101


def test_a_message_that_cannot_be_encoded_costs_only_itself(tmp_path: Path, caplog) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, _info(), threaded=False) as recorder:
        recorder.on_scene(SimpleNamespace(stamp_ns=object()), 1)  # type: ignore[arg-type]
        recorder.on_scene(_scene(1), 2)
    assert (recorder.dropped, recorder.written) == (1, 1)
    assert len(open_recording(path).scenes) == 1


def test_a_file_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "monday.mcap"
    _record(path, 3)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="already exists, and is kept"):
        Recorder(path, _info(), threaded=False)
    assert path.read_bytes() == before
    with Recorder(OneFile(path, overwrite=True), _info(), threaded=False) as recorder:
        recorder.on_received("x", Received(Acknowledge(3, 9), 15))
    assert path.read_bytes() != before


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_that_is_being_recorded_is_not_overwritten(tmp_path: Path, overwrite: bool) -> None:
    path = tmp_path / "monday.mcap"
    with Recorder(OneFile(path, overwrite), _info(), threaded=False) as recorder:
        recorder.on_scene(_scene(1), 1)
        with pytest.raises(RecordingError, match="another node records there; name another file"):
            Recorder(OneFile(path, overwrite=True), _info(), threaded=False)
        recorder.on_scene(_scene(2), 2)
    assert len(open_recording(path).scenes) == 2
    Recorder(OneFile(path, overwrite=True), _info(), threaded=False).close()


@pytest.mark.parametrize("threaded", [False, True])
def test_a_recording_of_nothing_leaves_no_file(tmp_path: Path, threaded: bool) -> None:
    """A start that failed does not stand in the way of the next one."""
    path = tmp_path / "monday.mcap"
    recorder = Recorder(path, _info(), threaded=threaded)
    assert path.exists()
    recorder.close()
    assert not path.exists()
    assert recorder.report()["files"] == 0
    _record(path, 3, threaded)
    assert len(open_recording(path).scenes) == 3


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="another file"):
        Recorder(tmp_path / "no" / "a.mcap", _info(), threaded=False)
