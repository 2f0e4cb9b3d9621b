"""One sensor of a merged source: scenes that do not advance."""

from collections import deque

import numpy as np
import pytest

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_predict.people.merging.sensor import Sensor
from hri_predict.people.settings import PeopleSettings
from hri_predict.protocol.reasons import Reason
from hri_sim.people.body import Body as Figure
from hri_sim.people.procedural import ProceduralSettings

MS = 1_000_000
FIGURE = Figure(1.75)
SETTINGS = ProceduralSettings(kind="procedural")


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
    sensor = Sensor("front", source, SETTINGS)  # type: ignore[arg-type]
    for number, at_ms in ((5, 1000), (6, 1033)):
        source.scenes += [scene(number, at_ms, 5.0), scene(number - 4, at_ms, x)]
        sensor.take((at_ms + 5) * MS)
    view = sensor.at(sensor.newest_ns, sensor.newest_ns - 1)
    reasons = {doubt.reason for doubt in view.doubts}
    assert (Reason.INPUT_IMPOSSIBLE in reasons) == doubted
    assert sensor.counters["refused_scenes"] == 2


def seen_by(sensor: Sensor, source: Given, joints: list[Floats]) -> set[Reason]:
    """The doubts of the newest of scenes of one body."""
    for number, body in enumerate(joints, 1):
        at_ns = 1000 * MS + round(number * 1e9 / source.rate_hz)
        person = Person(1, body, np.ones(len(JOINTS), np.bool_))
        source.scenes.append(Scene(at_ns, number, True, (person,)))
        sensor.take(at_ns + 5 * MS)
    view = sensor.at(sensor.newest_ns, sensor.newest_ns - 1)
    return {doubt.reason for doubt in view.doubts}


@pytest.mark.parametrize(("frozen_scenes", "frozen"), [(3, True), (6, False)])
def test_the_settings_of_people_judge_it(frozen_scenes: int, frozen: bool) -> None:
    source = Given()
    source.declares_noise = True
    sensor = Sensor("front", source, SETTINGS)  # type: ignore[arg-type]
    sensor.judge_by(PeopleSettings(frozen_scenes=frozen_scenes))
    joints = FIGURE.joints(FIGURE.standing(np.array([1.0, 1.0]), 0.3))
    assert (Reason.INPUT_FROZEN in seen_by(sensor, source, [joints] * 5)) == frozen


@pytest.mark.parametrize("unchecked", [None, "an exhibition with dolls"])
def test_it_judges_motion_unless_postures_are_unchecked(unchecked: str | None) -> None:
    """A body that glides like a statue on wheels."""
    source = Given()
    sensor = Sensor("front", source, SETTINGS)  # type: ignore[arg-type]
    sensor.judge_by(PeopleSettings(posture_unchecked=unchecked))
    joints = FIGURE.joints(FIGURE.standing(np.array([1.0, 1.0]), 0.3))
    glides = [joints + np.array([0.04 * k, 0.0, 0.0]) for k in range(60)]
    assert (Reason.INPUT_REPEATS in seen_by(sensor, source, glides)) == (unchecked is None)


def test_one_that_was_moved_is_named() -> None:
    source = Given()
    source.rate_hz = 10.0
    sensor = Sensor("front", source, SETTINGS)  # type: ignore[arg-type]
    sensor.judge_by(PeopleSettings(floor_drift_m=0.1))
    joints = FIGURE.joints(FIGURE.standing(np.array([1.0, 1.0]), 0.3))
    spots = [np.array([2.0 * k, 0.0, 0.0]) for k in range(3)]
    scenes = [joints + spot for spot in spots for _ in range(12 * 11)]
    scenes += [joints + spot + np.array([0.0, 0.0, 0.12]) for spot in spots for _ in range(7 * 11)]
    assert Reason.SENSOR_MOVED in seen_by(sensor, source, scenes)
    (text,) = [d.text for d in sensor.at(sensor.newest_ns, 0).doubts if "floor" in d.text]
    assert text.startswith("sensor front: the floor appears 12 cm higher")
