"""Times of captures whose sender's clock was set back, or stamped some of them wrong."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.lab.calibration.presence import presences_of
from hri_predict.lab.datasets.tracks import tracks_of
from hri_predict.recording import Recording
from hri_predict.recording.one_clock import on_one_clock
from tests.hri_predict.recording.made import of_scenes

MS, S = 10**6, 10**9
TRUE = [k * 20 * MS for k in range(120)]
RECEIPTS = [ns + 5 * MS for ns in TRUE]


@given(st.lists(st.integers(0, 10**12), max_size=40))
def test_stamps_that_never_decrease_are_the_times(stamps):
    stamps.sort()
    clock = on_one_clock(stamps, stamps)
    assert (clock.times_ns, clock.restarts) == (stamps, [])


@pytest.mark.parametrize("k", [0, 1, 10, 60, 117])
@pytest.mark.parametrize("by_ns", [3000 * S, 3 * S, 90 * MS])
def test_one_stamp_ahead_is_left_out_alone(k, by_ns):
    stamps = [ns + by_ns * (i == k) for i, ns in enumerate(TRUE)]
    wanted = [None if i == k else ns for i, ns in enumerate(TRUE)]
    assert on_one_clock(stamps, RECEIPTS).times_ns == wanted


@pytest.mark.parametrize("k", [1, 10, 60, 118])
@pytest.mark.parametrize("by_ns", [3000 * S, 3 * S, 90 * MS])
def test_one_stamp_behind_is_left_out_alone(k, by_ns):
    stamps = [ns - by_ns * (i == k) for i, ns in enumerate(TRUE)]
    wanted = [None if i == k else ns for i, ns in enumerate(TRUE)]
    if k == 1:  # of two, the one that agrees with the rest
        wanted[:2] = [0, None]
    assert on_one_clock(stamps, RECEIPTS).times_ns == wanted


@pytest.mark.parametrize("at", [10, 60, 110, 118])
@pytest.mark.parametrize("by_ns", [3000 * S, 3 * S, S])
def test_after_a_restart_times_go_on_by_the_receipts(at, by_ns):
    stamps = [ns - by_ns * (k >= at) for k, ns in enumerate(TRUE)]
    clock = on_one_clock(stamps, RECEIPTS)
    assert (clock.times_ns, clock.restarts) == (TRUE, [at])


def test_several_restarts_with_pauses():
    stamps, receipts = [], []
    for pause in range(3):
        stamps += TRUE
        receipts += [ns + pause * 10 * S for ns in RECEIPTS]
    clock = on_one_clock(stamps, receipts)
    assert clock.times_ns == [ns - 5 * MS for ns in receipts]
    assert clock.restarts == [120, 240]


def test_receipts_all_at_once_leave_the_usual_step():
    stamps = [ns - S * (k >= 60) for k, ns in enumerate(TRUE)]
    assert on_one_clock(stamps, [0] * 120).times_ns == TRUE


def walk(stamps) -> Recording:
    """1.2 m/s along x, received in time."""
    joint_map = load_joint_map("canonical")
    body = np.random.default_rng(0).normal(size=(len(joint_map.source_joints), 3)) * 0.3
    seen = np.ones(len(body), bool)
    ahead = np.array([1.2e-9, 0.0, 0.0])
    scenes = [
        Scene(stamp, k, True, (Person(1, body + ahead * ns, seen),))
        for k, (stamp, ns) in enumerate(zip(stamps, TRUE, strict=True))
    ]
    return of_scenes(scenes, joint_map, 50.0, arrival_ns=RECEIPTS, kind="mcap")


@pytest.mark.parametrize("at", [30, 60, 100])
@pytest.mark.parametrize("of", [tracks_of, presences_of])
def test_a_person_never_leaps_where_the_sender_began_again(of, at):
    stamps = [ns if k < at else ns - TRUE[at] for k, ns in enumerate(TRUE)]
    (whole,), (found,) = of(walk(TRUE)), of(walk(stamps))
    np.testing.assert_array_equal(found.stamps_ns, whole.stamps_ns)
    np.testing.assert_array_equal(found.positions, whole.positions)


@pytest.mark.parametrize("of", [tracks_of, presences_of])
def test_a_stamp_ahead_costs_one_capture(of):
    (found,) = of(walk([ns + 100 * S * (k == 30) for k, ns in enumerate(TRUE)]))
    assert found.stamps_ns.tolist() == [ns for k, ns in enumerate(TRUE) if k != 30]
