"""The state file: what survives, and every way in which it cannot be trusted."""

import json
import os
from typing import cast

import pytest

from hri_predict.errors import ConfigError
from hri_predict.node.listeners import Tick
from hri_predict.node.memory import LONG_AGO_S, Memory, StateSettings

TICK = cast(Tick, None)  # the memory looks at its parts alone


class Part:
    def __init__(self, data=None):
        self.data = data or {"latch": 0}
        self.recalled = self.why = None

    def remember(self):
        return self.data

    def recall(self, data):
        self.recalled = dict(data)
        self.recalled["latch"] = int(data["latch"])

    def distrust(self, why):
        self.why = why


class Node:
    """One run of a node on a state file, with its own wall clock."""

    def __init__(self, folder, now_s=1000.0, data=None, **settings):
        self.now_s = now_s
        self.part = Part(data)
        self.memory = Memory(
            StateSettings(path="state.json", **settings),
            folder,
            {"part": self.part},
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


def test_a_first_run_recalls_nothing_and_leaves_a_file(tmp_path):
    first = Node(tmp_path).run()
    assert (first.part.recalled, first.part.why) == (None, None)
    assert (tmp_path / "state.json").exists()


def test_the_time_in_between_counts(tmp_path):
    Node(tmp_path, data={"latch": 1, "lost": [{"ago_s": 5.0}]}).run()
    assert Node(tmp_path, 1060.0).run().part.recalled["lost"] == [{"ago_s": 65.0}]


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
        b'{"version": 2, "written": 1000, "parts": {}}',
        b'{"version": 1, "written": 1000, "parts": {}}',
        b'{"version": 1, "written": "x", "parts": {"part": {"latch": 1}}}',
        b'{"version": 1, "written": NaN, "parts": {"part": {"latch": 1}}}',
        b'{"version": 1, "written": -Infinity, "parts": {"part": {"latch": 1}}}',
        b'{"version": 1, "written": 1000, "parts": {"part": {"latch": "x"}}}',
        b'{"version": 1, "written": 1000, "parts": {"part": [1]}}',
        b'{"version": 1, "written": 1' + b"0" * 400 + b', "parts": {"part": {"latch": 1}}}',
        b"[" * 100_000,
        b" " * 2_000_000,
    ],
)
def test_what_cannot_be_read_is_not_trusted(tmp_path, content, caplog):
    (tmp_path / "state.json").write_bytes(content)
    node = Node(tmp_path).run()
    assert "cannot be read" in node.part.why
    assert len(caplog.records) == 1
    assert "\n" not in caplog.records[0].getMessage()
    assert json.loads((tmp_path / "state.json").read_bytes())["parts"]["part"] == {"latch": 0}


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

    def full(_fd):
        raise OSError(28, "No space left on device")

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
