"""From pictures to scenes: what the node is sent."""

import time
from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import SourceError
from tests.hri_drivers.camera.pictures import Script, body, found, image

from hri_drivers.camera.network.found import Finding  # isort: skip
from hri_drivers.camera.newest import Newest  # isort: skip
from hri_drivers.camera.pipeline import Pipeline  # isort: skip
from hri_drivers.sources.sent import SentPerson  # isort: skip

MS = 1_000_000


class Given:
    """An input of given results, then its end."""

    waits, stamps = True, "the test's"

    def __init__(self, *results):
        self._results = list(results)

    def read(self):
        result = self._results.pop(0) if self._results else None
        if isinstance(result, Exception):
            raise result
        return result

    def close(self):
        pass


class Sent:
    """A sender that keeps what it is given."""

    scenes = unsent = clock_steps = 0

    def __init__(self):
        self.kept = []

    def send(self, people, *, sees_room, stamp_ns, missed=0):
        self.kept.append((people, sees_room, stamp_ns, missed))

    @property
    def views(self):
        return [(len(people), sees_room) for people, sees_room, _, _ in self.kept]


class Where:
    """A placer that knows each place, or none."""

    def __init__(self, knows=True):
        self.unplaced, self._knows = {}, knows

    def place(self, seen, image):
        joints = len(seen.pixels)
        return SentPerson(seen.id, np.zeros((joints, 3)), np.full(joints, self._knows))


def one(x=320.0):
    return Finding((found(body(x)),))


def pipeline(findings, *, inputs=(), knows=True, max_hz=None):
    sent: Any = Sent()
    placer: Any = Where(knows)
    newest = Newest(Given(*inputs))
    return Pipeline(newest, Script(findings), placer, sender=sent, max_hz=max_hz), sent


def test_a_person_in_a_good_picture_is_sent_with_the_time_of_the_exposure():
    line, sent = pipeline([one()])
    line.take(image(1, 7_000))
    ((people, sees_room, stamp_ns, _),) = sent.kept
    assert [person.id for person in people] == [1]
    assert (sees_room, stamp_ns) == (True, 7_000)


def test_a_picture_without_a_person_is_not_an_empty_room():
    line, sent = pipeline([Finding(())])
    line.take(image())
    assert sent.views == [(0, False)]
    assert line.summary()["without_view"] == {"no person in the image": 1}


def test_people_beyond_those_followed_are_not_left_out_silently():
    line, sent = pipeline([Finding((found(body()),), is_whole=False)])
    line.take(image())
    assert sent.views == [(1, False)]


def test_a_person_without_a_place_is_still_in_the_scene():
    line, sent = pipeline([one()], knows=False)
    line.take(image())
    (person,) = sent.kept[0][0]
    assert not person.observed.any()


@pytest.mark.parametrize("value", [0, 255])
def test_a_picture_that_shows_nothing_is_not_looked_at(value, capsys):
    line, sent = pipeline([one(), one()])
    now_ns = time.monotonic_ns()
    line.take(image(1, now_ns, np.full((480, 640, 3), value, np.uint8)))
    line.take(image(2, now_ns + 33 * MS, np.full((480, 640, 3), value, np.uint8)))
    line.take(image(3, now_ns + 66 * MS))
    assert sent.views == [(0, False), (0, False), (1, True)]
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2  # each change once
    assert "the room is not seen" in said[0]
    assert "good again" in said[1]


def test_a_frozen_camera_sees_nothing():
    line, sent = pipeline([one()] * 9)
    for k in range(9):
        line.take(image(1, 100 * k * MS, image(1).pixels))
    assert sent.views == [(1, True)] * 5 + [(0, False)] * 4


def test_a_maximum_rate_leaves_pictures_out_and_counts_them():
    line, sent = pipeline([one()] * 30, max_hz=15)
    for k in range(30):
        line.take(image(k + 1, round(1e9 * (5 + k / 30))))
    assert len(sent.kept) == 15
    assert line.summary()["skipped"] == 15


class Unplugged(Given):
    """A camera that is gone until the node was sent a scene, and then delivers one picture."""

    def __init__(self, sent):
        super().__init__(image(1))
        self._sent = sent

    def read(self):
        if not self._sent.kept:
            raise SourceError("camera 0: it is gone")
        return super().read()


def test_an_unplugged_camera_is_reported_to_the_node():
    sent: Any = Sent()
    placer: Any = Where()
    line = Pipeline(Newest(Unplugged(sent)), Script([one()]), placer, sender=sent)
    line.run()
    assert sent.views[0] == (0, False)
    assert sent.views[-1] == (1, True)
    assert line.summary()["interruptions"] >= 1
    assert line.summary()["without_view"]["camera 0: it is gone"] == len(sent.kept) - 1


def test_once_is_one_picture():
    line, sent = pipeline([one()], inputs=[image(k) for k in range(1, 5)])
    line.run(once=True)
    line.close()
    assert len(sent.kept) == 1


def test_the_summary_says_how_old_scenes_were():
    line, _ = pipeline([one()] * 3)
    for k in range(3):
        line.take(image(k + 1, time.monotonic_ns() - 80 * MS))
    latency = line.summary()["latency_ms"]
    assert 80 <= latency["least"] <= latency["p50"] <= latency["p99"]


def test_a_scene_without_a_picture_is_as_old_as_one_with_a_picture():
    dark = np.zeros((480, 640, 3), np.uint8)
    line, sent = pipeline([one()] * 2)
    began_ns = time.monotonic_ns()
    line.take(image(1, began_ns - 300 * MS))
    line.take(image(2, began_ns - 10 * MS, dark))
    line.take(image(3, began_ns - 5 * MS, dark))
    passed_ns = time.monotonic_ns() - began_ns
    stamps = [stamp_ns for _, _, stamp_ns, _ in sent.kept]
    assert stamps == sorted(set(stamps))
    assert all(stamp_ns <= began_ns - 300 * MS + passed_ns for stamp_ns in stamps)


def test_a_picture_that_is_older_than_a_scene_is_counted_and_left_out():
    line, sent = pipeline([one()] * 2)
    line.take(image(1, 100 * MS))
    line.take(image(2, 90 * MS))
    line.take(image(3, 133 * MS))
    assert [stamp_ns for _, _, stamp_ns, _ in sent.kept] == [100 * MS, 133 * MS]
    assert line.summary()["late"] == 1


@pytest.mark.parametrize("step_s", [-3600, 3600])
def test_pictures_go_on_when_the_clock_of_the_machine_is_set(step_s, monkeypatch):
    line, sent = pipeline([one()] * 4, max_hz=60)
    real, began_ns = time.time_ns, time.monotonic_ns()
    for k in range(4):
        if k == 2:
            monkeypatch.setattr(time, "time_ns", lambda: real() + step_s * 10**9)
        line.take(image(k + 1, began_ns + 20 * k * MS))
    assert sent.views == [(1, True)] * 4
    assert {person.id for people, _, _, _ in sent.kept for person in people} == {1}


def test_a_camera_that_is_moved_sees_nothing_where_its_place_counts():
    from tests.hri_drivers.camera.test_moved import CAMERA, room, seen

    shown = [seen(room(), seed=k) for k in range(2)]
    shown += [seen(room(), shift=(30.0, 0.0), seed=k) for k in range(5)]
    pictures = [image(k, k * 500 * MS, pixels) for k, pixels in enumerate(shown)]
    for stands, views in ((CAMERA, [1] * 4 + [0] * 3), (None, [1] * 7)):
        sent: Any = Sent()
        where: Any = Where()
        script = Script([one()] * len(pictures))
        line = Pipeline(Newest(Given()), script, where, sender=sent, stands=stands)
        for each in pictures:
            line.take(each)
        assert sent.views == [(n, n == 1) for n in views]
