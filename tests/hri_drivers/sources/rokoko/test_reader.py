"""Rokoko Studio's JSON v3: its sample, compression, and bytes that are not it."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.mocap.frames import FrameError
from hri_drivers.sources.rokoko import source as rokoko_reader
from hri_drivers.sources.rokoko.source import LZ4_MAGIC, MAX_JSON, RokokoReader
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders import rokoko

BODY = Body(1.75)
JOINTS = BODY.joints(BODY.standing(np.array([1.0, 2.0]), 0.3))
MAP = load_joint_map("rokoko23")
SAMPLE: dict[str, Any] = {
    "version": 3,
    "fps": 60,
    "scene": {
        "timestamp": 14.5,
        "actors": [
            {
                "name": "Dimitris",
                "meta": {"hasGloves": True, "hasBody": True, "hasFace": True},
                "dimensions": {"totalHeight": 1.8, "hipHeight": 1.0},
                "body": {
                    "hip": {
                        "position": {"x": 0.25, "y": 1.0, "z": -2},
                        "rotation": {"x": 0, "y": 0, "z": 0, "w": 1},
                    },
                    "leftHand": {
                        "position": {"x": 0, "y": 0, "z": 0},
                        "rotation": {"x": 0, "y": 0, "z": 0, "w": 1},
                    },
                },
            }
        ],
        "props": [],
    },
}


def fresh() -> RokokoReader:
    return RokokoReader(MAP.source_joints, SourceCounters())


def changed(change: dict[str, Any]) -> bytes:
    return json.dumps(SAMPLE | change).encode()


def test_the_makers_sample_in_our_axes() -> None:
    """Right 0.25 m, up 1 m, back 2 m; a part at the origin was not measured."""
    frame = fresh().read(json.dumps(SAMPLE).encode())
    assert frame is not None
    (person,) = frame.people
    assert frame.stamp_ns == 14_500_000_000
    assert np.flatnonzero(person.observed).tolist() == [MAP.source_joints.index("hip")]
    assert MAP.to_metres_z_up(person.positions[0]).tolist() == [-2.0, -0.25, 1.0]


@pytest.mark.parametrize("lz4", [False, True])
def test_every_joint_is_where_the_actor_has_it(lz4: bool) -> None:
    if lz4:
        pytest.importorskip("lz4", reason="needs the extra rokoko")
    frame = fresh().read(rokoko.capture({"Ann": JOINTS, "Bob": JOINTS + 1.0}, 2.0, lz4=lz4))
    assert frame is not None
    assert [person.id for person in frame.people] == [1, 2]
    joints, seen = MAP.map(MAP.to_metres_z_up(frame.people[0].positions), frame.people[0].observed)
    assert seen.sum() == 17
    assert np.abs(joints - JOINTS)[seen].max() < 1e-5  # sent to 0.01 mm


def test_a_name_keeps_its_id() -> None:
    reader = fresh()
    reader.read(rokoko.capture({"Ann": JOINTS, "Bob": JOINTS}, 1.0))
    frame = reader.read(rokoko.capture({"Bob": JOINTS}, 2.0))
    assert frame is not None
    assert [person.id for person in frame.people] == [2]


def test_an_actor_without_a_suit_is_somewhere() -> None:
    scene = SAMPLE["scene"]["actors"][0] | {"meta": {"hasBody": False}, "body": None}
    frame = fresh().read(changed({"scene": SAMPLE["scene"] | {"actors": [scene]}}))
    assert frame is not None
    assert (frame.people, frame.complete) == ((), False)


@pytest.mark.parametrize("version", [3, 3.0, "3,0", "3.0", 4])
def test_each_way_to_write_the_version_is_taken(version: object) -> None:
    assert fresh().read(changed({"version": version})) is not None


def scene(change: dict[str, Any]) -> dict[str, Any]:
    return {"scene": SAMPLE["scene"] | change}


ACTOR = SAMPLE["scene"]["actors"][0]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b"[1]", "not a JSON object"),
        (b"[" * 20_000, "nested too deeply|not JSON"),
        (changed({"version": 2}), "select JSON v3"),
        (b'{"version": 3, "timestamp": 1, "trackers": []}', "JSON v2"),
        (changed(scene({"timestamp": None})), "not a number"),
        (changed(scene({"timestamp": 1e300})), "time stamp"),
        (changed(scene({"actors": [ACTOR, ACTOR]})), "same name"),
        (changed(scene({"actors": [ACTOR] * 65})), "more than 64"),
        (changed(scene({"actors": [ACTOR | {"body": {}}]})), "without any joint"),
        (changed(scene({"actors": [ACTOR | {"body": {"hip": 1}}]})), "position"),
        (b'{"version": 3, "scene": {"timestamp": 1, "actors": [NaN]}}', "NaN"),
    ],
)
def test_what_is_not_a_capture_is_refused_with_the_remedy(data: bytes, says: str) -> None:
    with pytest.raises(FrameError, match=says):
        fresh().read(data)


def test_a_compressed_capture_without_the_package_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rokoko_reader, "has_lz4", lambda: False)
    with pytest.raises(FrameError, match=r"pip install 'hri-predict\[rokoko\]'"):
        fresh().read(LZ4_MAGIC + bytes(8))


def test_a_compressed_datagram_cannot_fill_the_memory() -> None:
    frame = pytest.importorskip("lz4.frame", reason="needs the extra rokoko")
    with pytest.raises(FrameError, match="cut short, or has more than"):
        fresh().read(frame.compress(bytes(50 * MAX_JSON)))


@given(st.binary(max_size=100), st.integers(0, 3000), st.booleans())
def test_any_bytes_are_a_capture_or_refused(junk: bytes, at: int, compressed: bool) -> None:
    sound = rokoko.capture({"Ann": JOINTS}, 1.0)
    for data in (junk, sound[:at] + junk + sound[at + len(junk) :]):
        try:
            frame = fresh().read((LZ4_MAGIC if compressed else b"") + data)
        except FrameError:
            continue
        for person in frame.people if frame is not None else ():
            assert np.isfinite(person.positions[person.observed]).all()
