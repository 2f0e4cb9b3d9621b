"""Faults of axes: turned and mirrored bodies keep their shape, and only within the fault's time."""

import numpy as np
import pytest

from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person, Scene
from hri_sim.faults.injector import FaultySource, parse_fault

BODY = np.random.default_rng(2).uniform(-1, 2, (21, 3))


class Stands:
    """One body, at 25 Hz for 2 s."""

    joint_map = load_joint_map("canonical")
    rate_hz, declares_noise, k = 25.0, False, 0

    def open(self, start_ns):
        pass

    def next_ns(self):
        return self.k * 40_000_000 if self.k < 50 else None

    def poll(self, now_ns):
        if self.next_ns() is None or self.next_ns() > now_ns:
            return None
        self.k += 1
        return Scene(now_ns, self.k, True, (Person(1, BODY, np.ones(21, bool)),))

    def close(self):
        pass


def shown(fault):
    """The body with and without the fault, which acts in the first second."""
    source = FaultySource(Stands(), [parse_fault(fault)], 0)
    source.open(0)
    scenes = []
    while (due := source.next_ns()) is not None:
        while (scene := source.poll(due)) is not None:
            scenes.append(scene.people[0].positions)
    assert np.array_equal(scenes[-1], BODY)
    return scenes[0]


def lengths(body):
    return np.linalg.norm(body[:, None] - body[None], axis=-1)


def test_a_rotation_turns_about_its_point():
    turned = shown("rotate@0+1:quaternion_xyzw=[1,0,0,0],about=[0.5,1,2]")
    assert turned == pytest.approx(np.array([0.0, 2.0, 4.0]) + BODY * [1, -1, -1])
    assert lengths(turned) == pytest.approx(lengths(BODY))


def test_by_default_it_lays_bodies_down():
    assert shown("rotate@0+1") == pytest.approx(BODY[:, [0, 2, 1]] * [1, -1, 1])


def test_a_mirror_keeps_heights_and_lengths_and_swaps_the_sides():
    mirrored = shown("mirror@0+1:at_y=0.5")
    assert mirrored == pytest.approx(np.array([0.0, 1.0, 0.0]) + BODY * [1, -1, 1])
    assert lengths(mirrored) == pytest.approx(lengths(BODY))
