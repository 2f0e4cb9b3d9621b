import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.settings import Pose
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import SourceSettings
from hri_predict.people.people import People
from hri_predict.people.settings import PeopleSettings
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.people.figures import ALL, SHAPE, J

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
MS = 1_000_000
RATE = 25.0
PERIOD = 40 * MS
T = 10


def body(person_id, x, y=0.0, observed=ALL):
    positions = SHAPE + np.array([x, y, 0.0])
    return Person(person_id, np.where(observed[:, None], positions, np.nan), observed)


def test_nothing_received_is_no_input(make_room):
    snapshot = make_room().snapshot()
    assert snapshot.reasons == (Reason.NO_INPUT,)
    assert snapshot.newest_capture_ns is None
    assert snapshot.age_s is None
    assert snapshot.history.shape == (0, T, J, 3)
    assert snapshot.observed.shape == (0, T, J)
    assert snapshot.last_positions.shape == (0, J, 3)
    assert snapshot.capture_ns.shape == (0,)


def test_a_walker_is_followed_with_his_history(make_room):
    room = make_room()
    for i in range(30):
        snapshot = room.see(body(3, 0.04 * i), body(1, 5.0))
    assert snapshot.reasons == ()
    assert snapshot.ids == (1, 3)
    assert snapshot.captures == 30
    assert snapshot.capture_ns.tolist() == [room.now - 5 * MS] * 2
    assert snapshot.newest_capture_ns == room.now - 5 * MS
    assert snapshot.age_s == pytest.approx(0.005)
    assert snapshot.observed.all()
    expected = SHAPE + np.array([[[0.04 * i, 0.0, 0.0]] for i in range(20, 30)])
    np.testing.assert_allclose(snapshot.history[1], expected, atol=1e-9)
    np.testing.assert_allclose(snapshot.last_positions[1], expected[-1], atol=1e-9)
    assert (snapshot.joint_age_s == 0).all()


def test_an_empty_room_that_is_seen_is_good_input(make_room):
    snapshot = make_room().see(times=5)
    assert snapshot.reasons == ()
    assert snapshot.ids == ()
    assert snapshot.captures == 5


def test_joints_not_observed_age(make_room):
    room = make_room()
    hidden = ALL.copy()
    hidden[4] = False
    never = ALL.copy()
    never[9] = False
    room.see(body(1, 0.0, observed=never), times=3)
    snapshot = room.see(body(1, 0.1, observed=never & hidden), times=4)
    assert np.isfinite(snapshot.history).all()
    assert not snapshot.observed[0, -1, 4]
    assert not snapshot.observed[0, :, 9].any()
    assert snapshot.joint_age_s[0, 4] == pytest.approx(0.16)
    assert snapshot.joint_age_s[0, 9] == np.inf
    assert snapshot.last_positions[0, 4] == pytest.approx(SHAPE[4])
    assert np.isnan(snapshot.last_positions[0, 9]).all()


def test_a_source_of_another_skeleton_is_mapped(make_room):
    joint_map = load_joint_map("coco17")
    names = joint_map.source_joints
    positions = np.random.default_rng(1).uniform(0, 1, (len(names), 3))
    room = make_room(joint_map="coco17")
    snapshot = room.see(Person(1, positions, np.ones(len(names), bool)), times=2)
    expected, seen = joint_map.map(positions, np.ones(len(names), bool))
    assert seen.any()
    assert not seen.all()
    np.testing.assert_array_equal(snapshot.measured[0, -1], seen)
    np.testing.assert_allclose(snapshot.history[0, -1][seen], expected[seen])


# -- stale, blind, frozen -------------------------------------------------------------------------


def test_silence_is_stale_after_two_periods_and_10_ms_and_clears_by_itself(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    limit = 2 * PERIOD + 10 * MS  # from the receipt: the least latency, 5 ms, is added
    assert room.snapshot(later=limit).reasons == ()
    stale = room.snapshot(later=limit + 1)
    assert stale.reasons == (Reason.INPUT_STALE,)
    assert stale.ids == (1,)
    assert stale.capture_ns[0] == room.now - 5 * MS
    room.now += 10_000 * MS
    assert room.see(body(1, 0.0)).reasons == ()


@pytest.mark.parametrize("latency_ms", [0, 5, 30])
def test_one_lost_capture_is_not_stale_however_long_the_least_latency(make_room, latency_ms):
    room = make_room(latency=latency_ms * MS)
    room.see(body(1, 0.0), times=5)
    late = 9 * MS  # less than the jitter that is allowed for
    assert room.snapshot(later=2 * PERIOD + late).reasons == ()


def test_the_stale_limit_can_be_configured(make_room):
    room = make_room(source={"stale_s": 0.5})
    room.see(body(1, 0.0))
    assert room.snapshot(later=490 * MS).reasons == ()
    assert room.snapshot(later=500 * MS).reasons == (Reason.INPUT_STALE,)


def test_an_added_delay_shows_as_age(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=50)
    room.now += 200 * MS  # the way takes 200 ms longer from here on
    for _ in range(20):
        snapshot = room.see(body(1, 0.0), stamp_error=-200 * MS)
    assert snapshot.counters["clock_jumps"] == 0
    assert snapshot.age_s == pytest.approx(0.205, abs=0.001)
    assert snapshot.reasons == (Reason.INPUT_STALE,)


def test_a_blind_source_is_said_to_be_blind_and_then_stale(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    snapshot = room.see(sees_room=False)
    assert snapshot.reasons == (Reason.SOURCE_BLIND,)
    assert snapshot.captures == 5
    snapshot = room.see(sees_room=False, times=10)
    assert snapshot.reasons == (Reason.SOURCE_BLIND, Reason.INPUT_STALE)
    assert snapshot.ids == (1,)  # not seen to have gone
    assert snapshot.lost == ()
    assert room.see(body(1, 0.1)).reasons == ()


def test_a_sequence_that_stands_still_is_frozen_however_often_it_arrives(make_room):
    room = make_room(source={"stale_s": 0.14})  # after it is said to be frozen
    room.see(body(1, 0.0), times=5)
    assert room.see(body(1, 0.1), step=0, times=2).reasons == ()
    snapshot = room.see(body(1, 0.1), step=0)
    assert snapshot.reasons == (Reason.INPUT_FROZEN,)
    snapshot = room.see(body(1, 0.1), step=0, times=3)
    assert snapshot.reasons == (Reason.INPUT_FROZEN, Reason.INPUT_STALE)
    assert snapshot.captures == 5
    assert snapshot.counters["duplicate_scenes"] == 6
    room.sequence += 6
    assert room.see(body(1, 0.1)).reasons == ()


@pytest.mark.parametrize("declares_noise", [True, False])
def test_identical_joints_are_frozen_only_from_a_source_that_declares_noise(
    make_room, declares_noise
):
    room = make_room(declares_noise=declares_noise, source={"stale_s": 0.14})
    for i in range(5):
        room.see(body(1, 0.01 * i))
    snapshot = room.see(body(1, 0.04), times=3)
    if not declares_noise:
        assert snapshot.reasons == ()
        return
    assert snapshot.reasons == (Reason.INPUT_FROZEN,)
    assert snapshot.captures == 5
    assert snapshot.counters["identical_captures"] == 3
    assert snapshot.capture_ns[0] == room.now - 5 * MS - 3 * PERIOD
    assert room.see(body(1, 0.05)).reasons == ()


def test_a_jump_of_the_clock_is_said_and_clears(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=20)
    snapshot = room.see(body(1, 0.0), stamp_error=10_000 * MS)
    assert snapshot.reasons == (Reason.CLOCK_JUMP,)
    assert snapshot.counters["clock_jumps"] == 1
    assert snapshot.capture_ns[0] == room.now - 5 * MS
    assert room.see(body(1, 0.0), stamp_error=10_000 * MS, times=9).reasons == (Reason.CLOCK_JUMP,)
    assert room.see(body(1, 0.0), stamp_error=10_000 * MS).reasons == ()


def test_scenes_out_of_order_are_refused_and_a_restart_is_taken(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=20)
    room.sequence -= 3
    assert room.see(body(1, 0.5)).counters["scenes_out_of_order"] == 1
    room.sequence += 2
    assert room.see(body(1, 0.0)).reasons == ()
    room.sequence = 0  # the source began anew, and so did its clock
    snapshot = room.see(body(1, 0.0), times=9, stamp_error=-room.now)
    assert Reason.INPUT_FROZEN in snapshot.reasons
    snapshot = room.see(body(1, 0.0), stamp_error=-room.now)
    assert snapshot.reasons == (Reason.CLOCK_JUMP,)
    assert snapshot.counters["source_restarts"] == 1
    assert room.see(body(1, 0.0), times=12, stamp_error=-room.now).reasons == ()


def test_lost_scenes_are_counted(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=2)
    room.now += 2 * PERIOD
    snapshot = room.see(body(1, 0.0), step=3)
    assert snapshot.reasons == ()
    assert snapshot.counters["lost_scenes"] == 2


# -- real people ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "joint_map", "key", "every", "rate_hz"),
    [
        ("cmu_mocap/test/walking_1.npz", "cmu38", "positions_world", 4, 30.0),
        ("cmu_mocap/test/soccer_1.npz", "cmu38", "positions_world", 1, 120.0),
        ("cmu_mocap/test/jumping_1.npz", "cmu38", "positions_world", 4, 30.0),
        ("assembly/task5_human2_trial2.npz", "assembly_arms", "positions", 1, 30.0),
    ],
)
def test_what_real_people_do_is_never_impossible(file, joint_map, key, every, rate_hz):
    """Kicks at 19 m/s and a tracker's jumps of 0.1 m among it."""
    path = SHARED / "data" / file
    if not path.exists():
        pytest.skip("needs ../shared/data")
    with np.load(path) as data:
        mapped = load_joint_map(joint_map)
        raw = mapped.to_metres_z_up(data[key][1::every].astype(float))
    people = People(
        settings=PeopleSettings(),
        joint_map=mapped,
        source_settings=SourceSettings(kind="test", room_from_source=Pose()),
        rate_hz_source=rate_hz,
        declares_noise=True,
        history_steps=T,
        rate_hz_predictor=25.0,
    )
    for index, positions in enumerate(raw):
        now = round(index * 1e9 / rate_hz)
        person = Person(1, positions, np.isfinite(positions).all(axis=1))
        people.receive(Scene(now, index, True, (person,)), now)
    snapshot = people.snapshot(now)
    assert snapshot.reasons == ()
    assert snapshot.ids == (1,)
    assert snapshot.captures >= len(raw) - 5  # a few frames of the assembly data repeat
    for name in ("impossible_captures", "impossible_joints", "vanished", "stamps_out_of_order"):
        assert snapshot.counters.get(name, 0) == 0


# -- whatever comes -------------------------------------------------------------------------------

numbers = st.sampled_from([0.0, 0.5, 2.0, np.nan, np.inf, -1e308, 999.0])
persons = st.builds(
    lambda i, x, y, bits: Person(
        i,
        SHAPE + np.array([x, y, 0.0]) if np.isfinite(x) else np.full((J, 3), x),
        np.array([bits >> k & 1 for k in range(J)], bool),
    ),
    st.integers(0, 6),
    numbers,
    numbers,
    st.sampled_from([0, 1, 2**J - 1, 0b1010]),
)
scenes = st.tuples(
    st.lists(persons, max_size=5),
    st.booleans(),
    st.integers(-3, 5),
    st.integers(0, 3000),
    st.sampled_from([0, 0, 0, 10**12, -(10**12), 2**70]),
)


@given(st.lists(scenes, max_size=40), st.booleans())
def test_any_scenes_leave_a_sound_snapshot_and_a_stage_that_recovers(
    make_room, script, declares_noise
):
    room = make_room(declares_noise=declares_noise, max_people=4)
    for people, sees_room, step, wait_ms, stamp_error in script:
        room.now += wait_ms * MS
        snapshot = room.see(*people, sees_room=sees_room, step=step, stamp_error=stamp_error)
        assert np.isfinite(snapshot.history).all()
        assert len(snapshot.ids) == len(set(snapshot.ids)) <= 4
        assert len(snapshot.lost) <= 4
        assert snapshot.history.shape == (len(snapshot.ids), T, J, 3)
        assert (snapshot.capture_ns <= room.now).all()
        assert snapshot.newest_capture_ns is None or snapshot.newest_capture_ns <= room.now
    # until an operator says that whoever was lost is gone
    for _ in range(120):
        room.see()
    room.people.acknowledge()
    snapshot = room.see()
    assert snapshot.reasons == ()
    assert snapshot.ids == ()
    assert snapshot.lost == ()
    assert room.see(body(9, 0.0)).reasons == ()


def test_snapshots_are_whole_while_scenes_come_in(make_room):
    """Every joint of a capture has the same x: a snapshot that mixes captures shows."""
    room = make_room(max_joint_speed_m_s=100.0)
    done = threading.Event()
    failures: list[object] = []

    def receive():
        try:
            for i in range(1500):
                positions = np.full((J, 3), 0.01 * i)
                positions[:, 1:] = SHAPE[:, 1:]
                room.now += PERIOD
                room.sequence += 1
                person = Person(i // 300, positions, ALL)
                room.people.receive(Scene(room.now, room.sequence, True, (person,)), room.now)
        except Exception as error:
            failures.append(error)
        done.set()

    thread = threading.Thread(target=receive)
    thread.start()
    taken = 0
    while not done.is_set() or not taken:
        snapshot = room.people.snapshot(room.now)
        x = snapshot.history[..., 0]
        if not (x == x[..., :1]).all():
            failures.append("torn history")
        newest = snapshot.observed[:, -1]  # none where the writer went all the way round meanwhile
        if not (x[:, -1] == snapshot.last_positions[..., 0])[newest].all():
            failures.append("newest step is not the newest capture")
        taken += bool(newest.any())
    thread.join(60)
    assert not failures
    assert taken > 10
