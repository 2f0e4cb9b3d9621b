"""BlazePose: whom the detector finds is followed by landmarks."""

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from tests.hri_drivers.camera.pictures import textured

from hri_drivers.camera.network import blazepose  # isort: skip
from hri_drivers.camera.network.blazepose import DETECT_EVERY, BlazePose  # isort: skip
from hri_drivers.camera.network.detector import ANCHORS, SIDE  # isort: skip
from hri_drivers.camera.network.runtime import Net  # isort: skip

PICTURE = textured(640, 640)
BUILT = 1
"""Run of the detector when the network is built."""


class Scene:
    """Two networks that see people at places of the picture, 0..1, of a size in it."""

    def __init__(self, places: list[float], edges: list[float] | None = None) -> None:
        self.places = places
        self.edges = edges
        self.detections = self.looks = 0
        self.absent = False

    def detector(self) -> Net:
        def run(_):
            self.detections += 1
            boxes = np.zeros((1, 2254, 12), np.float32)
            scores = np.full((1, 2254, 1), -9.0, np.float32)
            edges = [30.0] * len(self.places) if self.edges is None else self.edges
            for k, (x, edge) in enumerate(zip(self.places, edges, strict=True)):
                offset = (np.array([x, 0.5]) - ANCHORS[k]) * SIDE
                boxes[0, k] = [*offset, 9, 9, *offset, *(offset - [0, edge]), *offset, *offset]
                scores[0, k] = 3.0
            return [boxes, scores]

        return Net((1, 224, 224, 3), ["a", "b"], run)

    def landmarks(self) -> Net:
        """A body in the middle of each square."""

        def run(_):
            self.looks += 1
            points = np.zeros((39, 5), np.float32)
            points[:, :2], points[:, 3:] = 128.0, 4.0
            points[:33, 1] += np.linspace(-60, 60, 33, dtype=np.float32)
            points[34, 1] = 128 - 128 / 1.25  # so that the next square has the same size
            return [
                points.reshape(1, 195), np.full((1, 1), 0.1 if self.absent else 0.9, np.float32),
                np.zeros((1, 256, 256, 1), np.float32), np.full((1, 64, 64, 39), -9.0, np.float32),
                np.zeros((1, 117), np.float32),
            ]  # fmt: skip

        return Net((1, 256, 256, 3), list("abcde"), run)

    def network(self, people: int = 4) -> BlazePose:
        return BlazePose(self.detector(), self.landmarks(), people)


def test_a_detected_person_is_followed_without_the_detector():
    scene = Scene([0.5])
    network = scene.network()
    first = network.find(PICTURE)
    second = network.find(PICTURE)
    assert scene.detections == 1 + BUILT
    np.testing.assert_allclose(first.people[0].pixels, second.people[0].pixels, atol=0.01)
    assert first.people[0].pixels[16] == pytest.approx([319.5, 319.5], abs=0.01)


def test_the_detector_looks_for_newcomers_every_few_pictures():
    scene = Scene([0.25])
    network = scene.network()
    network.find(PICTURE)
    scene.places = [0.25, 0.75]
    counts = [len(network.find(PICTURE).people) for _ in range(DETECT_EVERY)]
    assert counts == [1] * (DETECT_EVERY - 1) + [2]


def test_without_a_person_the_detector_looks_each_time():
    scene = Scene([])
    network = scene.network()
    for _ in range(3):
        assert network.find(PICTURE).people == ()
    assert scene.detections == 3 + BUILT


def test_a_person_who_is_lost_is_looked_for_in_the_same_picture():
    scene = Scene([0.5])
    network = scene.network()
    network.find(PICTURE)
    scene.absent = True
    assert network.find(PICTURE).people == ()
    assert scene.detections == 2 + BUILT


def test_one_person_is_not_two():
    scene = Scene([0.5, 0.51])
    assert len(scene.network().find(PICTURE).people) == 1


def test_a_small_person_behind_the_hips_of_a_large_one_is_another():
    scene = Scene([0.5, 0.55], edges=[90, 9])
    assert len(scene.network().find(PICTURE).people) == 2
    scene = Scene([0.5, 0.55], edges=[90, 80])
    assert len(scene.network().find(PICTURE).people) == 1


def test_a_search_that_ended_early_is_not_the_whole_picture(monkeypatch):
    """Of three bodies two are one person; who else was detected, no one looked at."""
    monkeypatch.setattr(blazepose, "distinct", lambda people: people[:2])
    scene = Scene([0.1, 0.3, 0.5, 0.7])
    finding = scene.network(people=2).find(PICTURE)
    assert len(finding.people) == 2
    assert not finding.is_whole


def test_more_people_than_are_followed_are_reported():
    scene = Scene([0.1, 0.3, 0.5, 0.7, 0.9])
    network = scene.network(people=4)
    finding = network.find(PICTURE)
    assert len(finding.people) == 4
    assert not finding.is_whole
    assert not network.find(PICTURE).is_whole  # also between two runs of the detector
    scene.places = scene.places[:3]
    assert [network.find(PICTURE).is_whole for _ in range(DETECT_EVERY)][-1]


def test_networks_of_other_shapes_are_refused():
    scene = Scene([])
    with pytest.raises(ConfigError, match=r"\(1, 256, 256, 3\), expected \(1, 224, 224, 3\)"):
        BlazePose(scene.landmarks(), scene.landmarks())


def test_networks_of_other_outputs_are_refused():
    scene = Scene([])
    odd = Net((1, 256, 256, 3), ["a"], lambda _: [np.zeros((1, 195), np.float32)])
    with pytest.raises(ConfigError, match="other outputs than BlazePose's"):
        BlazePose(scene.detector(), odd)
