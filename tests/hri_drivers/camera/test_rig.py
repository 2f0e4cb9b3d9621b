"""Several cameras: pictures of one moment, common ids, and what the node is sent."""

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hri_drivers.camera.kinect import Kinect
from hri_drivers.camera.place.together import APART_NS, Together
from hri_predict.base.geometry import transform
from tests.hri_drivers.camera.pictures import Script, image, textured
from tests.hri_drivers.camera.place.test_together import LEFT, RIGHT, standing

from hri_drivers.camera.network.found import Finding, Found  # isort: skip
from hri_drivers.camera.place.placed import Unplaced  # isort: skip
from hri_drivers.camera.rig import REMEMBERED, CommonIds, Eye, Rig  # isort: skip
from hri_drivers.camera.tracking import MAX_ID  # isort: skip
from hri_predict.base.arrays import Floats  # isort: skip

SIZE = LEFT.size
EXACT_M = 1e-3  # pictures at this distance have pixels of 5 mm; only rounding is left


class Next:
    """A camera's newest pictures, as given."""

    trouble, ended, dropped, stamps = None, False, 0, "the test's"

    def __init__(self, images=()):
        self.images = list(images)

    def take(self, timeout_s):
        if self.images:
            return self.images.pop(0)
        self.ended = True
        return None

    def close(self):
        pass


class Sent:
    unsent = clock_steps = 0

    def __init__(self):
        self.kept: list[Any] = []

    def send(self, people, *, sees_room, stamp_ns):
        self.kept.append((people, sees_room, stamp_ns))


def seen_by(of, bodies: list[Floats]) -> Finding:
    from_room = np.asarray(np.linalg.inv(of.room_from_optical()), np.float64)
    pixels = [of.project(transform(from_room, body)) for body in bodies]
    return Finding(tuple(Found(p, np.ones(33), None, 1.0) for p in pixels))


def rig(left, right, *, images=((), ())):
    """Return a rig whose cameras find people as given for each picture, and what it sends."""
    sent: Any = Sent()
    eyes = []
    for name, camera, findings, own in (
        ("left", LEFT, left, images[0]),
        ("right", RIGHT, right, images[1]),
    ):
        newest: Any = Next(own)
        eyes.append(Eye(name, newest, Script(findings), camera))
    return Rig(eyes, sender=sent), sent


def pictures(number, exposed_ns=None):
    stamp_ns = number * 33_000_000 if exposed_ns is None else exposed_ns
    return [
        image(2 * number + i, stamp_ns, textured(SIZE[0], SIZE[1], 2 * number + i)) for i in (0, 1)
    ]


def test_a_person_is_sent_in_the_axes_of_the_first_camera_with_the_stated_error():
    body = standing(3, 1.5)
    cameras, sent = rig([seen_by(LEFT, [body])], [seen_by(RIGHT, [body])])
    cameras.take(pictures(1))
    ((person,), sees_room, stamp_ns) = sent.kept[0]
    room = transform(LEFT.room_from_optical(), person.positions)
    np.testing.assert_allclose(room, body, atol=EXACT_M)
    assert (sees_room, stamp_ns, person.observed.all()) == (True, 33_000_000, True)
    assert person.error_m > 0


def test_two_people_keep_their_ids_when_cameras_list_them_otherwise():
    a = [standing(2.6 + 0.02 * k, 0.9) for k in range(3)]
    b = [standing(3.4, 2.1 + 0.02 * k) for k in range(3)]
    left = [seen_by(LEFT, [a[k], b[k]]) for k in range(3)]
    right = [seen_by(RIGHT, [b[k], a[k]] if k % 2 else [a[k], b[k]]) for k in range(3)]
    cameras, sent = rig(left, right)
    for number in range(3):
        cameras.take(pictures(number))
    of = []
    for people, sees_room, _ in sent.kept:
        assert sees_room
        near = {p.id: transform(LEFT.room_from_optical(), p.positions)[0, 1] < 1.5 for p in people}
        of.append(near)
    assert of[0] == of[1] == of[2]
    assert len(of[0]) == 2


def bodies_of(*members: tuple[int, int]) -> Together:
    """Return a person whom cameras' trackers gave these ids: (camera, id)."""
    of = dict(members)
    return Together(
        tuple(SimpleNamespace(id=of[v]) if v in of else None for v in (0, 1)),  # type: ignore[misc]
        Unplaced("the test's"),
    )


def test_ids_of_people_who_left_are_forgotten_and_those_in_use_not_given_again():
    ids = CommonIds()
    (stays,) = ids.assign([bodies_of((0, 1), (1, 1))])
    ids._given = MAX_ID - 500
    for number in range(2, 2 * REMEMBERED):  # the ids begin again meanwhile
        found = ids.assign([bodies_of((0, 1)), bodies_of((1, number))])
        assert found[0] == stays
        assert found[1] != stays
    assert len(ids._of) <= REMEMBERED


def test_a_person_that_one_camera_sees_is_sent_without_a_place():
    cameras, sent = rig([seen_by(LEFT, [standing(3, 1.5)])], [Finding(())])
    cameras.take(pictures(1))
    ((person,), sees_room, _) = sent.kept[0]
    assert not person.observed.any()
    assert not sees_room
    assert cameras.unplaced == {"no second camera shows the same person": 1}


def test_pictures_without_a_person_are_not_an_empty_room():
    cameras, sent = rig([Finding(())], [Finding(())])
    cameras.take(pictures(1))
    assert sent.kept == [((), False, 33_000_000)]


def test_more_people_than_are_followed_is_not_the_whole_room():
    body = standing(3, 1.5)
    more = Finding(seen_by(LEFT, [body]).people, is_whole=False)
    cameras, sent = rig([more], [seen_by(RIGHT, [body])])
    cameras.take(pictures(1))
    assert sent.kept[0][1] is False


def test_one_covered_camera_blinds_all(capsys):
    cameras, sent = rig([], [])
    one, _ = pictures(1)
    cameras.take([one, image(2, 33_000_000, np.zeros((SIZE[1], SIZE[0], 3), np.uint8))])
    assert [(people, sees_room) for people, sees_room, _ in sent.kept] == [((), False)]
    assert "right: the image is dark" in capsys.readouterr().err


def test_pictures_whose_times_are_known_differently_are_not_of_one_moment(capsys):
    body = standing(3, 1.5)
    cameras, sent = rig([seen_by(LEFT, [body])], [seen_by(RIGHT, [body])])
    left, right = pictures(1)
    arrived = replace(right, stamped="on arrival less 0.05 s")
    for other in (left, replace(left, stamped=Kinect.stamped)):
        cameras.take([other, arrived])
        assert sent.kept.pop()[:2] == ((), False)
        said = f"left {other.stamped}, right on arrival less 0.05 s); use cameras of one kind"
        assert said in capsys.readouterr().err
    both = [replace(each, stamped=arrived.stamped) for each in pictures(2, time.monotonic_ns())]
    cameras.take(both)
    assert sent.kept[-1][1]


@pytest.mark.parametrize(("late_ns", "unpaired"), [(APART_NS, 0), (APART_NS + 1, 1)])
def test_only_pictures_of_one_moment_go_together(late_ns, unpaired):
    first, second = pictures(1, 0), pictures(2, 30_000_000)
    right = [image(2, late_ns, second[1].pixels)]
    cameras, _ = rig([], [], images=([first[0], second[0]], right))
    found = cameras.together()
    if unpaired:
        assert found is None
        found = cameras.together()  # the left one's next picture
    assert found is not None
    assert [each.exposed_ns for each in found] == [30_000_000 if unpaired else 0, late_ns]
    assert cameras.unpaired == unpaired


def test_it_ends_with_an_input_and_says_what_it_did():
    body = standing(3, 1.5)
    sets = [pictures(number) for number in (1, 2)]
    images = [each[0] for each in sets], [each[1] for each in sets]
    cameras, sent = rig([seen_by(LEFT, [body])] * 2, [seen_by(RIGHT, [body])] * 2, images=images)
    cameras.run()
    assert len(sent.kept) == 2
    summary = cameras.summary()
    assert (summary["scenes"], summary["unpaired"], summary["without_view"]) == (2, 0, {})
