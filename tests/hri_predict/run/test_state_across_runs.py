"""Restarts on the virtual clock: what an operator said before does not count afterwards."""

import shutil
from dataclasses import replace

import pytest
import yaml

from hri_predict.node.presses import QUIET_S
from hri_predict.protocol.messages import Acknowledge, Level
from hri_predict.protocol.reasons import Reason
from hri_predict.recording.opening import open_recording
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_predict.run.starting import cell_of

AFTER_S = QUIET_S + 1.0
SECONDS = AFTER_S + 3.0
"""The button is pressed after the pause, and the robot is released within 2 s."""


class Watch(View):
    """Keeps the advice for the only robot, and the reasons of the scene."""

    def __init__(self):
        self.advices, self.reasons = [], set()

    def on_tick(self, tick):
        self.advices += tick.advices
        self.reasons |= set(tick.snapshot.reasons if tick.snapshot else ())

    @property
    def shown(self):
        return {advice.latch_id for advice in self.advices} - {0}

    @property
    def moves(self):
        return any(a.level in (Level.CLEAR, Level.WARN, Level.SLOW) for a in self.advices)


@pytest.fixture
def cell(tmp_path):
    """A cell with an empty room, whose controller can acknowledge."""

    def make(name="cell.yaml", robot_x=None, latch=(), **simulate):
        data = yaml.safe_load(configuration.shipped("demo.yaml").read_text(encoding="utf-8"))
        data["predictor"] = {"name": "constant_velocity"}
        data["risk"] = {"mode": "iso", "latch": list(latch)}
        data["source"]["people"] = []
        data["alerts"] = {"terminal": False}
        data["links"] = data["links"][:1]
        data["links"][0]["simulate"].update(simulate)
        if robot_x is not None:
            data["robots"][0]["room_from_robot"]["xyz"][0] = robot_x
        path = tmp_path / name
        path.write_text(yaml.safe_dump(data), encoding="utf-8")
        return configuration.load(path)

    return make


def played(config, state=None, seconds=2.0):
    watch = Watch()
    run(config, Options(factor=None, duration_s=seconds, state=state, view=watch))
    return watch


def test_a_first_start_waits_for_one_acknowledge_and_the_next_start_does_not(cell, tmp_path):
    state = tmp_path / "state.json"
    first = played(cell(acknowledge_after_s=AFTER_S), state, SECONDS)
    assert Reason.STATE_UNTRUSTED in first.reasons
    assert len(first.shown) == 1
    assert {a.level for a in first.advices if a.latch_id} == {Level.UNKNOWN}
    assert first.moves
    second = played(cell(), state)
    assert Reason.STATE_UNTRUSTED not in second.reasons
    assert second.moves


def test_a_first_start_that_nobody_acknowledged_is_named_again_at_the_next(cell, tmp_path):
    state = tmp_path / "state.json"
    assert Reason.STATE_UNTRUSTED in played(cell(), state).reasons
    assert Reason.STATE_UNTRUSTED in played(cell(), state).reasons


def test_a_state_file_that_was_rolled_back_or_deleted_is_noticed(cell, tmp_path):
    state, backup = tmp_path / "state.json", tmp_path / "backup.json"
    played(cell(acknowledge_after_s=AFTER_S), state, SECONDS)
    shutil.copy2(state, backup)
    assert played(cell(latch=["restart"]), state).shown
    shutil.copy2(backup, state)
    watch = played(cell(), state)
    assert Reason.STATE_UNTRUSTED in watch.reasons
    assert not watch.moves
    state.unlink()
    assert not played(cell(), state).moves


@pytest.mark.parametrize("keeps", [True, False])
def test_an_acknowledge_of_before_a_restart_ends_nothing_after_it(cell, tmp_path, keeps):
    state = tmp_path / "state.json" if keeps else None
    before = played(cell(latch=["start"]), state)
    again = played(cell(latch=["start"]), state)
    assert before.shown
    assert again.shown
    assert before.shown.isdisjoint(again.shown)  # by chance alike: once in 65,000


def test_a_replay_numbers_as_its_recording_so_that_recorded_presses_count(cell, tmp_path):
    path = tmp_path / "a.mcap"
    config = cell(latch=["start"], acknowledge_after_s=AFTER_S)
    run(config, Options(factor=None, duration_s=SECONDS, record=path))
    recording = open_recording(path)
    sent = [m.message for _, m in recording.received if type(m.message) is Acknowledge]
    pressed = {message.latch_id for message in sent if message.latch_id != 0}  # 0: a release
    assert len(pressed) == 1
    source = {"kind": "recording", "path": str(path), "room_from_source": {"xyz": [0, 0, 0]}}
    again = played(config.with_source(source).without_links(), seconds=SECONDS)
    assert again.shown == pressed
    assert again.advices[-1].latch_id == 0


def test_another_place_or_another_configuration_is_another_cell(cell):
    here = cell()
    assert cell_of(here) == cell_of(cell())
    assert cell_of(here) == cell_of(cell(latch=["stop"]))  # what does not move anything
    assert cell_of(here) != cell_of(cell(robot_x=1.0))
    assert cell_of(here) != cell_of(cell("other.yaml"))
    assert cell_of(here) == cell_of(replace(here, text="# a comment"))


def test_a_moved_sensor_of_several_is_another_cell():
    two = configuration.load(configuration.shipped("two_sensors.yaml"))

    def with_back(**changes):
        source = two.source.model_dump()
        source["sensors"]["back"] |= changes
        return cell_of(two.with_source(source))

    pose = {"xyz": [0.1, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
    assert with_back() == with_back(port=9999)
    assert with_back() != with_back(room_from_source=pose)
