"""Who sent a message, where rclpy does not state it (Jazzy)."""

from types import SimpleNamespace
from typing import Any

from hri_drivers.wires.ros2_heard import LOOK_S, NO_GID, SEVERAL_GIDS, Graph, Heard
from hri_drivers.wires.ros2_publishers import Publishers

STATED = {"publisher_gid": {"data": b"s" * 16}, "publication_sequence_number": 4}
UNSTATED: dict[str, Any] = {"publication_sequence_number": 4}


class Room:
    def __init__(self, *gids: bytes) -> None:
        self.gids, self.now_s, self.looks = list(gids), 0.0, 0
        self.graph = Graph(self.look, lambda: self.now_s)

    def look(self) -> list[SimpleNamespace]:
        self.looks += 1
        return [SimpleNamespace(endpoint_gid=list(gid)) for gid in self.gids]

    def heard(self, info: dict[str, Any]) -> Heard:
        self.now_s += LOOK_S
        return Heard.from_ros(0, b"", info, unstated=self.graph.gid(info))


def test_a_stated_publisher_needs_no_look():
    room = Room(b"a" * 16, b"b" * 16)
    assert room.heard(STATED).gid == b"s" * 16
    assert room.looks == 0


def test_the_only_publisher_is_meant():
    room = Room(b"a" * 16)
    assert room.heard(UNSTATED).gid == b"a" * 16
    room.gids = []  # it has gone, and its last message arrives
    assert room.heard(UNSTATED).gid == b"a" * 16
    assert Room().heard(UNSTATED).gid == NO_GID


def test_several_publishers_contradict_each_other_until_one_is_left():
    room, publishers = Room(b"a" * 16), Publishers()
    assert not publishers.contradicted(room.heard(UNSTATED), 0)
    room.gids.append(b"b" * 16)
    several = room.heard(UNSTATED)
    assert several.gid == SEVERAL_GIDS
    assert publishers.contradicted(several, 1)
    assert publishers.lost(several) == 0
    room.gids.pop()
    assert not publishers.contradicted(room.heard(UNSTATED), 2)


def test_a_publisher_that_replaced_another_is_not_believed_for_a_second():
    room, publishers = Room(b"a" * 16), Publishers()
    assert not publishers.contradicted(room.heard(UNSTATED), 0)
    room.gids = [b"b" * 16]
    assert publishers.contradicted(room.heard(UNSTATED), 10**8)
    assert not publishers.contradicted(room.heard(UNSTATED), 2 * 10**9)


def test_the_graph_is_not_asked_for_each_message():
    room = Room(b"a" * 16)
    for _ in range(100):
        room.graph.gid(UNSTATED)
    assert room.looks == 1
