"""What the view of all cells shows, and that it never shows more than is known."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from hri_predict.operation.monitoring.fleet import MAX_CELLS, CellRow, Fleet
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.keyed import Keyed, KeyedSender, prefix
from hri_predict.protocol.messages import Level, Message, NodeState, Schema
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.operation.monitoring.said import CLEAR, OURS, RUNNING

S = 1_000_000_000


class Node:
    """Speaks for one cell."""

    def __init__(self, fleet: Fleet, cell: str = "a") -> None:
        self.fleet, self.cell, self.sender = fleet, cell, KeyedSender()

    def say(self, now_ns: int, *messages: Message) -> None:
        for message in messages:
            unit = self.sender.encode(message)
            whole = replace(unit, key=prefix("plant", self.cell) + unit.key)
            self.fleet.take(whole, now_ns)


def only(fleet: Fleet, now_ns: int) -> CellRow:
    (row,) = fleet.rows(now_ns)
    return row


def test_a_cell_that_speaks_is_shown_as_it_says() -> None:
    fleet = Fleet()
    Node(fleet).say(S, OURS, RUNNING, CLEAR, replace(CLEAR, robot=3, level=Level.STOP))
    row = only(fleet, S + S // 10)
    assert (row.site, row.cell, row.state, row.people, row.why) == ("plant", "a", "running", 2, "")
    assert [(r.robot, r.level) for r in row.robots] == [(0, "clear"), (3, "stop")]
    assert row.age_s is not None
    assert round(row.age_s, 3) == 0.15
    assert row.as_dict()["robots"][0]["speed_limit_m_s"] == 1.0


def test_silence_is_never_clear() -> None:
    fleet = Fleet(silent_s=0.5)
    Node(fleet).say(S, OURS, RUNNING, CLEAR)
    assert only(fleet, S + S // 2).robots[0].level == "clear"
    row = only(fleet, S + S // 2 + 1)
    assert (row.state, row.people, row.robots[0].level) == ("silent", None, "silent")
    assert row.robots[0].speed_limit_m_s is None


def test_a_robot_that_is_no_longer_advised_is_silent_alone() -> None:
    fleet = Fleet()
    node = Node(fleet)
    node.say(S, OURS, RUNNING, CLEAR)
    node.say(2 * S, RUNNING)
    row = only(fleet, 2 * S)
    assert (row.state, row.robots[0].level) == ("running", "silent")


def test_at_clear_a_reason_is_a_note() -> None:
    fleet = Fleet()
    fast = replace(CLEAR, reason=Reason.PERSON_FAST)
    Node(fleet).say(S, OURS, RUNNING, fast, replace(fast, robot=1, level=Level.SLOW))
    noted, slowed = only(fleet, S).robots
    assert noted.reason == f"no person is too close; note: {Reason.PERSON_FAST.text}"
    assert slowed.reason == Reason.PERSON_FAST.text


def test_a_degraded_or_faulty_node_never_says_that_nothing_is_near() -> None:
    fleet = Fleet()
    node = Node(fleet)
    node.say(S, OURS, replace(RUNNING, node_state=NodeState.DEGRADED))
    assert only(fleet, S).why == "a link to a controller is not connected"
    late = replace(RUNNING, node_state=NodeState.DEGRADED, reason=Reason.PREDICTOR_LATE)
    node.say(S, late)
    assert only(fleet, S).why == Reason.PREDICTOR_LATE.text
    node.say(S, replace(RUNNING, node_state=NodeState.FAULT))
    assert only(fleet, S).why == ""  # the tile says: the node reports a fault


def test_before_the_schema_and_with_another_all_is_unknown() -> None:
    fleet = Fleet()
    node = Node(fleet)
    node.say(S, RUNNING, CLEAR)
    assert (only(fleet, S).state, only(fleet, S).robots[0].level) == ("unknown", "unknown")
    node.say(S, Schema(SCHEMA_VERSION, SCHEMA_HASH ^ 1))
    assert only(fleet, S).robots[0].level == "unknown"
    assert "another version" in only(fleet, S).why
    node.say(S, OURS)
    assert only(fleet, S).robots[0].level == "clear"


def test_after_a_silence_the_schema_must_come_again() -> None:
    """Who speaks now may be a node of another version, whose bytes pass the CRC all the same."""
    fleet = Fleet()
    node = Node(fleet)
    node.say(S, OURS, RUNNING, CLEAR)
    node.say(2 * S, RUNNING, CLEAR)
    assert only(fleet, 2 * S).robots[0].level == "clear"
    node.say(3 * S + 1, RUNNING, CLEAR)
    row = only(fleet, 3 * S + 1)
    assert (row.state, row.robots[0].level) == ("unknown", "unknown")
    assert row.why == "no schema received yet"
    node.say(3 * S + 2, OURS)
    assert only(fleet, 3 * S + 2).robots[0].level == "clear"


def test_after_a_silence_only_robots_that_are_advised_are_shown() -> None:
    """A node that restarts with fewer robots stayed without contact for ever."""
    fleet = Fleet()
    Node(fleet).say(S, OURS, RUNNING, CLEAR, replace(CLEAR, robot=1))
    later_ns = 3 * S
    fleet.take(Keyed(f"{prefix('plant', 'a')}status", b"noise"), later_ns)
    assert [r.level for r in only(fleet, later_ns).robots] == ["silent", "silent"]
    fresh = Node(fleet)
    for i in range(3):
        fresh.say(later_ns + i * S // 25, OURS, RUNNING, CLEAR)
    assert [(r.robot, r.level) for r in only(fleet, later_ns + S // 10).robots] == [(0, "clear")]


def test_after_a_fast_restart_only_robots_that_are_advised_are_shown() -> None:
    """Within a second, no silence tells that another node sends now, with fewer robots."""
    fleet = Fleet()
    node = Node(fleet)
    for i in range(100):
        node.say(i * S // 25, OURS, RUNNING, CLEAR, replace(CLEAR, robot=1))
    fresh = Node(fleet)
    for i in range(107, 160):
        fresh.say(i * S // 25, OURS, RUNNING, CLEAR)
        shown = [(r.robot, r.level) for r in only(fleet, i * S // 25).robots]
        if i == 115:
            assert shown == [(0, "clear"), (1, "silent")]  # it may still begin to advise it
    assert shown == [(0, "clear")]


def test_a_robot_that_is_no_longer_advised_stays_silent_whatever_is_lost() -> None:
    fleet = Fleet()
    node = Node(fleet)
    node.say(0, OURS, RUNNING, CLEAR, replace(CLEAR, robot=1))
    late = node.sender.encode(RUNNING)
    for i in range(1, 100):
        node.say(i * S // 25, OURS, RUNNING, CLEAR)
        if i % 20 == 0:
            fleet.take(replace(late, key=prefix("plant", "a") + late.key), i * S // 25)
    assert [r.level for r in only(fleet, 100 * S // 25).robots] == ["clear", "silent"]


def test_an_old_or_unknown_capture_permits_nothing() -> None:
    for age_s in (None, 1.1):
        fleet = Fleet()
        stop = replace(CLEAR, robot=1, level=Level.STOP, age_s=age_s)
        Node(fleet).say(S, OURS, RUNNING, replace(CLEAR, age_s=age_s), stop)
        assert [r.level for r in only(fleet, S).robots] == ["unknown", "stop"]


def test_two_nodes_under_one_key_are_unknown() -> None:
    fleet = Fleet()
    one, other = Node(fleet), Node(fleet)
    for i in range(20):
        other.say(S, RUNNING) if i else None
        one.say(S, RUNNING)
    for i in range(40):
        now_ns = S + i * S // 25
        one.say(now_ns, OURS, RUNNING, CLEAR)
        other.say(now_ns, OURS, RUNNING, replace(CLEAR, level=Level.STOP))
        other.say(now_ns, RUNNING)  # not in step with the first, as two nodes never are
        if i > 10:
            assert only(fleet, now_ns).robots[0].level == "unknown"
    assert "two nodes" in only(fleet, now_ns).why


def test_two_nodes_of_which_none_is_believed_are_not_silent() -> None:
    """In step, each refuses the other's sequence: nothing is accepted, but much is received."""
    fleet = Fleet()
    node = Node(fleet)
    for i in range(60):
        node.say(i * S // 20, OURS, RUNNING, CLEAR)
    one, other = Node(fleet), Node(fleet)
    for i in range(50):
        now_ns = 5 * S + i * S // 20
        for each in (one, other):
            each.say(now_ns, RUNNING, CLEAR)
        if i > 3:
            row = only(fleet, now_ns)
            assert (row.state, row.robots[0].level) == ("unknown", "unknown")
            assert "two nodes use one key" in row.why
    assert only(fleet, now_ns + 2 * S).why == "no messages"


def test_a_restarted_node_is_believed_again_at_once() -> None:
    fleet = Fleet()
    node = Node(fleet)
    for i in range(100):
        node.say(i * S // 25, OURS, RUNNING, CLEAR)
    fresh = Node(fleet)
    for i in range(100, 103):
        fresh.say(i * S // 25, OURS, RUNNING, CLEAR)
    assert only(fleet, 103 * S // 25).robots[0].level == "clear"
    assert only(fleet, 103 * S // 25).refused == 4


def test_a_node_that_stopped_says_so() -> None:
    fleet = Fleet()
    Node(fleet).say(S, OURS, replace(RUNNING, node_state=NodeState.STOPPING))
    assert (only(fleet, 9 * S).state, only(fleet, 9 * S).why) == ("silent", "the node was stopped")


def test_lost_messages_are_counted() -> None:
    fleet = Fleet()
    node = Node(fleet)
    node.say(S, OURS, RUNNING)
    for _ in range(3):
        node.sender.encode(RUNNING)
    node.say(S, RUNNING)
    assert (only(fleet, S).lost, only(fleet, S).refused) == (3, 0)


@given(
    key=st.one_of(st.text(max_size=40), st.sampled_from(["hri/p/a/status", "hri/p/a/advice/0"])),
    payload=st.binary(max_size=100),
)
def test_whatever_comes_makes_no_cell_clear(key: str, payload: bytes) -> None:
    fleet = Fleet()
    fleet.take(Keyed(key, payload), S)
    assert all(row.state == "silent" and not row.robots for row in fleet.rows(S))


def test_cells_without_end_are_left_out_and_counted() -> None:
    fleet = Fleet()
    for i in range(MAX_CELLS + 5):
        fleet.take(Keyed(f"hri/plant/c{i}/status", b"x"), S)
    assert len(fleet.rows(S)) == MAX_CELLS
    assert fleet.left_out == 5
