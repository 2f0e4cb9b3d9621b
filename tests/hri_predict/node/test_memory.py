"""The state file: what survives, and every way in which it cannot be trusted."""

import contextlib
import itertools
import json
import os
import shutil
from typing import cast

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.node.listeners import Tick
from hri_predict.node.memory import LONG_AGO_S, STUCK_S, Memory, StateSettings

TICK = cast(Tick, None)  # the memory looks at its parts alone


OWN = b'{"version": 2, "cell": "here", "name": "n", "writes": 1, '
"""The head of a state file that its lock file vouches for."""


class Part:
    def __init__(self, data=None):
        self.data = data or {"latch": 0}
        self.recalled = self.why = None

    def remember(self):
        return self.data

    def recall(self, data, since_s):
        self.recalled = dict(data)
        self.recalled["latch"] = int(data["latch"])

    def distrust(self, why):
        self.why = why


class Node:
    """One run of a node on a state file, with its own wall clock."""

    def __init__(self, folder, now_s=1000.0, data=None, cell="here", **settings):
        self.now_s = now_s
        self.part = Part(data)
        self.memory = Memory(
            StateSettings(path="state.json", **settings),
            folder,
            {"part": self.part},
            cell=cell,
            wall_s=lambda: self.now_s,
            threaded=False,
        )

    def run(self, seconds=0.0):
        self.memory.open()
        self.memory.on_tick(TICK)
        self.now_s += seconds
        self.memory.on_tick(TICK)
        self.memory.close()
        return self


def test_what_was_known_is_known_again(tmp_path):
    Node(tmp_path, data={"latch": 7}).run()
    later = Node(tmp_path, 1060.0).run()
    assert later.part.recalled == {"latch": 7}
    assert later.part.why is None


def test_a_first_run_is_distrusted_in_one_line_and_leaves_a_file(tmp_path, caplog):
    first = Node(tmp_path).run()
    assert first.part.recalled is None
    assert "first start" in first.part.why
    assert "acknowledge once" in first.part.why
    assert len(caplog.records) == 1
    assert "\n" not in caplog.records[0].getMessage()
    assert Node(tmp_path, 1060.0).run().part.why is None


def runs(folder, *latches):
    """One run after another on the state file, each with its own data."""
    for i, latch in enumerate(latches):
        Node(folder, 1000.0 + 60.0 * i, data={"latch": latch}).run()


def distrusted(folder, now_s=2000.0, **other):
    """Why the next run does not believe the state file; it must not recall it, either."""
    later = Node(folder, now_s, **other).run()
    assert later.part.recalled is None
    return later.part.why


def test_a_deleted_file_is_not_a_first_start_that_knows_nothing_of_lost_people(tmp_path):
    runs(tmp_path, 1)
    (tmp_path / "state.json").unlink()
    assert "deleted" in distrusted(tmp_path)


def test_a_folder_that_was_deleted_is_distrusted(tmp_path):
    folder = tmp_path / "state"
    runs(folder, 1)
    shutil.rmtree(folder)
    assert "deleted" in distrusted(folder)


@pytest.mark.parametrize("keeps_times", [True, False])
def test_a_file_from_a_backup_is_recognised(tmp_path, keeps_times):
    state, backup = tmp_path / "state.json", tmp_path / "backup.json"
    runs(tmp_path, 1)
    (shutil.copy2 if keeps_times else shutil.copy)(state, backup)
    runs(tmp_path, 2)
    os.replace(backup, state)
    assert "older than the last one: write 1 of 2" in distrusted(tmp_path)


def test_a_folder_from_a_backup_is_recognised(tmp_path):
    folder, backup = tmp_path / "state", tmp_path / "backup"
    runs(folder, 1)
    shutil.copytree(folder, backup)
    runs(folder, 2)
    shutil.rmtree(folder)
    shutil.copytree(backup, folder)
    assert "was put there" in distrusted(folder)


def test_a_file_without_its_lock_file_proves_nothing(tmp_path):
    runs(tmp_path, 1)
    (tmp_path / "state.json.lock").unlink()
    assert "no lock file" in distrusted(tmp_path)


def test_a_lock_file_that_is_older_than_the_file_proves_nothing(tmp_path):
    lock = tmp_path / "state.json.lock"
    runs(tmp_path, 1)
    old = lock.read_bytes()
    runs(tmp_path, 2)
    lock.write_bytes(old)
    assert "newer than its lock file" in distrusted(tmp_path)


def test_the_file_of_another_cell_is_recognised(tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    runs(here, 1)
    Node(there, cell="there").run()
    for name in ("state.json", "state.json.lock"):
        shutil.copy(there / name, here / name)
    assert "another cell" in distrusted(here)
    runs(here, 1)
    assert "another cell" in distrusted(here, cell="there")  # the same file for two cells
    runs(there, 1)
    shutil.copy(there / "state.json", here / "state.json")  # of a cell that looks like this one
    assert "another cell" in distrusted(here, cell="there")


@pytest.mark.parametrize(
    ("call", "why"),
    [
        ("replace", "older than the last one"),
        ("pwrite", "deleted"),  # not even the mark can be written: no old file stays
    ],
)
def test_what_the_disk_had_no_room_for_is_missed_at_the_next_start(
    tmp_path, monkeypatch, call, why
):
    runs(tmp_path, 1)
    node = Node(tmp_path, 1060.0, data={"latch": 1})
    node.memory.open()
    node.memory.on_tick(TICK)
    assert not node.memory.failing
    node.part.data = {"latch": 2}
    with monkeypatch.context() as patched:
        patched.setattr(os, call, full)
        node.memory.on_tick(TICK)
        node.memory.close()
    assert node.memory.failing
    assert why in distrusted(tmp_path)


def test_a_kill_at_any_moment_of_a_write_leaves_the_last_word_or_distrust(tmp_path, monkeypatch):
    """Whatever the disk did last before the kill: no older word is believed."""
    calls = ["pwrite", "fsync", "replace"]
    for at, call in itertools.product(range(1, 4), calls):
        folder = tmp_path / f"{call}{at}"
        runs(folder, 1)
        node = Node(folder, 1060.0, data={"latch": 2})
        node.memory.open()
        counts = itertools.count(1)
        real = getattr(os, call)

        def killed(*args, real=real, counts=counts, at=at):
            if next(counts) == at:
                raise KeyboardInterrupt
            return real(*args)

        with monkeypatch.context() as patched:
            patched.setattr(os, call, killed)
            with contextlib.suppress(KeyboardInterrupt):
                node.memory.on_tick(TICK)
        node.memory.close()
        later = Node(folder, 2000.0).run().part
        assert later.recalled == {"latch": 2} or later.why or (call, at) == ("pwrite", 1), (
            call,
            at,
        )


def test_a_write_that_hangs_is_told(tmp_path):
    node = Node(tmp_path)
    node.memory.open()
    node.memory._threaded = True  # whose thread never comes to write
    node.memory.on_tick(TICK)
    assert not node.memory.failing
    node.now_s += STUCK_S + 1.0
    node.memory.on_tick(TICK)
    assert node.memory.failing
    node.memory.close()


def full(*_):
    raise OSError(28, "No space left on device")


def test_the_time_in_between_counts(tmp_path):
    Node(tmp_path, data={"latch": 1, "lost": [{"ago_s": 5.0}]}).run()
    assert Node(tmp_path, 1060.0).run().part.recalled["lost"] == [{"ago_s": 65.0}]


@pytest.mark.parametrize(("threaded", "since_s"), [(True, 7.0), (False, 0.0)])
def test_the_rest_of_a_start_counts_too_unless_time_is_virtual(tmp_path, threaded, since_s):
    Node(tmp_path, data={"latch": 1}).run()
    asked, clock = [], iter((100.0, 107.0))

    class Asking(Part):
        def recall(self, data, since_s):
            asked.append(since_s)

    memory = Memory(
        StateSettings(path="state.json"),
        tmp_path,
        {"part": Asking()},
        cell="here",
        wall_s=lambda: 1000.0,
        monotonic_s=lambda: next(clock),
        threaded=threaded,
    )
    memory.open()
    memory.close()
    assert [since() for since in asked] == [since_s]


def test_it_is_written_only_when_something_changed(tmp_path):
    node = Node(tmp_path, data={"latch": 1, "ago_s": 1.0})
    node.memory.open()
    for tick in range(100):
        node.part.data = {"latch": 1 + (tick >= 50), "ago_s": float(tick)}
        node.now_s += 0.04
        node.memory.on_tick(TICK)
    assert node.memory.written == 2
    node.memory.close()


def test_a_clock_that_went_backwards_means_long_ago(tmp_path):
    Node(tmp_path, data={"latch": 1, "ago_s": 5.0}).run()
    earlier = Node(tmp_path, 900.0).run()
    assert earlier.part.recalled["ago_s"] == 5.0 + LONG_AGO_S
    assert "future" in earlier.part.why


def test_an_old_file_is_not_trusted_but_one_of_a_node_that_ran_on_is(tmp_path):
    Node(tmp_path, max_age_s=100.0).run(seconds=500.0)
    assert Node(tmp_path, 1550.0, max_age_s=100.0).run().part.why is None
    assert "h old" in Node(tmp_path, 3000.0, max_age_s=100.0).run().part.why


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b"\xff\xfe",
        b'{"version": 1, "written": 1000, "parts": {}}',
        b'{"version": 3, "written": 1000, "parts": {}}',
        OWN + b'"parts": {"part": {"latch": 1}}}',
        OWN + b'"written": 1000, "parts": {}}',
        OWN + b'"written": "x", "parts": {"part": {"latch": 1}}}',
        OWN + b'"written": NaN, "parts": {"part": {"latch": 1}}}',
        OWN + b'"written": -Infinity, "parts": {"part": {"latch": 1}}}',
        OWN + b'"written": 1000, "parts": {"part": {"latch": "x"}}}',
        OWN + b'"written": 1000, "parts": {"part": [1]}}',
        OWN + b'"written": 1' + b"0" * 400 + b', "parts": {"part": {"latch": 1}}}',
        b"[" * 100_000,
        b" " * 2_000_000,
    ],
)
def test_what_cannot_be_read_is_not_trusted(tmp_path, content, caplog):
    (tmp_path / "state.json").write_bytes(content)
    (tmp_path / "state.json.lock").write_bytes(b'{"name": "n", "writes": 1, "changed_ns": null}')
    node = Node(tmp_path).run()
    assert "cannot be read" in node.part.why
    assert len(caplog.records) == 1
    assert "\n" not in caplog.records[0].getMessage()
    assert json.loads((tmp_path / "state.json").read_bytes())["parts"]["part"] == {"latch": 0}


@pytest.mark.parametrize("number", [b"Infinity", b"1e999", b"9" * 5000, b"{}"])
def test_a_lock_file_that_cannot_be_read_is_none(tmp_path, number):
    Node(tmp_path).run()
    lock = b'{"name": "n", "writes": 1, "changed_ns": ' + number + b"}"
    (tmp_path / "state.json.lock").write_bytes(lock)
    assert "has no lock file" in Node(tmp_path).run().part.why


def test_two_nodes_on_one_file_are_refused(tmp_path):
    first = Node(tmp_path)
    first.memory.open()
    with pytest.raises(ConfigError, match="another node uses"):
        Node(tmp_path).memory.open()
    first.memory.close()
    Node(tmp_path).run()


def test_a_path_that_is_no_file_is_refused(tmp_path):
    (tmp_path / "state.json").mkdir()
    with pytest.raises(ConfigError, match="cannot be used"):
        Node(tmp_path).memory.open()


def test_a_full_disk_is_counted_and_tried_again(tmp_path, monkeypatch, caplog):
    node = Node(tmp_path)
    node.memory.open()

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        node.memory.on_tick(TICK)
        assert (node.memory.written, node.memory.failures) == (0, 1)
        assert node.memory.last_error == "No space left on device"
        assert list(tmp_path.glob("*.partial")) == []
    node.part.data = {"latch": 2}
    node.memory.on_tick(TICK)
    assert (node.memory.written, node.memory.failures) == (1, 1)
    node.memory.close()


@pytest.mark.parametrize("wrong", [float("nan"), object()])
def test_what_cannot_be_written_is_counted_and_the_next_is_written(tmp_path, wrong):
    node = Node(tmp_path)
    node.memory.open()
    node.part.data = {"latch": wrong}
    node.memory.on_tick(TICK)
    assert (node.memory.written, node.memory.failures, node.memory.failing) == (0, 1, True)
    assert node.memory.last_error
    node.part.data = {"latch": 2}
    node.memory.on_tick(TICK)
    assert (node.memory.written, node.memory.failing) == (1, False)
    node.memory.close()


def test_the_thread_writes_what_came_last_before_it_ends(tmp_path):
    part = Part({"latch": 1})
    memory = Memory(StateSettings(path="s.json"), tmp_path, {"part": part})
    memory.open()
    for latch in range(50):
        part.data = {"latch": latch}
        memory.on_tick(TICK)
    memory.close()
    assert json.loads((tmp_path / "s.json").read_bytes())["parts"]["part"] == {"latch": 49}


def test_a_path_alone_is_enough():
    assert StateSettings.model_validate("a.json") == StateSettings(path="a.json")
