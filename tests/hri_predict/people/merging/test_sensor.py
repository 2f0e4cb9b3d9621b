"""One sensor of a merged source: scenes that do not advance."""

from collections import deque

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.people.merging.sensor import Sensor
from hri_predict.protocol.reasons import Reason
from hri_sim.people.body import Body as Figure
from hri_sim.people.procedural import ProceduralSettings

MS = 1_000_000
FIGURE = Figure(1.75)


class Given:
    """A source of the scenes that a test gives it."""

    joint_map = load_joint_map("canonical")
    rate_hz = 30.0
    declares_noise = False

    def __init__(self) -> None:
        self.scenes: deque[Scene] = deque()

    def poll(self, now_ns: int) -> Scene | None:
        return self.scenes.popleft() if self.scenes else None


def scene(sequence: int, at_ms: int, x: float) -> Scene:
    joints = FIGURE.joints(FIGURE.standing(np.array([x, 1.0]), 0.3))
    return Scene(at_ms * MS, sequence, True, (Person(1, joints, np.ones(len(JOINTS), np.bool_)),))


@pytest.mark.parametrize(("x", "doubted"), [(5.0, False), (4.0, False), (1.0, True)])
def test_a_body_elsewhere_in_scenes_that_do_not_advance_is_a_doubt(x: float, doubted: bool) -> None:
    """Two programs that give the same id: the second one's sequence never advances."""
    source = Given()
    sensor = Sensor("front", source, ProceduralSettings(kind="procedural"))  # type: ignore[arg-type]
    for number, at_ms in ((5, 1000), (6, 1033)):
        source.scenes += [scene(number, at_ms, 5.0), scene(number - 4, at_ms, x)]
        sensor.take((at_ms + 5) * MS)
    view = sensor.at(sensor.newest_ns, sensor.newest_ns - 1)
    reasons = {doubt.reason for doubt in view.doubts}
    assert (Reason.INPUT_IMPOSSIBLE in reasons) == doubted
    assert sensor.counters["refused_scenes"] == 2
