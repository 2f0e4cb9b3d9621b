"""The scene stream over a serial line: a pseudo-terminal, garbage, a key."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.scene_stream.codec import encode
from hri_drivers.sources.scene_stream.key_file import read_key
from hri_drivers.sources.scene_stream.receiver import SceneStream
from hri_drivers.sources.scene_stream.serial_source import MAX_ENCODED, FramedStream, framed
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_sim.wires.pty import open_pty

MAP = load_joint_map("canonical")
JOINTS = MAP.source_joints
Hear = Callable[..., Any]


def scene(sequence: int, people: int = 1) -> SentScene:
    positions = np.arange(len(JOINTS) * 3, dtype=np.float64).reshape(-1, 3) / 16
    everybody = tuple(
        SentPerson(number, positions + number, np.ones(len(JOINTS), np.bool_))
        for number in range(people)
    )
    return SentScene(
        stamp_ns=time.time_ns(), sequence=sequence, sees_room=True, people=everybody, session=1
    )


def sent(sequence: int, people: int = 1, key: Any = None) -> bytes:
    return b"".join(framed(data) for data in encode(scene(sequence, people), JOINTS, key))


def stream() -> tuple[FramedStream, SourceCounters]:
    counters = SourceCounters()
    return FramedStream(SceneStream(joint_map=MAP, counters=counters), counters), counters


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    master, path = open_pty()
    yield master, path
    os.close(master)


@pytest.mark.realtime
def test_people_come_over_the_line(hear: Hear, line: tuple[int, str]) -> None:
    master, path = line
    ear = hear("serial_skeleton", port=path)
    os.write(master, sent(1, people=7))  # in two datagrams
    (heard,) = ear.scenes(1)
    assert [person.id for person in heard.people] == list(range(7))
    np.testing.assert_array_equal(heard.people[6].positions, scene(1, 7).people[6].positions)


@pytest.mark.realtime
def test_with_a_key_nothing_else_is_believed(
    hear: Hear, line: tuple[int, str], tmp_path: Path
) -> None:
    master, path = line
    file = tmp_path / "key"
    file.write_text("0123456789abcdef" * 4)
    file.chmod(0o600)
    key = read_key(str(file))
    ear = hear("serial_skeleton", port=path, key_file=str(file))
    os.write(master, sent(1))
    ear.wait(lambda: ear.counters.unauthenticated == 1)
    os.write(master, sent(2, key=key) * 2)
    ear.scene()
    ear.wait(lambda: ear.counters.replayed == 1)


@pytest.mark.realtime
def test_a_line_that_is_unplugged_is_lost_and_asked_for_again(hear: Hear) -> None:
    master, path = open_pty()
    ear = hear("serial_skeleton", port=path)
    os.close(master)
    ear.wait(lambda: ear.counters.disconnects == 1)
    assert not ear.source.connected
    assert path in ear.counters.last_error


@given(st.binary(max_size=300), st.integers(0, 400), st.integers(1, 50))
def test_garbage_costs_no_more_than_the_frame_it_touches(
    garbage: bytes, at: int, step: int
) -> None:
    receiver, counters = stream()
    damaged = sent(1)[:at] + garbage + sent(1)[at:]
    data = damaged + b"\0" + sent(2) + sent(3)
    heard = []
    for start in range(0, len(data), step):
        heard += receiver.feed(data[start : start + step], 0)
    assert [one.sequence for one in heard][-2:] == [2, 3]
    assert len(heard) <= 3
    # "unauthenticated": the damage may set the flag that announces a key
    refused = counters.malformed + counters.crc_errors + counters.unauthenticated
    assert garbage == b"" or len(heard) == 3 or refused > 0


def test_a_frame_that_does_not_end_is_skipped_in_bounded_memory() -> None:
    receiver, counters = stream()
    for _ in range(1000):
        assert not receiver.feed(b"\x01" * 500, 0)
    assert len(receiver._frames._buffer) <= MAX_ENCODED
    assert len(receiver.feed(b"\0" + sent(1), 0)) == 1
    assert counters.malformed == 1
