"""The newest picture; older ones are counted."""

import threading

import pytest

from hri_drivers.camera.seen import Image
from hri_predict.base.errors import SourceError
from tests.hri_drivers.camera.pictures import image

from hri_drivers.camera.newest import Newest  # isort: skip

PATIENT_S = 30.0


class Steps:
    """An input that delivers when the test says so."""

    stamps = "the test's"

    def __init__(self, waits=False):
        self.waits = waits
        self._next = threading.Semaphore(0)
        self._given = []
        self.closed = threading.Event()

    def give(self, *results):
        for result in results:
            self._given.append(result)
            self._next.release()

    def read(self):
        assert self._next.acquire(timeout=PATIENT_S)
        result = self._given.pop(0)
        if isinstance(result, Exception):
            raise result
        return result

    def close(self):
        self.closed.set()


def taken(newest: Newest) -> Image:
    image = newest.take(PATIENT_S)
    assert image is not None
    return image


def test_only_the_newest_picture_is_taken_and_the_others_count():
    steps = Steps()
    newest = Newest(steps)
    steps.give(image(1), image(2), image(3), None)
    assert steps.closed.wait(PATIENT_S)
    assert taken(newest).number == 3
    assert newest.dropped == 2
    assert newest.take(0) is None
    assert newest.ended


def test_pictures_of_files_wait_for_each_other():
    steps = Steps(waits=True)
    newest = Newest(steps)
    steps.give(*(image(k) for k in (1, 2, 3)), None)
    images = [taken(newest) for _ in range(3)]
    assert [each.number for each in images] == [1, 2, 3]
    assert all(each.exposed_ns > 0 for each in images)  # when they were taken
    assert newest.dropped == 0


def test_an_interruption_is_named_until_a_picture_comes():
    steps = Steps()
    newest = Newest(steps)
    steps.give(SourceError("camera 0: unplugged"), image(7), None)
    assert taken(newest).number == 7
    assert newest.interruptions == 1
    assert newest.trouble is None
    steps = Steps()
    newest = Newest(steps)
    steps.give(SourceError("camera 0: unplugged"), None)
    assert steps.closed.wait(PATIENT_S)
    assert newest.trouble == "camera 0: unplugged"


def test_a_failure_of_ours_is_not_hidden():
    steps = Steps()
    newest = Newest(steps)
    steps.give(ZeroDivisionError("a fault of ours"))
    with pytest.raises(ZeroDivisionError):
        newest.take(PATIENT_S)


def test_it_stops_while_it_waits_for_a_device():
    steps = Steps()
    newest = Newest(steps)
    steps.give(SourceError("gone"))
    newest.close(0.0)
    steps.give(None)
    assert steps.closed.wait(PATIENT_S)
