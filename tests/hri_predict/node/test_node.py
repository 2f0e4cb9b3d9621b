"""The node: one tick, its life cycle, and what it does when a stage fails."""

from asyncio import CancelledError
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hri_predict.contracts.cell import ControllerReport
from hri_predict.contracts.link import LinkCounters, Received
from hri_predict.contracts.predictor import Forecast
from hri_predict.node.listeners import Listener
from hri_predict.node.repeats import Repeats
from hri_predict.protocol.messages import (
    Advice,
    Level,
    NodeState,
    RobotMode,
    Status,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.run import config as configuration
from tests.messages import make_state

FAR = [4.0, 3.0]
MS = 1_000_000


class Ears(Listener):
    """Keeps what it is told; fails where it is asked to."""

    def __init__(self, fails=None):
        self.fails = fails
        self.ticks, self.scenes, self.received = [], [], []

    def on_scene(self, scene, receipt_ns):
        self._take(self.scenes, scene)

    def on_received(self, link, received):
        self._take(self.received, (link, received))

    def on_tick(self, tick):
        self._take(self.ticks, tick)

    def _take(self, kept, what):
        kept.append(what)
        if self.fails:
            raise self.fails


class QuietLink:
    """A link that keeps what is posted and gives what the test puts in."""

    last_error = foreign_ns = on_sent = None

    def __init__(self, name):
        self.name, self.connected, self.counters = name, True, LinkCounters()
        self.posted, self.inbox = [], []

    def post(self, message):
        self.posted.append(message)

    def take(self):
        taken, self.inbox = self.inbox, []
        return taken

    def start(self):
        pass

    def service(self, now_ns):
        pass

    def stop(self):
        pass


@pytest.fixture
def near(make_workcell):
    """Somebody near a moving robot: advised, and known to the node for a second."""
    ears = Ears()
    cell = make_workcell(make_workcell.near, listeners=[ears])
    cell.ears = ears
    cell.run(1.0)
    return cell


def heard(cell, advice_of=0):
    """Replace the links by quiet ones."""
    links: list[Any] = [QuietLink(link.name) for link in cell.assembly.links]
    cell.node._links = links
    cell.node._publisher.repeats = Repeats(links)  # each message once
    return links


def test_without_input_the_advice_is_unknown_and_status_keeps_its_rate(make_workcell):
    cell = make_workcell()
    cell.sees = False
    ticks = cell.run(2.0)
    assert len(ticks) == 50  # 25 Hz
    assert {t.advices[0].level for t in ticks} == {Level.UNKNOWN}
    assert {t.advices[0].reason for t in ticks} == {Reason.NO_INPUT}
    assert {t.status.reason for t in ticks} == {Reason.NO_INPUT}
    assert {t.status.node_state for t in ticks} == {NodeState.STARTING}
    assert [t.status.cycle for t in ticks] == list(range(50))
    reports = cell.cell.stop()
    assert all(report.messages > 2 * 45 for report in reports)  # an advice and a status each
    assert all("clear" not in str(report.events) for report in reports)


def test_somebody_near_is_advised_and_the_robot_known(near):
    last = near.run(1.0)[-1]
    assert last.status.node_state is NodeState.RUNNING
    assert last.status.people == 1
    assert last.advices[0].level in (Level.SLOW, Level.STOP)
    assert last.advices[0].separation_m == pytest.approx(1.0, abs=0.9)
    assert near.node.frames_in == near.node.scenes_in == len(near.ears.scenes)
    after = replace(near.ears.scenes[-1], sequence=near.ears.scenes[-1].sequence + 1)
    near.node.receive(after, near.clock.now_ns())  # the run ends before its tick
    assert near.node.people_counters["scenes"] == near.node.frames_in == near.node.scenes_in


def test_a_risk_stage_that_raises_is_a_fault_and_recovers(near, monkeypatch, caplog):
    def raises(*_):
        raise ZeroDivisionError("injected")

    with monkeypatch.context() as patch:
        patch.setattr(near.node._risk, "separation", raises)
        ticks = near.run(0.4)
    assert {t.advices[0].level for t in ticks} == {Level.FAULT}
    assert {t.advices[0].reason for t in ticks} == {Reason.NODE_FAULT}
    assert {t.advices[0].speed_limit_m_s for t in ticks} == {0.0}
    assert {t.status.node_state for t in ticks} == {NodeState.FAULT}
    assert {t.status.reason for t in ticks} == {Reason.NODE_FAULT}
    assert near.node.assess_failures == 10
    assert caplog.text.count("Traceback") == 1  # not once a tick
    after = near.run(1.0)
    assert after[-1].status.node_state is NodeState.RUNNING
    assert after[-1].advices[0].level in (Level.SLOW, Level.WARN)
    assert all(report.ended == "ok" for report in near.cell.stop())


def test_a_failure_after_the_risk_stage_is_a_fault_in_status_and_advice(near, monkeypatch):
    def raises():
        raise ZeroDivisionError("injected")

    with monkeypatch.context() as patch:
        patch.setattr(near.node, "_release", raises)
        ticks = near.run(0.4)
    assert {t.advices[0].level for t in ticks} == {Level.FAULT}
    assert {t.status.node_state for t in ticks} == {NodeState.FAULT}
    assert {t.status.reason for t in ticks} == {Reason.NODE_FAULT}
    assert all(t.assessment is None for t in ticks)


@pytest.mark.parametrize("error", [OSError("injected"), CancelledError()])
@pytest.mark.parametrize("stage", ["people", "prediction"])
def test_any_other_stage_that_raises_is_a_fault_too(near, monkeypatch, stage, error, caplog):
    def raises(*_):
        raise error

    method = {"people": "snapshot", "prediction": "run"}[stage]
    monkeypatch.setattr(getattr(near.node, f"_{stage}"), method, raises)
    (tick,) = near.run(0.04)
    assert tick.advices[0].level is Level.FAULT
    assert tick.status.node_state is NodeState.FAULT


def _raises(forecast):
    raise RuntimeError("injected")


def _cancels(forecast):
    raise CancelledError


def _nan(forecast):
    return Forecast(np.full_like(forecast.positions, np.nan), None)


def _short(forecast):
    return Forecast(forecast.positions[:, 1:], None)


@pytest.mark.parametrize("answer", [_raises, _cancels, _nan, _short])
def test_a_predictor_that_fails_leaves_the_physical_limits(near, monkeypatch, answer, caplog):
    sound = near.run(0.04)[0]
    predictor = near.assembly.prediction.predictor
    predict = predictor.predict
    with monkeypatch.context() as patch:
        patch.setattr(predictor, "predict", lambda h, o: answer(predict(h, o)))
        ticks = near.run(0.4)
    assert {t.status.node_state for t in ticks} == {NodeState.DEGRADED}
    assert {t.status.reason for t in ticks} == {Reason.PREDICTOR_FAILED}
    assert all(t.forecast is None and t.assessment is not None for t in ticks)
    assert {t.advices[0].level for t in ticks} <= {Level.SLOW, Level.STOP}
    # what the body could do by its physical limits is never less than what was forecast
    wide, narrow = ticks[0].assessment.zones, sound.assessment.zones
    k = len(narrow.times_s) // 2
    assert wide.segments == narrow.segments
    assert (wide.capsules.radius[0, k] > narrow.capsules.radius[0, k]).all()
    after = near.run(1.0)
    assert after[-1].status.node_state is NodeState.RUNNING


def test_a_link_that_is_down_degrades_the_node(near):
    links = heard(near)
    links[1].connected = False
    (tick,) = near.run(0.04)
    assert tick.status.node_state is NodeState.DEGRADED
    links[1].connected = True
    (tick,) = near.run(0.04)
    assert tick.status.node_state is NodeState.RUNNING


def test_conditions_beside_the_way_are_in_status_and_notes_of_the_advice(near):
    near.node.conditions = lambda: (Reason.STATE_UNTRUSTED,)
    tick = near.run(0.04)[-1]
    assert tick.status.reason is Reason.STATE_UNTRUSTED
    assert tick.status.node_state is NodeState.DEGRADED


@pytest.mark.parametrize("error", [RuntimeError("of the user"), CancelledError()])
def test_listeners_that_fail_are_counted_and_stop_nothing(make_workcell, caplog, error):
    fails, sound = Ears(fails=error), Ears()
    cell = make_workcell(make_workcell.near, listeners=[fails, sound])
    ticks = cell.run(1.0)
    assert ticks[-1].status.node_state is NodeState.RUNNING
    calls = len(fails.ticks) + len(fails.scenes) + len(fails.received)
    assert len(fails.ticks) == 25
    assert len(fails.scenes) > 25
    assert len(fails.received) > 25
    assert cell.node.listener_failures == calls
    assert len(sound.ticks) == 25  # who listens after one that fails hears all the same
    assert caplog.text.count("Traceback") == 1


def test_in_shadow_mode_links_hear_unknown_and_listeners_the_truth(make_workcell):
    ears = Ears()
    cell = make_workcell(make_workcell.near, shadow=True, listeners=[ears])
    links = heard(cell)
    # the controllers are cut off, so the robot is told by hand
    for counter in range(25):
        state = make_state((0.0,) * 6, counter=counter)
        links[0].inbox.append(Received(state, cell.clock.now_ns()))
        cell.run(0.04)
    told = [m for link in links for m in link.posted if isinstance(m, Advice)]
    assert len(told) == 50
    assert {(a.level, a.reason) for a in told} == {(Level.UNKNOWN, Reason.SHADOW_MODE)}
    assert {a.speed_limit_m_s for a in told} == {0.0}
    assert {type(m).__name__ for m in links[0].posted} == {"Advice", "Status", "Schema"}
    truth = ears.ticks[-1].advices[0]
    assert truth.level in (Level.SLOW, Level.STOP)
    assert truth.separation_m is not None
    statuses = [m for m in links[0].posted if isinstance(m, Status)]
    assert statuses[-1].node_state is NodeState.RUNNING


def test_in_shadow_mode_no_controller_permits_motion(make_workcell):
    cell = make_workcell(FAR, shadow=True)
    cell.run(4.0)
    assert cell.ticks[-1].advices[0].level is Level.CLEAR
    for report in cell.cell.stop():
        assert report.messages > 50
        assert all(limit == 0.0 for _, _, limit in report.events)


def test_announcements_at_start_and_stop_are_unknown_with_their_reason(near):
    links = heard(near)
    for state, reason in (
        (NodeState.STARTING, Reason.STARTING),
        (NodeState.STOPPING, Reason.STOPPING),
    ):
        near.node.announce(near.clock.now_ns(), state, reason)
        for link in links:
            advice = next(m for m in link.posted if isinstance(m, Advice))
            status = next(m for m in link.posted if isinstance(m, Status))
            assert (advice.level, advice.reason) == (Level.UNKNOWN, reason)
            assert advice.speed_limit_m_s == 0.0
            assert (status.node_state, status.reason) == (state, reason)
            link.posted.clear()
        assert near.node.state is state
        assert near.ears.ticks[-1].status.node_state is state


def test_two_links_report_the_same_robot_and_their_counters_do_not_mix(near):
    drive, monitor = heard(near)
    tracker = near.assembly.trackers[0]
    before = dict(tracker.counters)
    q = tuple(tracker.at(near.clock.now_ns()).q.tolist())
    for link in (drive, monitor, drive):  # the third repeats the first
        state = make_state(q, (0.0,) * 6, counter=200)
        link.inbox.append(Received(state, near.clock.now_ns()))
    near.run(0.04)
    assert tracker.counters["accepted"] == before["accepted"] + 2
    assert tracker.counters["repeated"] == before["repeated"] + 1
    np.testing.assert_allclose(tracker.at(near.clock.now_ns()).q, q)


def test_state_of_a_robot_that_is_not_there_is_harmless(near):
    drive, _ = heard(near)
    state = make_state((0.1,) * 6, robot=6)
    drive.inbox.append(Received(state, near.clock.now_ns()))
    (tick,) = near.run(0.04)
    assert tick.status.node_state is not NodeState.FAULT


@pytest.mark.parametrize(
    ("mode", "positions", "reason"),
    [
        (RobotMode.MANUAL, None, Reason.ROBOT_NOT_AUTOMATIC),
        (RobotMode.AUTOMATIC, (3.0,) * 6, Reason.ROBOT_STATE_JUMPED),
        (RobotMode.AUTOMATIC, (99.0,) * 6, Reason.ROBOT_STATE_INVALID),
        (RobotMode.AUTOMATIC, (0.1,) * 3, Reason.ROBOT_STATE_INVALID),
    ],
)
def test_a_robot_state_that_cannot_be_trusted_is_a_reason(near, mode, positions, reason):
    drive, _ = heard(near)
    positions = positions or tuple(near.assembly.trackers[0].at(near.clock.now_ns()).q.tolist())
    state = make_state(positions, counter=17, mode=mode)
    drive.inbox.append(Received(state, near.clock.now_ns()))
    (tick,) = near.run(0.04)
    assert tick.advices[0].reason is reason
    assert tick.advices[0].level not in (Level.CLEAR, Level.WARN, Level.SLOW)


def test_robot_state_that_ceases_goes_stale(near):
    heard(near)  # nothing is received any more
    ticks = near.run(0.4)
    assert ticks[-1].advices[0].reason is Reason.ROBOT_STATE_STALE
    assert ticks[-1].advices[0].level is Level.UNKNOWN


def test_each_link_hears_of_its_robots_alone(make_workcell):
    base = configuration.load(configuration.shipped("demo.yaml"))
    robots = [
        base.node.robots[0],
        base.node.robots[0].model_copy(update={"name": "other"}),
    ]
    drive, monitor = base.links
    second = drive.model_copy(
        update={
            "name": "second",
            "robots": ["other"],
            "simulate": {"role": "drive", "robot": "other", "trajectory": "pick_and_place"},
        }
    )
    config = replace(
        base,
        node=base.node.model_copy(update={"robots": robots}),
        links=(drive.model_copy(update={"robots": ["arm"]}), monitor, second),
    )
    cell = make_workcell(make_workcell.near, config=config)
    links = heard(cell)
    cell.run(0.04)
    advised = [sorted({m.robot for m in x.posted if isinstance(m, Advice)}) for x in links]
    assert advised == [[0], [0, 1], [1]]
    assert all(any(isinstance(m, Status) for m in link.posted) for link in links)
    reports: list[ControllerReport] = cell.cell.stop()
    assert len(reports) == 3


def test_a_robot_state_counts_only_from_a_link_that_controls_that_robot(near, caplog):
    link = heard(near)[0]
    stranger = make_state((0.0,) * 6, robot=3)
    link.inbox.append(Received(stranger, near.clock.now_ns()))
    near.node.tick(near.clock.now_ns())
    assert (near.node.strange_states, near.node.assess_failures) == (1, 0)
    assert "1 RobotStates refused: the newest is of robot 3, but the robots of this" in caplog.text


def test_a_failure_while_taking_messages_is_a_fault_and_passes(near):
    link = heard(near)[0]
    link.take = lambda: 1 / 0
    tick = near.node.tick(near.clock.now_ns())
    assert [a.level for a in tick.advices] == [Level.FAULT]
    del link.take
    assert near.node.tick(near.clock.now_ns()).advices[0].level is not Level.FAULT
