"""Evidence: the seconds around an event, in a file that replays, in a chain that holds."""

import errno
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.operation.evidence import chain
from hri_predict.operation.evidence.keeper import Evidence
from hri_predict.operation.evidence.settings import EvidenceSettings
from hri_predict.protocol.messages import Level
from hri_predict.recording import RecordingInfo, open_recording
from tests.hri_predict.operation.evidence.ticks import MS, tick

INFO = RecordingInfo(
    joint_map=load_joint_map("canonical"),
    rate_hz=25.0,
    declares_noise=True,
    config="rate_hz: 25",
)
CLEAR, STOP = Level.CLEAR, Level.STOP


class Run:
    """A run of a node: 25 ticks and scenes a second, at clear but where told otherwise."""

    def __init__(self, folder, *, threaded=False, **settings):
        self.now_ms = 1000.0
        start = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
        asked = {"folder": "kept", "before_s": 1.0, "after_s": 0.5, **settings}
        self.evidence = Evidence(
            EvidenceSettings.model_validate(asked),
            folder,
            INFO,
            robots=["arm 1"],
            links=[("base", "upper", "hand")],
            threaded=threaded,
            wall=lambda: start + timedelta(milliseconds=self.now_ms),
        )

    def go(self, seconds, level=CLEAR, near=()):
        for _ in range(round(seconds * 25)):
            self.now_ms += 40
            joints = np.full((len(CANONICAL.joints), 3), self.now_ms * 1e-6)
            person = Person(7, joints, np.ones(len(joints), bool))
            now_ns = round(self.now_ms * MS)
            scene = Scene(now_ns - 20 * MS, round(self.now_ms / 40), True, (person,))
            self.evidence.on_scene(scene, now_ns)
            self.evidence.on_tick(tick(self.now_ms, level, near=near))
        return self

    def close(self):
        self.evidence.close()
        return self.evidence.report()


def events(folder):
    return [line.data for line in chain.read(folder / "kept") if "also" in line.data]


def wrong(folder):
    return [line for line in chain.read(folder / "kept") if line.wrong]


@pytest.mark.parametrize("threaded", [False, True])
def test_the_seconds_around_a_stop_are_kept_and_can_be_replayed(tmp_path, threaded):
    run = Run(tmp_path, threaded=threaded).go(3.0).go(0.2, STOP)
    stop_s = (run.now_ms - 160) / 1e3
    report = run.go(3.0).close()
    assert (report["kept"], report["events"], report["failures"]) == (1, {"stop": 1}, 0)
    (event,) = events(tmp_path)
    assert (event["kind"], event["robot"], event["reason"]) == ("stop", "arm 1", "PERSON_NEAR")
    assert event["file"].endswith("-arm_1-stop.mcap")
    recording = open_recording(tmp_path / "kept" / event["file"])
    arrivals = np.asarray(recording.arrival_ns) * 1e-9
    assert arrivals.min() == pytest.approx(stop_s - 1.0, abs=0.081)
    assert arrivals.max() == pytest.approx(stop_s + 0.5, abs=0.081)
    assert not wrong(tmp_path)


def test_an_event_that_goes_on_stays_in_one_file(tmp_path):
    run = Run(tmp_path).go(2.0)
    for _ in range(3):
        run.go(0.2, STOP).go(0.2)
    assert run.go(2.0).close()["events"] == {"stop": 3}
    (event,) = events(tmp_path)
    assert [(each["robot"], each["kind"]) for each in event["also"]] == [("arm 1", "stop")] * 2


def test_an_event_that_never_ends_is_cut(tmp_path):
    run = Run(tmp_path)
    for _ in range(330):
        run.go(0.2, STOP).go(0.2)
    assert run.close()["kept"] >= 2


def test_a_stop_at_the_end_of_a_long_event_has_its_seconds_afterwards(tmp_path):
    """Near misses all the time keep a file open for a minute."""
    run = Run(tmp_path, of=["stop", "near_miss"], after_s=3.0)
    for _ in range(29):
        run.go(0.1, near=(0,)).go(1.9)
    run.go(0.4, STOP).go(5.0).close()
    entries = events(tmp_path)
    last = open_recording(tmp_path / "kept" / entries[-1]["file"])
    assert last.scenes[-1].stamp_ns >= (run.now_ms - 5000.0 + 2500.0) * MS


def test_near_misses_are_counted_by_body_part_and_link(tmp_path):
    report = Run(tmp_path, of=["stop"]).go(1.0, near=(0,)).go(2.0).go(0.1, near=(0,)).close()
    assert report["near_misses"] == [
        {"robot": "arm 1", "body_part": "l_hand", "robot_link": "hand", "count": 2}
    ]
    assert report["kept"] == 0  # counted, and not kept: it was not asked for


def test_the_event_that_is_open_at_the_end_is_kept(tmp_path):
    assert Run(tmp_path).go(1.0).go(0.1, STOP).close()["kept"] == 1
    assert not wrong(tmp_path)


def test_the_next_run_continues_the_chain(tmp_path):
    Run(tmp_path).go(1.0).go(0.1, STOP).close()
    Run(tmp_path).go(1.0).close()
    kinds = [line.data["kind"] for line in chain.read(tmp_path / "kept")]
    assert kinds == ["start", "stop", "end", "start", "end"]
    assert not wrong(tmp_path)


def test_a_torn_log_is_set_aside_and_the_node_starts(tmp_path):
    Run(tmp_path).go(1.0).close()
    log = tmp_path / "kept" / chain.LOG
    log.write_bytes(log.read_bytes()[:-9])
    Run(tmp_path).close()
    first = next(chain.read(tmp_path / "kept")).data
    assert (tmp_path / "kept" / first["broken"]).exists()
    assert not wrong(tmp_path)


def test_a_broken_log_after_a_full_one_still_continues_it(tmp_path, monkeypatch):
    monkeypatch.setattr(chain, "FULL_BYTES", 100)
    Run(tmp_path).go(1.0).close()
    log = tmp_path / "kept" / chain.LOG
    log.write_bytes(log.read_bytes()[:-9])
    Run(tmp_path).close()
    assert not wrong(tmp_path)
    continued = [line.data.get("continues") for line in chain.read(tmp_path / "kept")]
    assert continued == [None, "evidence-000001.jsonl", "evidence-000002.jsonl"]


def test_a_line_says_how_long_before_the_event_its_file_begins(tmp_path):
    Run(tmp_path, before_s=5.0).go(1.0).go(0.04, STOP).go(9.0).go(0.04, STOP).close()
    stops = [each.data for each in chain.read(tmp_path / "kept") if each.data["kind"] == "stop"]
    assert [each["before_s"] for each in stops] == pytest.approx([1.0, 5.0], abs=0.08)


def test_the_oldest_give_way_and_the_log_says_so(tmp_path):
    noise = np.random.default_rng(0)
    run = Run(tmp_path, max_mb=1.0, after_s=0.0)
    joints = len(CANONICAL.joints)
    for number in range(40):
        for k in range(100):  # what does not compress
            person = Person(7, noise.standard_normal((joints, 3)), np.ones(joints, bool))
            now_ns = round(run.now_ms * MS)
            run.evidence.on_scene(Scene(now_ns, number * 100 + k, True, (person,)), now_ns)
        run.go(0.04, STOP).go(1.2)
    run.close()
    kept = list((tmp_path / "kept").glob("*.mcap"))
    assert sum(path.stat().st_size for path in kept) <= 1e6
    assert len(kept) < 40
    assert any(line.data["kind"] == "room" for line in chain.read(tmp_path / "kept"))
    assert not wrong(tmp_path)


def crowded(folder):
    """A run whose events are each larger than half of the limit."""
    noise, joints = np.random.default_rng(0), len(CANONICAL.joints)
    run = Run(folder, max_mb=1.0, after_s=0.0)
    while True:
        for k in range(1000):  # what does not compress
            person = Person(7, noise.standard_normal((joints, 3)), np.ones(joints, bool))
            now_ns = round(run.now_ms * MS)
            run.evidence.on_scene(Scene(now_ns, k, True, (person,)), now_ns)
        run.go(0.04, STOP).go(1.2)
        yield run


def room_lines(folder):
    return [e.data["removed"] for e in chain.read(folder / "kept") if e.data["kind"] == "room"]


def test_a_file_is_deleted_only_after_the_log_names_it(tmp_path, monkeypatch):
    """A node that was killed in between left a chain that names a missing file for ever."""
    runs = crowded(tmp_path)
    run = next(runs)
    unlink = Path.unlink

    def named_before(path, missing_ok=False):
        assert path.name.removesuffix(".removing") in str(room_lines(tmp_path))
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", named_before)
    next(runs)
    next(runs)
    assert run.close()["failures"] == 0
    assert room_lines(tmp_path)
    assert not wrong(tmp_path)


@pytest.mark.parametrize("killed_at", ["append", "unlink"])
def test_a_node_killed_while_it_makes_room_leaves_a_true_chain(tmp_path, monkeypatch, killed_at):
    class Killed(BaseException):
        """No code of the node catches it."""

    def killed(*args, **kwargs):
        if killed_at == "unlink" or args[1]["kind"] == "room":
            raise Killed
        return append(*args)

    append = chain.append
    runs = crowded(tmp_path)
    run = next(runs)
    with monkeypatch.context() as patch:
        patch.setattr(*((Path, "unlink") if killed_at == "unlink" else (chain, "append")), killed)
        with pytest.raises(Killed):
            [next(runs) for _ in range(3)]
    run.evidence._only.close()  # as the system does with a killed process's locks
    Run(tmp_path, max_mb=1.0).close()
    assert not wrong(tmp_path)
    assert not list((tmp_path / "kept").glob("*.removing"))


def test_a_file_that_cannot_be_removed_stays_and_a_newer_one_gives_way(
    tmp_path, monkeypatch, caplog
):
    runs = crowded(tmp_path)
    run = next(runs)
    (oldest,) = (tmp_path / "kept").glob("*.mcap")
    for name in ("rename", "unlink"):
        refuse(monkeypatch, name, oldest)
    for _ in range(3):
        next(runs)
    assert run.close()["kept"] == 4
    assert oldest.exists()
    assert f"{oldest.name}: cannot be removed: Operation not permitted" in caplog.text
    names = [name for line in room_lines(tmp_path) for name in line]
    assert names
    assert oldest.name not in names
    assert not wrong(tmp_path)


def refuse(monkeypatch, name, refused):
    """Let a method of ``Path`` fail for one path, as for a file with the flag *immutable*."""
    method = getattr(Path, name)

    def fails(path, *args, **kwargs):
        if path == refused:
            raise PermissionError(errno.EPERM, "Operation not permitted")
        return method(path, *args, **kwargs)

    monkeypatch.setattr(Path, name, fails)


def test_no_file_is_removed_without_a_line(tmp_path, monkeypatch):
    """On a full disk, for example."""
    append = chain.append

    def full(folder, entry, last):
        if entry["kind"] == "room":
            raise OSError(errno.ENOSPC, "No space left on device")
        return append(folder, entry, last)

    monkeypatch.setattr(chain, "append", full)
    runs = crowded(tmp_path)
    run = next(runs)
    next(runs)
    next(runs)
    assert run.close()["failures"] >= 1
    assert len(list((tmp_path / "kept").glob("*.mcap"))) == 3
    assert not wrong(tmp_path)
    monkeypatch.undo()
    run = Run(tmp_path, max_mb=1.0)
    run.go(1.0).go(0.04, STOP).close()
    assert len(list((tmp_path / "kept").glob("*.mcap"))) < 4
    assert not wrong(tmp_path)


def test_a_file_is_on_the_disk_before_its_line(tmp_path, monkeypatch):
    """Otherwise a power failure leaves an intact run that seems to have been changed."""
    synced = list[tuple[str, int]]()
    fsync = os.fsync

    def noted(descriptor):
        path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
        synced.append((path.name, path.stat().st_size if path.suffix == ".mcap" else 0))
        fsync(descriptor)

    run = Run(tmp_path).go(1.0)
    monkeypatch.setattr(os, "fsync", noted)
    run.go(0.04, STOP).go(2.0)
    (file,) = (tmp_path / "kept").glob("*.mcap")
    assert synced == [(file.name, file.stat().st_size), ("kept", 0), (chain.LOG, 0)]
    run.close()


def test_two_nodes_do_not_share_a_folder(tmp_path):
    first = Run(tmp_path)
    with pytest.raises(ConfigError, match="another node keeps its evidence there"):
        Run(tmp_path)
    first.close()
    Run(tmp_path).close()


def test_a_folder_that_cannot_be_used_is_one_line(tmp_path):
    (tmp_path / "kept").write_text("a file")
    with pytest.raises(ConfigError, match=r"evidence.folder .*kept: .*; name another folder"):
        Run(tmp_path)


def test_a_folder_that_vanishes_is_counted_and_the_run_goes_on(tmp_path):
    run = Run(tmp_path).go(1.0)
    (tmp_path / "kept").rename(tmp_path / "elsewhere")
    report = run.go(0.1, STOP).go(2.0).close()
    assert report["failures"] >= 1
    assert report["dropped"] > 0


def test_files_of_others_in_the_folder_are_left_alone(tmp_path):
    (tmp_path / "kept").mkdir()
    mine = tmp_path / "kept" / "0000-mine.mcap"
    mine.write_bytes(b"x" * 3_000_000)
    (tmp_path / "kept" / "0.mcap").symlink_to("nowhere")
    run = Run(tmp_path, max_mb=1.0)
    for _ in range(3):
        run.go(0.1, STOP).go(2.0)
    assert run.close()["kept"] == 3
    assert mine.exists()
    assert len(list((tmp_path / "kept").glob("2026*.mcap"))) == 3


def test_a_wall_clock_that_is_set_back_overwrites_nothing(tmp_path):
    for _ in range(2):  # both runs begin at the same time, by the wall clock
        Run(tmp_path).go(1.0).go(0.1, STOP).go(2.0).close()
    assert len(list((tmp_path / "kept").glob("*.mcap"))) == 2
    assert not wrong(tmp_path)


def test_many_events_at_once_make_no_endless_line(tmp_path):
    run = Run(tmp_path, after_s=30.0)
    for _ in range(100):
        run.go(0.04, STOP).go(0.04)
    run.close()
    (event,) = events(tmp_path)
    assert (len(event["also"]), event["more"]) == (50, 49)


def test_a_full_ring_is_still_written_when_the_node_ends(tmp_path):
    run = Run(tmp_path, threaded=True, before_s=30.0).go(30.0).go(0.04, STOP)
    assert run.close()["kept"] == 1
    assert next(reversed([*chain.read(tmp_path / "kept")])).data["kind"] == "end"
