"""A second sender with the node's ids: the robots stop at once, and for a time afterwards."""

from types import SimpleNamespace

from hri_predict.node.node import HOLD_NS, SecondSender
from hri_predict.protocol.messages import Level, NodeState
from hri_predict.protocol.reasons import Reason


def link(name, foreign_ns=None):
    return SimpleNamespace(name=name, foreign_ns=foreign_ns)


def test_it_is_heard_until_the_hold_is_over():
    first, second = link("a"), link("b")
    watch = SecondSender([first, second])
    assert not watch.heard(0)
    second.foreign_ns = 100
    assert watch.heard(100)
    assert watch.heard(100 + HOLD_NS - 1)
    assert not watch.heard(100 + HOLD_NS)
    first.foreign_ns = second.foreign_ns = 2 * HOLD_NS
    assert watch.heard(2 * HOLD_NS)


def test_each_episode_is_logged_once(caplog):
    one = link("bus")
    watch = SecondSender([one])
    for k in range(100):
        one.foreign_ns = k
        watch.heard(k)
    watch.heard(99 + HOLD_NS)
    assert [r.levelname for r in caplog.records] == ["ERROR", "WARNING"]
    assert all("bus" in r.getMessage() for r in caplog.records)


def test_the_node_says_fault_to_every_robot_and_releases_slowly(make_workcell):
    cell = make_workcell(make_workcell.near)
    before = cell.run(2.0)[-1]
    assert before.status.node_state is NodeState.RUNNING
    other = cell.assembly.links[1]
    other.foreign_ns = cell.assembly.clock.now_ns()
    held = cell.run(HOLD_NS * 1e-9 - 0.04)
    assert {a.level for t in held for a in t.advices} == {Level.FAULT}
    assert {a.reason for t in held for a in t.advices} == {Reason.SECOND_SENDER}
    assert {a.speed_limit_m_s for t in held for a in t.advices} == {0.0}
    assert {t.status.node_state for t in held} == {NodeState.FAULT}
    assert {t.status.reason for t in held} == {Reason.SECOND_SENDER}
    after = cell.run(0.12)
    assert after[-1].advices[0].level is Level.UNKNOWN, "the release needs captures, as any does"
    later = cell.run(3.0)[-1]
    assert later.status.node_state is NodeState.RUNNING
    assert later.advices[0].level.may_move
