"""The programs of motion capture: the node's readers find their captures and their clocks."""

import time
from collections.abc import Callable

import numpy as np
import pytest

from hri_drivers.sources.mocap.frames import Reader
from hri_drivers.sources.natnet.source import NatNetReader
from hri_drivers.sources.qualisys.source import QtmReader
from hri_drivers.sources.rokoko.source import RokokoReader
from hri_drivers.sources.vmc.source import VmcReader
from hri_drivers.sources.zed_livelink.source import ZedReader
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders.mocap_ends import PROGRAMS

READERS: dict[str, tuple[str, Callable[..., Reader]]] = {
    "vmc": ("unity22", lambda joints, counters: VmcReader(joints, False, counters)),
    "rokoko": ("rokoko23", RokokoReader),
    "zed_livelink": ("zed38", lambda joints, counters: ZedReader(joints, 0.0, counters)),
    "natnet": ("motive21", NatNetReader),
    "qualisys": ("qualisys24", QtmReader),
}
PERIOD_NS = 40_000_000
_BODY = Body(1.75)
STANDING = _BODY.joints(_BODY.standing(np.array([1.7, 0.2]), np.pi))


@pytest.mark.parametrize("kind", PROGRAMS)
def test_a_reader_finds_each_capture_at_its_time(kind):
    program = PROGRAMS[kind]()
    layout, make = READERS[kind]
    reader = make(load_joint_map(layout).source_joints, SourceCounters())
    program.start()
    for unit in program.greeting:
        reader.read(unit)
    person = Person(1, STANDING, np.ones(len(JOINTS), np.bool_))
    began_ns, frames = time.time_ns(), []
    for k in range(6):
        scene = Scene(began_ns + k * PERIOD_NS, k, True, (person,))
        frames += [f for f in map(reader.read, program.encode(scene)) if f is not None]
    assert len(frames) >= 4  # a reader that waits for a next capture keeps the last ones
    times_ns = [frame.stamp_ns or 0 for frame in frames]
    assert all(len(frame.people) == 1 for frame in frames)
    # Clocks of single precision, two hours after their start, have steps of 0.5 ms.
    np.testing.assert_allclose(np.diff(times_ns), PERIOD_NS, atol=1_000_000)
