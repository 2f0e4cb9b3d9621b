"""Recordings of format 1, whose log times are the node's clock, are read as ever.

``format1.mcap`` was recorded by version 0.1 of the node: a second of a procedural person who stands
beside a robot at rest, at 10 scenes per second.
"""

from pathlib import Path

import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.recording import moment, open_recording, read_messages, recording_info

PATH = Path(__file__).parent / "format1.mcap"


def test_its_scenes_are_read():
    recording = open_recording(PATH)
    assert recording.note == ""
    assert [scene.sequence for scene in recording.scenes] == list(range(10))
    assert recording.rate_hz == 10
    assert recording.utc_ns == ()
    assert "kind: procedural" in recording.config


def test_its_messages_are_read_on_the_nodes_clock():
    assert not recording_info(PATH).has_utc
    told = list(read_messages(PATH, ["/status", "/advice"]))
    assert {message.topic for message in told} == {"/status", "/advice"}
    assert all(message.utc_ns == message.node_ns >= 10**9 for message in told)
    then = moment(PATH, 1_500_000_000)
    assert then.status is not None
    assert then.advice["0"].data["level"] in ("UNKNOWN", "STOP")
    assert then.scene is not None
    assert then.scene.data["sequence"] == 5


def test_another_format_is_refused_with_its_number(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(PATH.read_bytes().replace(b"\x01\x00\x00\x001", b"\x01\x00\x00\x009", 1))
    with pytest.raises(RecordingError, match="format '9', this version reads '1' and '2'"):
        recording_info(path)
