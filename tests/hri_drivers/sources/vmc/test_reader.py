"""From VMC's messages to captures of one performer."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.mocap.frames import Frame, FrameError
from hri_drivers.sources.vmc.bones import global_positions
from hri_drivers.sources.vmc.source import VmcReader
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders import vmc

BODY = Body(1.75)
JOINTS = BODY.joints(BODY.standing(np.array([1.0, 2.0]), 0.3))
MAP = load_joint_map("unity22")
STEP_S = 1 / 64  # exact in 32 bits
TOLERANCE_M = 1e-5  # 32 bits of metres up to 10, over a chain of six bones


class Performer:
    """A reader, and captures that are sent to it."""

    def __init__(self, normal_mode: bool = False) -> None:
        self.counters = SourceCounters()
        self.reader = VmcReader(MAP.source_joints, normal_mode, self.counters)
        self.time_s = 100.0

    def sends(self, count: int = 1, lost: Sequence[int] = (), **how: object) -> list[Frame]:
        """What comes of captures, each without its packets ``lost``."""
        found = []
        for _ in range(count):
            self.time_s += STEP_S
            packets = vmc.capture(JOINTS, self.time_s, **how)  # type: ignore[arg-type]
            for k, packet in enumerate(packets):
                frame = None if k in lost else self.reader.read(packet)
                found += [] if frame is None else [frame]
        return found


def test_after_a_pause_a_capture_waits_for_its_own_time() -> None:
    """The time that was heard last is of the run before, if the performer has started again."""
    performer = Performer()
    assert len(performer.sends(5)) > 2
    performer.reader.pause()
    performer.time_s = 7.0
    stamps = [frame.stamp_ns for frame in performer.sends(3)]
    assert stamps
    assert all(stamp is not None and 7e9 < stamp < 8e9 for stamp in stamps)


def test_packets_that_the_network_doubles_count_once() -> None:
    performer, found = Performer(), 0
    for k in range(20):
        for packet in vmc.capture(JOINTS, 100.0 + (k + 1) * STEP_S):
            found += sum(performer.reader.read(packet) is not None for _ in range(2))
    single = len(Performer().sends(20))
    assert found == single > 10
    assert performer.counters.incomplete == 0


def off_m(frame: Frame) -> float:
    """Distance of the worst joint from its true place, metres."""
    (person,) = frame.people
    joints, seen = MAP.map(MAP.to_metres_z_up(person.positions), person.observed)
    assert seen.sum() >= 16
    return float(np.abs(joints - JOINTS)[seen].max())


def test_a_quarter_turn_worked_by_hand() -> None:
    """In Unity's frame, +90 degrees about y (up) turn z (forward) to x (right)."""
    turn = (0.0, math.sin(math.pi / 4), 0.0, math.cos(math.pi / 4))
    still = (0.0, 0.0, 0.0, 1.0)
    found = global_positions(
        (1.0, 0.0, 0.0, *turn), {"Hips": (0.0, 0.9, 0.5, *still), "Spine": (0.0, 0.2, 0.1, *still)}
    )
    np.testing.assert_allclose(found["Hips"], [1.5, 0.9, 0.0], atol=1e-12)
    np.testing.assert_allclose(found["Spine"], [1.6, 1.1, 0.0], atol=1e-12)
    right, forward = MAP.to_metres_z_up(np.array([[1.0, 0, 0], [0, 0, 1.0]]))
    assert (right.tolist(), forward.tolist()) == ([0, -1, 0], [1, 0, 0])


@pytest.mark.parametrize("time_first", [False, True])
@pytest.mark.parametrize(
    "leave_out", [(), ("UpperChest",), ("UpperChest", "Chest", "LeftShoulder", "RightToes")]
)
def test_every_joint_is_where_the_wearer_has_it(time_first: bool, leave_out: Sequence[str]) -> None:
    """Local poses add up, whatever optional bones the avatar lacks; its size is taken off."""
    found = Performer().sends(
        6, time_first=time_first, leave_out=leave_out, scale=0.8, offset=(0.1, 0.2, -0.3)
    )
    assert len(found) >= 3
    assert max(off_m(frame) for frame in found) < TOLERANCE_M
    stamps = [frame.stamp_ns for frame in found if frame.stamp_ns is not None]
    assert set(np.diff(stamps)) == {round(STEP_S * 1e9)}


def test_a_lost_packet_costs_its_capture_and_nobody_is_put_together_from_two() -> None:
    performer = Performer()
    assert len(performer.sends(4)) == 2  # the first two show which bones the avatar has
    assert performer.sends(1, lost=[0]) == []
    assert performer.counters.incomplete == 1
    assert off_m(performer.sends(1)[0]) < TOLERANCE_M


def test_another_avatar_is_learned() -> None:
    performer = Performer()
    performer.sends(4)
    found = performer.sends(20, leave_out=("UpperChest",))
    assert found
    assert off_m(found[-1]) < TOLERANCE_M
    assert 0 < performer.counters.incomplete <= 10


@pytest.mark.parametrize(
    ("ok", "says"),
    [
        ((0,), "no avatar"),
        ((1, 2, 1), "not calibrated"),
        ((1, 3, 0), "normal mode"),
        ((1, 3, 1, 0), "lost its trackers"),
    ],
)
def test_a_performer_that_is_not_ready_sees_nobody(ok: Sequence[int], says: str) -> None:
    performer = Performer()
    performer.sends(4)
    found = performer.sends(3, ok=ok)
    assert [(frame.tracks, frame.people) for frame in found[-2:]] == [(False, ())] * 2
    assert says in str(performer.counters.last_error)
    assert performer.sends(2)[-1].tracks


@pytest.mark.parametrize("ok", [(1,), (1, 3, 2), (1, 3, 1, 1)])
def test_short_statuses_of_older_performers_are_taken(ok: Sequence[int]) -> None:
    assert Performer().sends(4, ok=ok)[-1].people


def test_the_normal_mode_is_taken_where_it_is_configured() -> None:
    assert Performer(normal_mode=True).sends(4, ok=(1, 3, 0, 1))[-1].people


def test_without_a_status_nobody_is_seen() -> None:
    performer = Performer()
    for k in range(4):
        root, bones = vmc.avatar(JOINTS)
        packet = [vmc.message("/VMC/Ext/T", k * STEP_S)]
        packet += [vmc.message("/VMC/Ext/Root/Pos", "root", *root)]
        packet += [vmc.message("/VMC/Ext/Bone/Pos", n, *pose) for n, pose in bones.items()]
        frame = performer.reader.read(vmc.bundle(packet))
        assert frame is not None
        assert not frame.tracks
    assert "has not sent /VMC/Ext/OK" in str(performer.counters.last_error)


def test_bones_without_the_hips_are_refused_by_name() -> None:
    performer = Performer()
    found = performer.sends(5, leave_out=("Hips",))
    assert not any(frame.people for frame in found)
    assert "a relative stream, without 'Hips'" in str(performer.counters.last_error)


def test_messages_of_other_programs_are_ignored_and_counted() -> None:
    performer = Performer()
    assert performer.reader.read(vmc.message("/avatar/parameters/Viseme", 3)) is None
    assert performer.counters.ignored == 1


@pytest.mark.parametrize(
    "message",
    [
        vmc.message("/VMC/Ext/T"),
        vmc.message("/VMC/Ext/T", float("nan")),
        vmc.message("/VMC/Ext/OK", "yes"),
        vmc.message("/VMC/Ext/Bone/Pos", "Hips", 0.0, 0.9),
        vmc.message("/VMC/Ext/Bone/Pos", "Hips", *[0.0] * 7),  # no quaternion
        vmc.message("/VMC/Ext/Bone/Pos", "Hips", float("inf"), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        vmc.message("/VMC/Ext/Root/Pos", "root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *[0.0] * 6),
    ],
)
def test_a_wrong_message_spoils_its_whole_packet(message: bytes) -> None:
    with pytest.raises(FrameError, match="/VMC/Ext/"):
        Performer().reader.read(vmc.bundle([vmc.message("/VMC/Ext/OK", 1), message]))


@given(st.lists(st.integers(0, 5000), max_size=4), st.integers(1, 255), st.booleans())
def test_damaged_packets_make_no_joint_that_is_not_a_number(
    places: list[int], flip: int, time_first: bool
) -> None:
    performer = Performer()
    performer.sends(3, time_first=time_first)
    for packet in vmc.capture(JOINTS, performer.time_s + STEP_S, time_first=time_first):
        data = bytearray(packet)
        for place in places:
            data[place % len(data)] ^= flip
        try:
            frame = performer.reader.read(bytes(data))
        except FrameError:
            continue
        for person in frame.people if frame is not None else ():
            assert person.positions.shape == (len(MAP.source_joints), 3)
            assert np.isfinite(person.positions[person.observed]).all()


def test_the_map_names_the_same_joints_as_the_canonical_skeleton() -> None:
    mapped = {CANONICAL.joints[k] for k in np.flatnonzero(MAP.mapped)}
    assert set(CANONICAL.joints) - mapped == {"torso", "head_top", "l_hand", "r_hand"}
