"""A joint is found through noise and outliers; what was not still, or not there, is said."""

from collections.abc import Callable

import numpy as np
import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import JOINTS
from hri_predict.cli.register.sight import (
    LEAST_SIGHTS,
    Sensor,
    Sights,
    choose_joint,
    place_of,
)
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene

J = len(JOINTS)
WRIST = JOINTS.index("r_wrist")
AT = np.array([1.0, -0.4, 0.9])


class Shows:
    """A source that shows what ``people(k)`` gives at scene k, at 30 Hz, for 3 s."""

    rate_hz, declares_noise = 30.0, False

    def __init__(self, people: Callable[[int], list[Person]], joint_map: str = "canonical") -> None:
        self.joint_map = load_joint_map(joint_map)
        self._people, self._k, self._start = people, 0, 0

    def open(self, start_ns: int) -> None:
        self._start = start_ns

    def next_ns(self) -> int | None:
        return self._start + round(self._k * 1e9 / 30) if self._k < 90 else None

    def poll(self, now_ns: int) -> Scene | None:
        due = self.next_ns()
        if due is None or due > now_ns:
            return None
        self._k += 1
        return Scene(due, self._k, True, tuple(self._people(self._k)))

    def close(self) -> None:
        pass


def watched(people: Callable[[int], list[Person]]) -> tuple[Sensor, Sights]:
    clock = VirtualClock(0)
    sensor = Sensor(Shows(people), clock)
    sensor.source.open(clock.now_ns())
    return sensor, sensor.watch(2.0)


def wrist(noise: float = 0.03, outliers: float = 0.1, drift: float = 0.0, seen: float = 1.0):
    rng = np.random.default_rng(3)

    def people(k: int) -> list[Person]:
        joints = np.full((J, 3), 5.0)
        joints[WRIST] = AT + rng.normal(0.0, noise, 3) + [drift * k / 60, 0, 0]
        if rng.random() < outliers:
            joints[WRIST] += 0.6
        there = np.ones(J, bool)
        there[WRIST] = rng.random() < seen
        return [Person(1, joints, there)]

    return people


def test_the_median_bears_30_mm_of_noise_and_a_tenth_of_outliers():
    place = place_of(*watched(wrist()), "r_wrist")
    assert place.middle == pytest.approx(AT, abs=0.02)  # four standard errors
    assert 0.02 < place.spread_m < 0.045


def test_a_joint_that_moves_is_refused_also_under_noise():
    with pytest.raises(ConfigError, match="it moved by"):
        place_of(*watched(wrist(drift=0.2)), "r_wrist")


def test_a_tracker_that_scatters_too_much_is_refused():
    with pytest.raises(ConfigError, match="scatters by"):
        place_of(*watched(wrist(noise=0.3)), "r_wrist")


def test_a_joint_that_is_hidden_is_named_with_those_that_are_seen():
    with pytest.raises(ConfigError, match=r"r_wrist: seen 0 times in 6\d scenes.*seen now: waist"):
        place_of(*watched(wrist(seen=0.0)), "r_wrist")


def test_an_empty_room_and_no_sender_are_two_things():
    with pytest.raises(ConfigError, match="no person is in view"):
        place_of(*watched(lambda k: []), "r_wrist")
    sensor, sights = watched(lambda k: [])
    none = Sights(positions=sights.positions, observed=sights.observed, scenes=0)
    with pytest.raises(ConfigError, match="no scene arrived"):
        place_of(sensor, none, "r_wrist")


def test_more_than_one_person_is_refused():
    one = wrist()
    with pytest.raises(ConfigError, match="more than one person"):
        watched(lambda k: one(k) * 2)


def test_feet_are_the_middle_of_the_ankles():
    joints = np.zeros((J, 3))
    joints[JOINTS.index("l_ankle")], joints[JOINTS.index("r_ankle")] = [1, 0.2, 0], [1, -0.2, 0]
    person = Person(1, joints, np.ones(J, bool))
    place = place_of(*watched(lambda k: [person]), "feet")
    assert place.middle == pytest.approx([1, 0, 0])
    assert place.count >= LEAST_SIGHTS


@pytest.mark.parametrize(("joint_map", "joint"), [("canonical", "r_hand"), ("coco17", "r_wrist")])
def test_the_joint_that_touches_is_one_that_the_source_has(joint_map, joint):
    assert choose_joint(Shows(lambda k: [], joint_map), None) == joint


def test_a_joint_that_the_map_lacks_is_refused_with_those_that_it_has():
    with pytest.raises(ConfigError, match=r"coco17 has no such joint.*it has: waist, .*r_ankle\)"):
        choose_joint(Shows(lambda k: [], "coco17"), "r_hand")
    with pytest.raises(ConfigError, match="has no joint 'r_wirst'; did you mean 'r_wrist'"):
        choose_joint(Shows(lambda k: []), "r_wirst")
