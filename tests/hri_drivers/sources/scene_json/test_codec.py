"""Scenes in JSON: values worked by hand, refusals that say what to do, hostile input."""

import contextlib
import json
import random
import re
import time
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.scene_json.codec import (
    MAX_BYTES,
    LineSplitter,
    PersonMessage,
    SceneJsonError,
    SceneMessage,
    SceneReader,
)
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters

JOINTS = load_joint_map("canonical").source_joints


def message(**changes: Any) -> dict[str, Any]:
    return {
        "format": "hri-scene/1",
        "sequence": 7,
        "stamp_s": 1.5,
        "sees_room": True,
        "units": "m",
        "axes": ["x", "y", "z"],
        "people": [{"id": 3, "joints": {"head": [1, 2.5, 3]}}],
    } | changes


def reader(min_confidence: float = 0.5) -> SceneReader:
    return SceneReader(JOINTS, min_confidence, SourceCounters())


def read(**changes: Any) -> SentScene:
    return reader().read(json.dumps(message(**changes)))


def joint(person: SentPerson, name: str) -> list[float] | None:
    index = JOINTS.index(name)
    return person.positions[index].tolist() if person.observed[index] else None


def test_a_scene() -> None:
    scene = read()
    assert (scene.stamp_ns, scene.sequence, scene.sees_room) == (1_500_000_000, 7, True)
    (person,) = scene.people
    assert person.id == 3
    assert joint(person, "head") == [1.0, 2.5, 3.0]
    assert np.count_nonzero(person.observed) == 1


def test_an_empty_room_and_an_unseen_one_are_told_apart() -> None:
    assert read(people=[]).sees_room
    assert not read(people=[], sees_room=False).sees_room


def test_the_error_of_a_place_is_in_metres_whatever_the_unit_is() -> None:
    people = [{"id": 0, "joints": {}, "error_m": 0.4}, {"id": 1, "joints": {}}]
    assert [p.error_m for p in read(units="mm", people=people).people] == [0.4, 0.0]
    sent = read(people=[{"id": 0, "joints": {"head": [1, 2, 3]}, "error_m": 20}])
    assert [p.error_m for p in sent.in_room(np.diag([2.0, 2.0, 2.0, 1.0])).people] == [20.0]


@pytest.mark.parametrize("error_m", [-0.1, 20.1, "0.4", None, True, [0.4]])
def test_an_error_that_can_be_none_is_refused(error_m: Any) -> None:
    with pytest.raises(SceneJsonError, match="error_m"):
        read(people=[{"id": 0, "joints": {}, "error_m": error_m}])


def test_millimetres_of_a_camera() -> None:
    """A camera's z is forward, its x right, its y down: 3 m ahead, 1 m to the right, 2 m up."""
    people = [{"id": 0, "joints": {"head": [1000, -2000, 3000]}}]
    (person,) = read(units="mm", axes=["z", "-x", "-y"], people=people).people
    assert joint(person, "head") == [3.0, -1.0, 2.0]


def test_a_left_handed_sender_says_so() -> None:
    """Unity: x right, y up, z forward."""
    people = [{"id": 0, "joints": {"head": [1, 2, 3]}}]
    axes = ["z", "-x", "y"]
    (person,) = read(axes=axes, left_handed=True, people=people).people
    assert joint(person, "head") == [3.0, -1.0, 2.0]
    with pytest.raises(SceneJsonError, match="left-handed"):
        read(axes=axes)


def test_joints_that_are_not_given_not_sure_or_not_known_are_unobserved() -> None:
    heard = reader(min_confidence=0.5)
    joints = {
        "head": None,
        "neck": [1, 1, 1, 0.4],
        "waist": [1, 1, 1, 0.5],
        "tail": [1, 1, 1],
    }
    (person,) = heard.read(json.dumps(message(people=[{"id": 0, "joints": joints}]))).people
    assert joint(person, "head") is None
    assert joint(person, "neck") is None
    assert joint(person, "waist") == [1.0, 1.0, 1.0]
    assert (heard.counters.unsure_joints, heard.counters.unknown_joints) == (1, 1)


def sent(heard: SceneReader, **joints: Any) -> SentPerson:
    (person,) = heard.read(json.dumps(message(people=[{"id": 0, "joints": joints}]))).people
    return person


def test_unknown_joints_are_named_once_with_what_the_first_may_mean() -> None:
    heard = reader()
    sent(heard, haed=[1, 1, 1])
    told = heard.counters.last_error
    assert told == "joints that the joint map does not have: haed; did you mean 'head'?"
    heard.counters.note("something newer")
    sent(heard, haed=[1, 1, 1])
    assert (heard.counters.last_error, heard.counters.unknown_joints) == ("something newer", 2)
    sent(heard, tail=[1, 1, 1], **{"x\n" * 900: [1, 1, 1]})
    told = heard.counters.last_error
    assert told is not None
    assert "haed, tail, x" in told
    assert "\n" not in told
    assert len(told) < 200


def test_a_name_that_differs_only_in_case_and_separators_is_known() -> None:
    heard = reader()
    assert joint(sent(heard, **{"HEAD ": [1, 2, 3]}), "head") == [1.0, 2.0, 3.0]
    assert heard.counters.unknown_joints == 0


def test_two_names_of_one_joint_are_none_unless_one_is_written_as_the_map_does() -> None:
    heard = reader()
    assert joint(sent(heard, Head=[1, 2, 3], HEAD=[4, 5, 6]), "head") is None
    person = sent(heard, Head=[1, 2, 3], head=[4, 5, 6])
    assert joint(person, "head") == [4.0, 5.0, 6.0]
    assert heard.counters.unknown_joints == 3


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": "hri-scene/2"}, "format"),
        ({"sequence": -1}, "sequence"),
        ({"sequence": 1.5}, "sequence"),
        ({"sequence": True}, "sequence"),
        ({"stamp_s": "1"}, "stamp_s"),
        ({"stamp_s": 10**400}, "stamp_s"),
        ({"sees_room": 1}, "sees_room"),
        ({"units": "cm"}, "units"),
        ({"axes": ["x", "y", "w"]}, "is not an axis"),
        ({"axes": ["x", "x", "z"]}, "different"),
        ({"see_room": True}, "did you mean 'sees_room'"),
        ({"people": [{"id": 1, "joints": {}}] * 2}, "same id"),
        ({"people": [{"id": 65536, "joints": {}}]}, "people.0.id"),
        ({"people": [{"id": 1, "joints": {"head": [1, 2]}}]}, "people.0.joints.head"),
        ({"people": [{"id": 1, "joints": {"head": [1, 2, 3, 1.5]}}]}, "0 to 1"),
        ({"people": [{"id": 1, "joints": {"head": [1, 2, True]}}]}, "people.0.joints.head"),
        ({"people": [{"id": i, "joints": {}} for i in range(65)]}, "people"),
    ],
)
def test_a_wrong_scene_is_refused_in_one_line_that_names_the_key(
    changes: dict[str, Any], says: str
) -> None:
    with pytest.raises(SceneJsonError, match=says) as error:
        read(**changes)
    assert "\n" not in str(error.value)


def test_a_key_that_is_missing_is_named() -> None:
    for key in message():
        with pytest.raises(SceneJsonError, match=f"{key}: required"):
            reader().read(json.dumps({k: v for k, v in message().items() if k != key}))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"null",
        b"[]",
        b"\xff\xfe{}",
        b"[" * 60_000,
        b'{"a":' * 12_000,
        b"NaN",
        b'{"stamp_s": Infinity}',
        b"1" * 60_000,
        b'{"format": 1, "format": 1}',
        '{"\\ud800\x1b[2J": "\u202e"}',
        json.dumps(message()).replace("2.5", "1e999"),
        json.dumps(message()).replace("2.5", "NaN"),
        json.dumps(message()).replace("2.5", "-Infinity"),
        " " * (MAX_BYTES + 1),
    ],
)
def test_what_is_no_scene_is_refused_in_a_line_fit_for_a_log(data: bytes | str) -> None:
    with pytest.raises(SceneJsonError) as error:
        reader().read(data)
    assert str(error.value).isascii()
    assert str(error.value).isprintable()


def test_huge_coordinates_are_no_place() -> None:
    text = json.dumps(message()).replace("2.5", "1e308")
    (person,) = reader().read(text.replace('"m"', '"mm"')).people
    assert np.isfinite(person.positions[person.observed]).all()


ATOMS = [None, True, -1, 0, 1, 2**63, 10**400, 0.5, -1e308, nan, inf, "", "m", "x", "\u202e\ud800"]


def anything(rng: random.Random, depth: int = 4) -> Any:
    """Any JSON at all, of the schema's own keys."""
    kind = rng.randrange(4 if depth else 2)
    if kind < 2:
        return rng.choice(ATOMS)
    inner = [anything(rng, depth - 1) for _ in range(rng.randrange(5))]
    if kind == 2:
        return inner
    return {rng.choice([*message(), "id", "joints", "head"]): value for value in inner}


def test_any_json_is_a_scene_or_refused() -> None:
    rng, heard = random.Random(0), reader()
    for _ in range(2000):
        changes = {key: anything(rng) for key in message() if rng.random() < 0.3}
        with contextlib.suppress(SceneJsonError):
            for person in heard.read(json.dumps(message() | changes)).people:
                assert np.isfinite(person.positions[person.observed]).all()


@given(st.binary(max_size=50), st.integers(0, 200))
def test_any_bytes_are_a_scene_or_refused(data: bytes, at: int) -> None:
    whole = json.dumps(message()).encode()
    for candidate in (data, whole[:at] + data + whole[at:], whole[:at]):
        with contextlib.suppress(SceneJsonError):
            reader().read(candidate)


@given(st.lists(st.binary(max_size=20).map(lambda b: b.replace(b"\n", b"")), max_size=8))
def test_lines_are_found_however_they_come(lines: list[bytes]) -> None:
    stream = b"".join(line + b"\n" for line in lines)
    splitter = LineSplitter()
    found = [line for byte in stream for line in splitter.feed(bytes([byte]))]
    assert found == [line.strip() for line in lines if line.strip()]
    assert found == list(LineSplitter().feed(stream))


def test_a_line_that_does_not_end_is_skipped_and_the_next_one_found() -> None:
    splitter = LineSplitter()
    pieces = [piece for _ in range(100) for piece in splitter.feed(b"x" * 10_000)]
    assert [len(piece) for piece in pieces] == [MAX_BYTES + 1]  # which the reader refuses
    assert list(splitter.feed(b"\n{}\n")) == [b"{}"]


PAGE = (Path(__file__).parents[4] / "drivers" / "SCENE_JSON.md").read_text(encoding="utf-8")


def test_the_example_of_the_page_is_what_the_page_says() -> None:
    example = re.search(r"```json\n(.*)\n```", PAGE)
    assert example
    scene = reader().read(example[1])
    assert (scene.sequence, scene.stamp_ns, scene.sees_room) == (1201, 48_033_000_000, True)
    (person,) = scene.people
    assert person.id == 7
    assert joint(person, "l_wrist") == pytest.approx([1.8, -0.25, 0.12])
    assert joint(person, "r_wrist") == pytest.approx([1.79, 0.26, 0.1])
    assert joint(person, "head") is None


def test_the_page_names_every_key() -> None:
    rows = set(re.findall(r"^\| `(?:people\[\]\.)?(\w+)` \|", PAGE, re.MULTILINE))
    assert rows == {*SceneMessage.model_fields, *PersonMessage.model_fields}


def test_the_program_of_the_page_sends_scenes() -> None:
    program = re.search(r"scene = (\{.*?\n        \})", PAGE, re.DOTALL)
    assert program
    names = {"sequence": 5, "time": time, "True": True}
    assert reader().read(json.dumps(eval(program[1], names))).sequence == 5
