"""A disk that is full costs what comes meanwhile; the node and the recording go on."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.recording import Recorder, open_recording
from hri_predict.recording.mcap import file as mcap_file
from hri_predict.recording.mcap.items import Item
from hri_predict.recording.mcap.places import OneFile
from tests.hri_predict.recording.mcap.made_up import info, scene, tick


class _Disk:
    """``os.write`` of a disk that is full for a while: it takes some bytes, then none."""

    def __init__(self, left: int) -> None:
        self.left, self.write = left, os.write

    def __call__(self, descriptor: int, data: bytes) -> int:
        if self.left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = self.write(descriptor, bytes(data[: self.left]))
        self.left -= count
        return count


def test_a_full_disk_costs_what_comes_meanwhile_and_recording_goes_on(
    tmp_path: Path, monkeypatch, caplog
) -> None:
    disk = _Disk(200_000)
    monkeypatch.setattr(mcap_file.os, "write", disk)
    recorder = Recorder(tmp_path / "a.mcap", info(), threaded=False)
    for k in range(400):
        if k == 200:
            assert recorder.error == "No space left on device"
            assert recorder.dropped > 0
            disk.left = 10**9
        recorder.on_scene(scene(k), 40_000_000 * k)
        recorder.on_tick(tick(k))
    recorder.close()
    assert recorder.error is None
    assert recorder.failures >= 1
    recording = open_recording(tmp_path / "a.mcap")
    assert recording.note == ""  # whole: what the disk did not take at once came later
    gaps = np.diff([each.sequence for each in recording.scenes])
    assert (gaps > 3).sum() == 1  # one hole, as long as the disk was full
    assert recording.scenes[-1].sequence == 3 * 399
    assert "No space left" in caplog.text
    assert "continues; lost" in caplog.text


def test_a_disk_that_stays_full_is_said_at_a_limited_rate(tmp_path, monkeypatch, caplog) -> None:
    monkeypatch.setattr(mcap_file.os, "write", _Disk(50_000))
    with Recorder(tmp_path / "a.mcap", info(), threaded=False) as recorder:
        for k in range(5 * 60 * 2):  # ten minutes
            recorder.on_tick(tick(25 * k))
    assert recorder.error == "No space left on device"
    assert 5 <= len(caplog.records) <= 12
    assert recorder.report()["dropped"] > 1000


class _Counted(Recorder):
    """Counts what it takes."""

    taken = 0

    def take(self, item: Item) -> None:
        self.taken += 1
        super().take(item)


@pytest.mark.parametrize("left", [20_000, 40_000, 60_000])
def test_each_message_is_written_or_counted_as_dropped(tmp_path, monkeypatch, left) -> None:
    """One of those at which the disk was found to be full was in neither count."""
    monkeypatch.setattr(mcap_file.os, "write", _Disk(left))
    with _Counted(tmp_path / "a.mcap", info(), threaded=False) as recorder:
        for k in range(300):
            recorder.on_scene(scene(k), 40_000_000 * k)
            recorder.on_tick(tick(k))
    assert recorder.failures >= 1
    assert recorder.dropped > 0
    assert recorder.written + recorder.dropped == recorder.taken


def test_a_start_on_a_full_disk_is_not_in_the_way_of_the_next(tmp_path, monkeypatch) -> None:
    path = tmp_path / "a.mcap"
    with monkeypatch.context() as patch:
        patch.setattr(mcap_file.os, "write", _Disk(0))
        with pytest.raises(RecordingError, match="No space left on device"):
            Recorder(path, info(), threaded=False)
    assert not path.exists()
    Recorder(path, info(), threaded=False).close()


def test_a_file_to_overwrite_is_not_removed_by_a_start_on_a_full_disk(
    tmp_path, monkeypatch
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"old")
    monkeypatch.setattr(mcap_file.os, "write", _Disk(0))
    with pytest.raises(RecordingError, match="No space left on device"):
        Recorder(OneFile(path, overwrite=True), info(), threaded=False)
    assert path.exists()


def test_a_full_device_is_not_removed(monkeypatch) -> None:
    """As root, a device could be."""
    removed = list[Path]()
    monkeypatch.setattr(Path, "unlink", lambda path, missing_ok=False: removed.append(path))
    with pytest.raises(RecordingError, match="No space left on device"):
        Recorder(Path("/dev/full"), info(), threaded=False)
    assert removed == []
