"""Faults do what they say, within their time, and the same with the same seed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.wires.transport import pipe
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.protocol.can import CanFrame
from hri_sim.faults.injector import (
    LINK_FAULTS,
    SOURCE_FAULTS,
    FaultySource,
    FaultyTransport,
)

PERIOD = 40_000_000
JOINTS = 21


class Walkers:
    """Two people who move a little with every scene; scene k at k periods."""

    joint_map = load_joint_map("canonical")  # not looked into
    rate_hz = 25.0
    declares_noise = True

    def __init__(self, count=100, people=2):
        self._scenes = [
            Scene(
                stamp_ns=k * PERIOD,
                sequence=k,
                sees_room=True,
                people=tuple(
                    Person(
                        id=10 + p,
                        positions=np.full((JOINTS, 3), 100.0 * p + k),
                        observed=np.ones(JOINTS, dtype=bool),
                    )
                    for p in range(people)
                ),
            )
            for k in range(count)
        ]

    def open(self, start_ns):
        assert start_ns == 0

    def next_ns(self):
        return self._scenes[0].stamp_ns if self._scenes else None

    def poll(self, now_ns):
        if self._scenes and self._scenes[0].stamp_ns <= now_ns:
            return self._scenes.pop(0)
        return None

    def close(self):
        pass


def heard(*faults, seed=0, people=2, count=100, source=None):
    """All (arrival in periods, scene) that come through."""
    source = FaultySource(source or Walkers(count, people), faults, seed)
    source.open(0)
    out = []
    while (due := source.next_ns()) is not None:
        while (scene := source.poll(due)) is not None:
            out.append((due / PERIOD, scene))
    return out


def window(kind, **parameters):
    """A fault from scene 25 to scene 49."""
    needed = {"joints": ["waist"]} if kind == "hide" else {}
    return {"kind": kind, "start_s": 1.0, "duration_s": 1.0, **needed, **parameters}


def sequences(scenes):
    return [s.sequence for _, s in scenes]


def test_without_faults_nothing_changes_and_the_truth_is_told():
    source = FaultySource(Walkers(), [], 0)
    truth: list[Scene] = []
    source.on_truth = truth.append
    source.open(0)
    scenes = []
    while (due := source.next_ns()) is not None:
        while (scene := source.poll(due)) is not None:
            scenes.append(scene)
    assert scenes == truth
    assert [s.sequence for s in scenes] == list(range(100))


def test_drop():
    assert sequences(heard(window("drop"))) == [*range(25), *range(50, 100)]
    some = sequences(heard(window("drop", probability=0.5)))
    assert 100 - 22 < len(some) < 100 - 3


@pytest.mark.parametrize("growth", [0.0, 0.5])
def test_delay_is_late_with_its_true_stamp(growth):
    scenes = heard(window("delay", delay_s=0.2, growth=growth))
    assert sorted(sequences(scenes)) == list(range(100))
    for arrival, scene in scenes:
        grown = growth * (scene.sequence - 25)
        late = 5 + grown if 25 <= scene.sequence < 50 else 0
        assert arrival == pytest.approx(scene.sequence + late)
        assert scene.stamp_ns == scene.sequence * PERIOD


def test_jitter_is_late_by_at_most_its_maximum_and_in_order():
    scenes = heard(window("jitter", max_s=0.1))
    inside = [(a, s) for a, s in scenes if 25 <= s.sequence < 48]
    lateness = [a - s.sequence for a, s in inside]
    assert max(lateness) <= 2.5 + 1e-9
    assert max(lateness) > 1.0
    assert min(lateness) >= 0
    assert [s.sequence for _, s in inside] == list(range(25, 48))


def test_freeze_repeats_the_last_scene_before_it():
    scenes = [s for _, s in heard(window("freeze"))]
    assert [s.sequence for s in scenes] == [*range(25), *[24] * 25, *range(50, 100)]
    assert all(s is scenes[24] for s in scenes[25:50])


def test_freeze_of_joints_goes_on_counting():
    scenes = [s for _, s in heard(window("freeze", what="joints"))]
    assert [s.sequence for s in scenes] == list(range(100))
    for scene in scenes[25:50]:
        np.testing.assert_array_equal(scene.people[0].positions, 24.0)
        assert scene.stamp_ns == scene.sequence * PERIOD
    np.testing.assert_array_equal(scenes[50].people[0].positions, 50.0)


def test_freeze_from_the_very_start_freezes_the_first():
    assert set(sequences(heard({"kind": "freeze"}))) == {0}


def test_duplicate():
    expected = [k for k in range(100) for _ in range(2 if 25 <= k < 50 else 1)]
    assert sequences(heard(window("duplicate"))) == expected


def test_reorder_swaps_neighbours_and_loses_nobody():
    order = sequences(heard(window("reorder")))
    assert sorted(order) == list(range(100))
    assert order[25:29] == [26, 25, 28, 27]
    assert order[51:] == list(range(51, 100))


def test_nan_hits_somebody_every_time_and_claims_to_have_seen_it():
    scenes = [s for _, s in heard(window("nan", fraction=0.2))]
    for scene in scenes:
        bad = [np.isnan(p.positions).any() for p in scene.people]
        assert all(bad) if 25 <= scene.sequence < 50 else not any(bad)
        assert all(p.observed.all() for p in scene.people)


def test_teleport_moves_whom_it_names():
    scenes = [s for _, s in heard(window("teleport", offset=[0, 3, 0], person=11))]
    for scene in scenes:
        moved = [0, 3, 0] if 25 <= scene.sequence < 50 else [0, 0, 0]
        one, two = scene.people
        np.testing.assert_allclose(one.positions[0], np.full(3, scene.sequence))
        np.testing.assert_allclose(two.positions[0], np.full(3, 100.0 + scene.sequence) + moved)


def test_identity_swap():
    scenes = [s for _, s in heard(window("identity_swap"))]
    assert [p.id for p in scenes[24].people] == [10, 11]
    assert [p.id for p in scenes[25].people] == [11, 10]
    alone = [s for _, s in heard(window("identity_swap"), people=1)]
    assert [s.people[0].id for s in (alone[24], alone[25], alone[50])] == [10, 1010, 10]


def test_vanish_leaves_the_room_in_sight_and_blind_does_not():
    scenes = [s for _, s in heard(window("vanish", person=10))]
    assert [p.id for p in scenes[30].people] == [11]
    assert len(scenes[60].people) == 2
    nobody = [s for _, s in heard(window("vanish"))]
    assert nobody[30].people == ()
    assert nobody[30].sees_room
    blind = [s for _, s in heard(window("blind"))]
    assert blind[30].people == ()
    assert not blind[30].sees_room


def test_clock_drift_keeps_the_offset_that_it_gained():
    scenes = [s for _, s in heard(window("clock_drift", ppm=1000.0))]
    offsets = [s.stamp_ns - s.sequence * PERIOD for s in scenes]
    assert offsets[25] == 0
    assert offsets[37] == pytest.approx(12 * PERIOD * 1e-3, abs=2)
    assert offsets[99] == pytest.approx(1e6, abs=2)


def test_clock_jump_comes_and_goes():
    scenes = [s for _, s in heard(window("clock_jump", offset_s=-2.0))]
    offsets = {s.stamp_ns - s.sequence * PERIOD for s in scenes[25:50]}
    assert offsets == {-2_000_000_000}
    assert scenes[24].stamp_ns == 24 * PERIOD
    assert scenes[50].stamp_ns == 50 * PERIOD


def test_every_kind_acts_and_is_counted():
    for kind in SOURCE_FAULTS:
        source = FaultySource(Walkers(), [window(kind)], 1)
        source.open(0)
        while (due := source.next_ns()) is not None:
            while source.poll(due) is not None:
                pass
        assert source.injected == {kind: 25}


@given(kinds=st.lists(st.sampled_from(sorted(SOURCE_FAULTS)), max_size=4), seed=st.integers(0, 9))
def test_any_mixture_is_deterministic_ends_and_arrives_in_time_order(kinds, seed):
    def once():
        out = heard(*(window(k) for k in kinds), seed=seed, count=60)
        arrivals = [a for a, _ in out]
        assert arrivals == sorted(arrivals)
        return [
            (a, s.sequence, s.stamp_ns, [p.positions.tobytes() for p in s.people]) for a, s in out
        ]

    assert once() == once()


# --- links ---------------------------------------------------------------------------------------


def wire(*faults, seed=0):
    near, far = pipe()  # type: ignore[var-annotated]
    clock = VirtualClock()
    far.open()
    faulty = FaultyTransport(inner=near, faults=faults, clock=clock, seed=seed)
    faulty.open()
    return faulty, far, clock


def sent(*faults, seed=0, units=None, to_far=True):
    """Send a unit each 10 ms for 3 s through the faults; what comes, with the time in ms."""
    faulty, far, clock = wire(*faults, seed=seed)
    out = []
    for k in range(300):
        clock.advance_to(k * 10_000_000)
        unit = units(k) if units else bytes([k % 256, k // 256]) * 8
        if to_far:
            faulty.write(unit)
            faulty.read(0.0)
            out += [(k * 10, u) for u in far.read(0.0)]
        else:
            far.write(unit)
            out += [(k * 10, u) for u in faulty.read(0.0)]
    return out


def numbers(out):
    return [u[0] + 256 * u[1] for _, u in out]


@pytest.mark.parametrize("to_far", [True, False])
def test_a_link_without_faults_is_the_wire(to_far):
    assert numbers(sent(to_far=to_far)) == list(range(300))


@pytest.mark.parametrize("to_far", [True, False])
def test_link_freeze_drop_duplicate_flood_reorder(to_far):
    assert numbers(sent(window("freeze"), to_far=to_far)) == [*range(100), *range(200, 300)]
    dropped = numbers(sent(window("drop", probability=0.5), to_far=to_far))
    assert 230 < len(dropped) < 270
    doubled = [k for k in range(300) for _ in range(2 if 100 <= k < 200 else 1)]
    assert numbers(sent(window("duplicate"), to_far=to_far)) == doubled
    flood = [k for k in range(300) for _ in range(10 if 100 <= k < 200 else 1)]
    assert numbers(sent(window("flood"), to_far=to_far)) == flood
    order = numbers(sent(window("reorder"), to_far=to_far))
    assert sorted(order) == list(range(300))
    assert order[100:104] == [101, 100, 103, 102]


def test_a_fault_of_one_direction_spares_the_other():
    only_in = window("freeze", direction="in")
    assert len(sent(only_in, to_far=True)) == 300
    assert len(sent(only_in, to_far=False)) == 200


def test_link_delay_and_jitter_keep_the_order():
    out = sent(window("delay", delay_s=0.2))
    assert numbers(out) == list(range(300))
    for (ms, _), k in zip(out[100:200], range(100, 200), strict=True):
        assert ms == 10 * k + 200
    out = sent(window("jitter", max_s=0.05))
    assert numbers(out) == list(range(300))
    late = [ms - 10 * k for (ms, _), k in zip(out, range(300), strict=True)]
    assert 20 <= max(late) <= 60
    assert max(late[:100]) == 0


def test_bit_errors_flip_about_as_many_bits_as_they_say():
    out = sent(window("bit_errors", rate=0.01), units=lambda _k: bytes(128))
    flipped = sum(bin(int.from_bytes(u, "big")).count("1") for _, u in out)
    expected = 100 * 128 * 8 * 0.01
    assert abs(flipped - expected) < 5 * expected**0.5
    assert all(not any(u) for ms, u in out if not 1000 <= ms < 2000)


def test_truncate_shortens_bytes_and_frames():
    out = sent(window("truncate", probability=1.0))
    lengths = [len(u) for ms, u in out if 1000 <= ms < 2000]
    assert lengths
    assert max(lengths) < 16
    frames = sent(
        window("truncate", probability=1.0), units=lambda k: CanFrame(0x100, bytes(8), False, False)
    )
    assert all((len(f.data) < 8) == (1000 <= ms < 2000) for ms, f in frames)
    assert len(frames) == 300


def test_bit_errors_leave_a_frame_its_id():
    frames = sent({"kind": "bit_errors", "rate": 0.5}, units=lambda k: CanFrame(k, bytes(8)))
    assert [f.arbitration_id for _, f in frames] == list(range(300))
    assert any(any(f.data) for _, f in frames)


def test_unplug_fails_every_call_and_comes_back():
    faulty, far, clock = wire(window("unplug"))
    clock.advance_to(1_500_000_000)
    for call in (faulty.open, lambda: faulty.write(b"x"), lambda: faulty.read(0.0)):
        with pytest.raises(LinkError, match="unplugged"):
            call()
    faulty.close()
    clock.advance_to(2_000_000_000)
    faulty.open()  # the time goes on from the first opening
    faulty.write(b"x")
    assert far.read(0.0) == [b"x"]


@given(
    kinds=st.lists(st.sampled_from(sorted(set(LINK_FAULTS) - {"unplug"})), max_size=4),
    seed=st.integers(0, 9),
)
def test_any_mixture_of_link_faults_is_deterministic(kinds, seed):
    few = {"flood": {"times": 2}}  # four floods of ten are ten thousand
    faults = [window(k, **few.get(k, {})) for k in kinds]
    assert sent(*faults, seed=seed) == sent(*faults, seed=seed)


@pytest.mark.parametrize("data", [{}, {"kind": 3}, "vanish", None])
def test_a_fault_that_is_no_mapping_with_a_kind_is_refused(data):
    with pytest.raises(ConfigError, match=r"source\.faults\.0"):
        FaultySource(Walkers(), [data], 0)
