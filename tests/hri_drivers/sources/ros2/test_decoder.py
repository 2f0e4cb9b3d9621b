"""From messages to scenes: stamps, restarts, publishers, several topics, any bytes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.ros2.decoder import MAX_BYTES, MAX_WAITING, Ros2Decoder
from hri_drivers.wires.ros2_heard import NO_GID, NO_SEQUENCE, TF, TF_STATIC, Heard
from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.ros.bodies import MARKER_ARRAY, POSE_ARRAY
from hri_predict.protocol.ros.frame_tree import FrameTree
from hri_predict.protocol.ros.messages import TF_MESSAGE
from hri_predict.protocol.ros.placing import PeopleReader
from hri_predict.protocol.ros.tracked import IDS_LIST
from hri_predict.protocol.ros.zed import OBJECTS

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.protocol.ros.sent import UPRIGHT, Maker

MAKER = Maker()
MS, S = 10**6, 10**9
UTC, BOOT = 1_790_000_000 * S, 500_000 * S
NAMES = ("low", "high")
BODY = np.array([[1.0, 2.0, 1.0], [1.0, 2.0, 1.5]])
GID, OTHER = b"a" * 16, b"b" * 16


class Cell:
    """A decoder, and a publisher whose messages arrive every 33 ms."""

    def __init__(self, kind=POSE_ARRAY, topics=("/people",), **options):
        self.counters = SourceCounters()
        tree = FrameTree()
        self.kind = kind
        self.now_ns = 5 * S
        self.decoder = Ros2Decoder(
            kind=kind,
            topics=list(topics),
            reader=PeopleReader(options.pop("names", NAMES), "map", tree),
            tree=tree,
            counters=self.counters,
            sees_room=options.pop("sees_room", True),
            utc_ns=lambda: UTC + self.now_ns,
            boot_ns=lambda: BOOT + self.now_ns,
            **options,
        )

    def hear(self, message, *, topic=0, gid=GID, sequence=NO_SEQUENCE, kind=None):
        content = MAKER.cdr(message, kind or self.kind)
        return self.feed(Heard(topic, gid, sequence, content).packed())

    def poses(self, at_ns, points=BODY, frame="map", **origin):
        return self.hear(MAKER.poses(points, frame, at_ns), **origin)

    def feed(self, data):
        self.now_ns += 33 * MS
        return self.decoder.feed(data, self.now_ns)


def test_a_message_is_a_scene():
    cell = Cell()
    (scene,) = cell.poses(UTC, np.concatenate([BODY, BODY + 1]))
    assert (scene.stamp_ns, scene.sees_room, scene.session) == (UTC, True, 0)
    assert [p.id for p in scene.people] == [1, 2]
    np.testing.assert_array_equal(scene.people[1].positions, BODY + 1)
    assert scene.people[0].observed.all()


def test_a_joint_that_is_not_a_number_is_not_observed():
    points = BODY.copy()
    points[1, 2] = np.nan
    (scene,) = Cell().poses(UTC, points)
    np.testing.assert_array_equal(scene.people[0].observed, [True, False])


@pytest.mark.parametrize("sees_room", [True, False])
def test_a_message_without_people_says_what_is_configured(sees_room):
    cell = Cell(sees_room=sees_room)
    (scene,) = cell.poses(UTC, np.zeros((0, 3)))
    assert (scene.sees_room, scene.people) == (sees_room, ())
    (scene,) = cell.poses(UTC + S)
    assert scene.sees_room


def test_a_wrong_number_of_joints_is_counted_with_topic_and_remedy():
    cell = Cell()
    assert cell.poses(UTC, np.zeros((3, 3))) == []
    assert cell.counters.malformed == 1
    assert cell.counters.last_error == (
        "/people: 3 poses are not a multiple of the 2 joints of the joint map; correct 'joint_map'"
    )


def test_a_wrong_frame_is_counted_until_its_transform_comes():
    cell = Cell()
    assert cell.poses(UTC, frame="camera") == []
    assert "frame_id 'camera' is not 'map'" in str(cell.counters.last_error)
    edge = ("map", "camera", (0.0, 0.0, 2.0), UPRIGHT)
    cell.hear(MAKER.transforms(edge), topic=TF_STATIC, kind=TF_MESSAGE)
    (scene,) = cell.poses(UTC + S, frame="camera")
    np.testing.assert_array_equal(scene.people[0].positions, BODY + np.array([0, 0, 2]))


def test_a_transform_that_is_no_pose_is_counted():
    cell = Cell()
    edge = ("map", "camera", (0.0, 0.0, 2.0), (0.0, 0.0, 0.0, 0.0))
    cell.hear(MAKER.transforms(edge), topic=TF, kind=TF_MESSAGE)
    assert cell.counters.malformed == 1


def test_a_zero_stamp_is_refused_with_the_remedy():
    cell = Cell()
    assert cell.poses(0) == []
    assert cell.counters.last_error == (
        "/people: header.stamp is zero; let the publisher stamp captures, or set 'stamp: arrival'"
    )


def test_by_arrival_any_stamp_will_do():
    cell = Cell(by_arrival=True)
    stamps = [cell.poses(0)[0].stamp_ns for _ in range(3)]
    assert stamps == [5 * S + k * 33 * MS for k in (1, 2, 3)]


@pytest.mark.parametrize(
    ("stamp_ns", "clock"), [(UTC + 5 * S, "utc"), (BOOT + 5 * S, "boot"), (3 * S, "other")]
)
def test_the_clock_of_the_stamps_is_logged_once(caplog, stamp_ns, clock):
    caplog.set_level("INFO")
    cell = Cell()
    cell.poses(stamp_ns)
    cell.poses(stamp_ns + 1)
    assert cell.decoder.captures.clock == clock
    assert len(caplog.messages) == 1
    assert "stamps are" in caplog.messages[0]


def test_a_repeated_message_is_not_a_capture():
    cell = Cell()
    cell.poses(UTC)
    assert cell.poses(UTC) == []
    assert cell.counters.replayed == 1


def test_an_overtaken_message_is_not_used():
    cell = Cell()
    cell.poses(UTC)
    assert cell.poses(UTC - 33 * MS) == []
    assert cell.counters.out_of_order == 1
    (scene,) = cell.poses(UTC + 33 * MS)
    assert scene.session == 0


def test_stamps_that_go_far_back_are_a_new_session():
    cell = Cell()
    cell.poses(UTC)
    (scene,) = cell.poses(UTC - 10 * S)
    assert (scene.session, scene.stamp_ns) == (1, UTC - 10 * S)


def test_stamps_that_stay_a_little_back_are_a_new_session():
    """As of a clock that was set back by 300 ms."""
    cell = Cell()
    cell.poses(UTC)
    heard = [cell.poses(UTC - 300 * MS + k * MS) for k in range(12)]
    assert [len(scenes) for scenes in heard] == 9 * [0] + 3 * [1]
    assert heard[-1][0].session == 1


def test_lost_messages_are_counted_by_the_publishers_numbers():
    cell = Cell()
    scenes = [cell.poses(UTC + n, sequence=n)[0] for n in (4, 5, 9)]
    assert cell.counters.lost == 3
    assert scenes[2].sequence - scenes[1].sequence == 4


def test_two_publishers_are_both_not_believed():
    cell = Cell()
    cell.poses(UTC)
    for k in range(1, 5):
        (scene,) = cell.poses(UTC + k, np.zeros((0, 3)), gid=(OTHER, GID)[k % 2])
        assert (scene.sees_room, scene.people) == (k == 1, ())
    assert cell.counters.last_error == "/people: two publishers; stop one of them"


def test_a_publisher_that_is_alone_for_a_second_is_believed():
    cell = Cell()
    cell.poses(UTC, gid=OTHER)
    found = [cell.poses(UTC + k)[0].sees_room for k in range(1, 40)]
    blind = S // (33 * MS)
    assert found == blind * [False] + (39 - blind) * [True]


def test_publishers_without_identity_are_one():
    cell = Cell()
    cell.poses(UTC, gid=NO_GID)
    (scene,) = cell.poses(UTC + 1, gid=NO_GID)
    assert scene.sees_room


def test_empty_markers_have_the_time_that_passed():
    cell = Cell(kind=MARKER_ARRAY)
    (one,) = cell.hear(MAKER.markers({7: BODY}, at_ns=UTC))
    (two,) = cell.hear(MAKER.marker_array([]))
    assert [p.id for p in one.people] == [7]
    assert (two.people, two.sees_room, two.stamp_ns) == ((), True, UTC + 33 * MS)


def test_several_topics_are_one_scene_once_all_said_who_they_see():
    cell = Cell(topics=("/a", "/b"))
    assert cell.poses(UTC, topic=1) == []
    (scene,) = cell.poses(UTC, np.zeros((0, 3)), topic=0)
    assert [p.id for p in scene.people] == [2]
    assert cell.poses(UTC + 1, topic=0) == []
    assert cell.poses(UTC + 2, topic=1) == []
    assert cell.counters.incomplete == 1


@pytest.mark.parametrize("doubled", [0, 1])
@pytest.mark.parametrize("order", [(0, 0, 1), (1, 0, 0), (0, 1, 0)])
def test_two_publishers_on_one_of_several_topics_are_not_believed(doubled, order):
    """Whichever message completes the scene."""
    cell, gids = Cell(topics=("/a", "/b")), iter((GID, OTHER))
    found = []
    for each in order:
        topic = doubled if each == 0 else 1 - doubled
        found += cell.poses(UTC, topic=topic, gid=next(gids) if topic == doubled else GID)
    found += cell.poses(UTC + 33 * MS, topic=0, gid=OTHER if doubled == 0 else GID)
    found += cell.poses(UTC + 33 * MS, topic=1, gid=OTHER if doubled == 1 else GID)
    assert found
    assert not any(scene.sees_room or scene.people for scene in found[-1:])


def test_several_topics_are_one_sequence():
    cell = Cell(topics=("/a", "/b"))
    numbers = []
    for k in range(5):
        for topic in (0, 1):
            numbers += [s.sequence for s in cell.poses(UTC + k * 33 * MS, topic=topic)]
    assert np.diff(numbers).tolist() == [1, 1, 1, 1]


def test_two_people_on_one_of_several_topics_are_refused():
    cell = Cell(topics=("/a", "/b"))
    assert cell.poses(UTC, np.concatenate([BODY, BODY]), topic=1) == []
    assert str(cell.counters.last_error).startswith("/b: more than one person")


def shown(cell, name, at_ns, *, gid=GID, x=1.0):
    edges = [("map", f"{joint}_{name}", (x, 2.0, 1.0), UPRIGHT) for joint in NAMES]
    return cell.hear(MAKER.transforms(*edges, at_ns=at_ns), topic=TF, gid=gid, kind=TF_MESSAGE)


def tracked(cell, *ids, at_ns):
    return cell.hear(MAKER.tracked(*ids, at_ns=at_ns))


def test_tracked_bodies_wait_for_their_frames_in_order():
    cell = Cell(kind=IDS_LIST)
    shown(cell, "abc", UTC)
    (scene,) = tracked(cell, "abc", at_ns=UTC)
    assert scene.people[0].observed.all()
    assert tracked(cell, "abc", at_ns=UTC + MS) == []
    assert tracked(cell, at_ns=UTC + 2 * MS) == []
    after, empty = shown(cell, "abc", UTC + MS)
    assert [p.id for p in after.people] == [p.id for p in scene.people]
    assert (empty.people, empty.stamp_ns) == ((), UTC + 2 * MS)


def test_a_tracked_body_whose_frames_do_not_come_refuses_the_capture():
    cell = Cell(kind=IDS_LIST)
    shown(cell, "abc", UTC)
    for k in range(1, 12):
        assert tracked(cell, "abc", at_ns=UTC + k * 33 * MS) == []
    assert cell.counters.malformed == 4  # those that have waited for 0.2 s
    assert str(cell.counters.last_error).startswith("/people: body 'abc' has no place")


def test_messages_that_wait_are_few():
    cell = Cell(kind=IDS_LIST)
    shown(cell, "abc", UTC)
    for k in range(1, 101):
        cell.now_ns -= 33 * MS  # a flood: all at once
        assert tracked(cell, "abc", at_ns=UTC + k) == []
    assert cell.counters.malformed == 100 - MAX_WAITING


def test_another_publisher_of_a_bodys_frames_takes_its_place_away():
    cell = Cell(kind=IDS_LIST)
    shown(cell, "abc", UTC)
    shown(cell, "abc", UTC + MS, gid=OTHER, x=5.0)
    assert tracked(cell, "abc", at_ns=UTC + MS) == []
    assert "two publishers give the transform" in str(cell.counters.last_error)


def test_poses_of_a_camera_that_moves_wait_for_its_transform():
    cell = Cell()
    for at_ns, x in ((UTC, 0.0), (UTC + 100 * MS, 1.0)):
        if at_ns > UTC:
            assert cell.poses(UTC + 50 * MS, frame="camera") == []
        edge = ("map", "camera", (x, 0.0, 0.0), UPRIGHT)
        made = MAKER.transforms(edge, at_ns=at_ns)
        found = cell.hear(made, topic=TF, kind=TF_MESSAGE)
    (scene,) = found
    # one interpolation of numbers near 1
    np.testing.assert_allclose(scene.people[0].positions, BODY + np.array([0.5, 0, 0]), atol=1e-15)


CDR = MAKER.cdr(MAKER.poses(BODY, "map", UTC), POSE_ARRAY)
MARKERS = MAKER.cdr(MAKER.markers({1: BODY}, "map", UTC), MARKER_ARRAY)
ZED = MAKER.cdr(MAKER.objects({1: np.ones((18, 3))}, at_ns=UTC), OBJECTS)
IDS = MAKER.cdr(MAKER.tracked("abc", at_ns=UTC), IDS_LIST)
BODIES = MAKER.cdr(MAKER.body("abc", {"low": BODY[0]}, UTC), TF_MESSAGE)
FRAMES = MAKER.cdr(MAKER.transforms(("map", "camera", (0.0, 0.0, 2.0), UPRIGHT)), TF_MESSAGE)


@given(
    st.sampled_from([POSE_ARRAY, MARKER_ARRAY, IDS_LIST, OBJECTS]),
    st.lists(
        st.tuples(
            st.sampled_from([0, 1, TF, TF_STATIC]),
            st.one_of(
                st.binary(max_size=60),
                st.tuples(
                    st.sampled_from([CDR, MARKERS, IDS, ZED, BODIES, FRAMES]),
                    st.integers(0, 400),
                    st.binary(min_size=1, max_size=8),
                ).map(lambda cut: cut[0][: cut[1]] + cut[2] + cut[0][cut[1] + len(cut[2]) :]),
            ),
        ),
        max_size=8,
    ),
)
def test_any_bytes_are_refused_or_a_scene_of_numbers(kind, units):
    cell = Cell(kind=kind, names=[f"k{k}" for k in range(18)] if kind == OBJECTS else NAMES)
    for topic, content in units:
        for scene in cell.feed(Heard(topic, GID, NO_SEQUENCE, content).packed()):
            for person in scene.people:
                assert np.isfinite(person.positions[person.observed]).all()
                assert 0 <= person.id <= 65_535
    assert cell.counters.packets == len(units)


@given(st.binary(max_size=24))
def test_a_unit_that_is_cut_is_refused(data):
    cell = Cell()
    assert cell.feed(data) == []
    assert cell.counters.malformed == 1


def test_a_message_that_is_too_long_is_refused():
    cell = Cell()
    assert cell.feed(Heard(0, GID, NO_SEQUENCE, bytes(MAX_BYTES + 1)).packed()) == []
    assert "more than 1048576 bytes" in str(cell.counters.last_error)
